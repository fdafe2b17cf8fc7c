/* The linear rotor as x' = A x + B f in scaled modal coordinates. Mirrors system.py and state_space.py of rotor/model.

   x = (s eta, eta', w): modal coordinates scaled by s = omega, so that the undamped part is skew; modal velocities;
   what the massless degrees of freedom deviate from their static position. */
#ifndef RIGTWIN_STATES_H
#define RIGTWIN_STATES_H

#include "names.h"
#include "rotor.h"

typedef struct {
    int n, m, light, n_states; /* degrees of freedom, modes (those with mass), massless ones, 2 m + light */
    const int *heavy_at, *light_at; /* (m), (light) places among the degrees of freedom */
    double *omega, *scale;          /* (m) natural frequencies [rad/s], s */
    double *Phi;                    /* (m, m) mass-normalised shapes of those with mass, by columns */
    double *to_modal;               /* (m, m) Phi' M of those with mass */
    double *slide;                  /* (light, m) static position of the massless ones */
    double *A;                      /* (n_states, n_states) */
} States;

/* Doubles and ints of memory for a system of at most n degrees of freedom. */
void states_memory(int n, int *doubles, int *ints);

/* Returns a sentence where the rotor has no motion that can be solved, or 0. */
const char *states_build(States *states, const System *system, double zeta, double spin, double *doubles, int *ints);

/* What a unit force with a pattern (n) does to x (n_states). */
void states_input(const States *states, const double *pattern, double *column);

/* Row (n_states) that reads the displacement pattern' q; work: (n). */
void states_displacement(const States *states, const double *pattern, double *row, double *work);

/* Row A of a row: the read-out of the rate of what a row reads. */
void states_rate(const States *states, const double *row, double *rate);

/* x of deflections q and velocities v, each (n). */
void states_of(const States *states, const double *q, const double *v, double *x);

/* Deflections and velocities, each (n), of x; work: (n_states). */
void states_motion(const States *states, const double *x, double *q, double *v, double *work);

#endif
