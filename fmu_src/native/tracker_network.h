/* Bearing stiffness by a network that listens to the running rotor. Mirrors estimator/tracking/network.py. */
#ifndef RIGTWIN_TRACKER_NETWORK_H
#define RIGTWIN_TRACKER_NETWORK_H

#include "names.h"

typedef struct NetworkTracker NetworkTracker;

/* A tracker by the network that was printed with it; 0 without memory. */
NetworkTracker *network_tracker_new(void);
void network_tracker_free(NetworkTracker *tracker);

/* The node, from 1, that was driven when it was trained. */
int network_tracker_node(void);

/* Begin anew: logarithm of the stiffness that is said before there is an answer, and its standard error. */
void network_tracker_start(NetworkTracker *tracker, double ln_k, double error);

/* Take up force [N] and accelerations [m/s^2] of an instant, ``step`` seconds after the one before; a sentence where
   that is longer than the network's step, 0 otherwise. */
const char *network_tracker_step(NetworkTracker *tracker, double step, const double *inputs);

/* The logarithm of the stiffness, its standard error, and whether to believe them. */
double network_tracker_ln_k(const NetworkTracker *tracker);
double network_tracker_error(const NetworkTracker *tracker);
int network_tracker_valid(const NetworkTracker *tracker);

/* What it remembers, as doubles. Restoring returns 1 where these are no state. */
int network_tracker_size(void);
void network_tracker_save(const NetworkTracker *tracker, double *state);
int network_tracker_restore(NetworkTracker *tracker, const double *state);

#endif
