/* Bearing stiffness that changes while the machine runs. Mirrors estimator/tracking/tracker.py. */
#ifndef RIGTWIN_TRACKER_H
#define RIGTWIN_TRACKER_H

#include "names.h"

/* What a filter estimates beside the motion; natural logarithms, of the disks' masses and the gain relative to 1. */
enum { STIFFNESS, DISK_MASS, BEARING_DAMPING, SHAFT_DAMPING, GAIN, N_PARAMETERS };

enum { MOST_COORDINATES = 8, MOST_SENSORS = 8 };

/* The rotor in r coordinates, matrices row by row: (1 + (e^m - 1) M_disks) a + C v + K q = force f,
   K = K_fixed + k_b K_bearing, C = d C_bearing + zeta C_shaft(ln k_b). */
typedef struct {
    int r, n_stiffnesses;
    double lowest_ln_k, spacing;  /* of the stiffnesses at which C_shaft is given */
    double least_k_b, most_k_b;   /* that are looked for [N/m] */
    double highest_hz;            /* of the motion that the coordinates hold */
    const double *M_disks, *K_fixed, *K_bearing, *C_bearing, *C_shaft, *nodes, *scale;
} ReducedRotor;

/* What is believed before anything was measured, and how fast the stiffness may change. */
typedef struct {
    double start[N_PARAMETERS], std[N_PARAMETERS];
    double walk;  /* standard deviation of ln k_b after a second */
    double noise; /* standard error of an acceleration [m/s^2]; 0: a share of their rms */
    int driven;   /* node of the force, from 0 */
} Belief;

typedef struct Tracker Tracker;

/* A tracker of the accelerations of some nodes, from 0, at most MOST_SENSORS; 0 without memory. */
Tracker *tracker_new(const ReducedRotor *rotor, int n_sensors, const int *nodes);
void tracker_free(Tracker *tracker);

/* Begin anew. */
void tracker_start(Tracker *tracker, const Belief *belief);

/* Take up the force [N] and the accelerations [m/s^2] of an instant, ``step`` seconds after the one before. */
void tracker_step(Tracker *tracker, double step, double force, const double *accelerations);

/* k_b [N/m], and the standard error of its logarithm. */
double tracker_stiffness(const Tracker *tracker);
double tracker_error(const Tracker *tracker);

/* Whether to believe them. */
int tracker_valid(const Tracker *tracker);

/* What it remembers, as doubles. Restoring takes the belief that it was saved under, and returns 1 where these doubles
   are no state. */
int tracker_size(void);
void tracker_save(const Tracker *tracker, double *state);
int tracker_restore(Tracker *tracker, const Belief *belief, const double *state);

#endif
