/* The rotor with few coordinates. Mirrors estimator/tracking/reduced_rotor.py. */
#ifndef RIGTWIN_REDUCED_ROTOR_H
#define RIGTWIN_REDUCED_ROTOR_H

#include "names.h"

/* What its matrices depend on; natural logarithms, of the disks' masses relative to their own. */
enum { STIFFNESS, DISK_MASS, BEARING_DAMPING, SHAFT_DAMPING, IN_MATRICES };

enum { MOST_COORDINATES = 8, MOST_SENSORS = 8 };

/* Room for states, for these and the forces between which the motion is followed, for these and one force. */
enum { STATES = 2 * MOST_COORDINATES, FORCES = 3, WIDE = STATES + FORCES, SEEN = STATES + 1 };

/* The rotor in r coordinates, matrices row by row: (1 + (e^m - 1) M_disks) a + C v + K q = force f,
   K = K_fixed + k_b K_bearing, C = d C_bearing + zeta C_shaft(ln k_b). */
typedef struct {
    int r, n_nodes, n_stiffnesses;
    double lowest_ln_k, spacing;  /* of the stiffnesses at which C_shaft is given */
    double least_k_b, most_k_b;   /* that are looked for [N/m] */
    double highest_hz;            /* of the motion that the coordinates hold */
    const double *M_disks, *K_fixed, *K_bearing, *C_bearing, *C_shaft, *nodes, *scale;
} ReducedRotor;

typedef struct {
    double some[7 * WIDE * WIDE], A[WIDE * WIDE], E[WIDE * WIDE];
    int rows[WIDE];
} Room;

/* rows (r, 2 r + 1) = M^-1 (-K / scale, -C, force) at a point (IN_MATRICES), with ``mass`` [kg] attached to ``node``;
   force and node are counted from 0. */
void reduced_accelerations(const ReducedRotor *rotor, const double *point, int node, double mass, int driven,
                           double *rows, Room *room);

/* T (2 r, 2 r + 3): a step of h seconds, from the states and the force at three instants, between which it is a
   parabola. */
void reduced_step(const ReducedRotor *rotor, const double *rows, double h, double *T, Room *room);

/* Y (n_read, 2 r + 1): accelerations of nodes. */
void reduced_reading(const ReducedRotor *rotor, const double *rows, int n_read, const int *nodes, double *Y);

#endif
