/* Bearing stiffness that changes while the machine runs. Mirrors estimator/tracking/tracker.py. */
#ifndef RIGTWIN_TRACKER_H
#define RIGTWIN_TRACKER_H

#include "names.h"
#include "reduced_rotor.h"

/* What a filter estimates beside the motion: what the matrices depend on, and the logarithm of the gain. */
enum { GAIN = IN_MATRICES, N_PARAMETERS };

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

/* What a tracker knows of the machine: logarithms and gain, motion, covariance of motion and parameters (2 r + 5 square),
   mean square of the motion, standard error of an acceleration, mean squares of accelerations and force. */
typedef struct {
    double point[N_PARAMETERS], x[STATES], P[(STATES + N_PARAMETERS) * (STATES + N_PARAMETERS)], power[STATES];
    double noise, loud, loud_force;
} Learned;

/* Whether it knows the machine: while one filter runs, and the force is rich. */
int tracker_learned(const Tracker *tracker, Learned *learned);

/* Whether so many instants have lasted so long; hosts whose steps differ in the last digit count alike. */
int tracker_lasted(double instants, double step, double seconds);

/* What it remembers, as doubles. Restoring takes the belief that it was saved under, and returns 1 where these doubles
   are no state. */
int tracker_size(void);
void tracker_save(const Tracker *tracker, double *state);
int tracker_restore(Tracker *tracker, const Belief *belief, const double *state);

#endif
