/* Time stepping of the rotor with local nonlinear forces. Mirrors rotor/nonlinear_stepper.py, which says how and why.

   Other than there, a substep's propagator knows nothing of the tones: the forces are their Taylor series about the
   substep's start, which is exact to 3e-14 for a 16th of a period. So one propagator serves every line of a
   sweep whose substeps are as long, and a long one is the square of its half. */
#ifndef RIGTWIN_NONLINEAR_H
#define RIGTWIN_NONLINEAR_H

#include "names.h"
#include "arena.h"
#include "states.h"
#include "stepper.h"

#define JOINT_ROWS 5 /* of the state, after x: of every joint g, g', g_s, v_s, the substep */
#define SUBSTEPS_KEPT 64

/* One joint in one plane. */
typedef struct {
    const LocalForce *force;
    int law, plane, partner; /* the same joint in the other plane, where a radial law ties the two; else itself */
    double offset, offset_across; /* static displacement, in its own plane and in the other */
    double tangent, at_rest, noise; /* slope at rest, that goes into the linear part; force there; its round-off */
} Joint;

/* States that are stepped together, with the joints they move: x' = A x + B u + G g, d = C x, v = V x. */
typedef struct {
    int n, J;
    int *places, *joints, *partner; /* (n) states and (J) joints of the rotor; among those of the part */
    double *A, *B, *G, *C, *V;      /* (n, n), (n, inputs), (n, J), (J, n), (J, n) */
    double *round_off;              /* (J) of a joint's velocity, over |x| */
    double rate;                    /* largest column sum of A, G, B */
} Part;

/* One substep of a part: columns of x less the share of u, the forces' Taylor series, u = (g, g') at its start; rows of
   the same x at its end, d_free, v_free. */
typedef struct {
    int part; /* -1: none */
    double tau;
    long long last_used;
    double *exponential, *W; /* of everything, by rows; by columns */
    double *onset, *P, *Q;   /* (n, 2 J), (J, 2 J), (J, 2 J) what u at the end makes of x, d and v */
    double coupling;         /* displacement by the other joints' pulls over that by the own */
    int tied;                /* whether a radial law ties two of the joints */
} Substep;

/* The joints of a part at one instant: displacements and velocities, (J) each; pulls, then their rates. */
typedef struct {
    double *d, *v, *u;
    double stiffness; /* largest |P dg/dd| */
} Instant;

typedef struct {
    int n, J, n_inputs;
    double first, shortest, fading; /* substeps [s]; of the scales [1/s] */
    double *A, *G, *C;              /* with the forces' slope at rest; of all joints */
    const double *B;
    Joint *joints;
    int n_groups, *group, *joint_group, *moving, *divided; /* of the states; of the joints, -1: held */
    int n_parts;
    Part *parts;
    int *part_ints;
    double *part_doubles;
    Substep substeps[SUBSTEPS_KEPT];
    long long clock;
    double *scratch, *z, *after, *middle;
    int *rows;
    double *bounds, *notice, *pull_scale, *velocity_scale;
    Instant now, next;
    char message[400];
} Nonlinear;

/* Take memory for at most n states, with at most ``joints`` joints. */
void nonlinear_place(Nonlinear *s, Arena *arena, int n, int joints);

/* B (n_states, n_inputs) stays where it is. work: 2 n of the system and 2 n_states. */
void nonlinear_build(Nonlinear *s, const System *system, const States *states, int n_inputs, const double *B,
                     double *work);

/* Put the joints of a state in which x stands already as they are there; carried (J): forces of the laws with memory,
   or 0. */
void nonlinear_start(Nonlinear *s, double *state, const double *carried);

/* The state (n + 5 J) after h seconds, in place. Returns a sentence where that fails; the state is lost then. */
const char *nonlinear_step(Nonlinear *s, double *state, const Course *signal, const Tone *tones, int n_tones, double h);

#endif
