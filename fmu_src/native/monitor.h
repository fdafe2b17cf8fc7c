/* Whether a machine still does what its model says, and if not, what has changed. Mirrors
   estimator/tracking/monitor.py. */
#ifndef RIGTWIN_MONITOR_H
#define RIGTWIN_MONITOR_H

#include "names.h"
#include "tracker.h"

enum { NONE, OF_K_B, OF_DAMPING, OF_MASS, OF_SENSOR, UNKNOWN };

typedef struct Monitor Monitor;

/* A monitor of a rotor and the sensors that monitor_variables.h names; 0 without memory. */
Monitor *monitor_new(const ReducedRotor *rotor);
void monitor_free(Monitor *monitor);

/* Begin anew: false alarms after so many instants in the mean or later; seconds of listening before. */
void monitor_start(Monitor *monitor, const Belief *belief, double alarm_every, double learning);

/* Take up an instant, ``step`` seconds after the one before: force [N], accelerations [m/s^2], believed k_b [N/m]. */
void monitor_step(Monitor *monitor, double step, double force, const double *accelerations, double k_b);

/* Decimal logarithm of the evidence for a change; whether it is an alarm; what has changed; k_b [N/m]. */
double monitor_drift(const Monitor *monitor);
int monitor_alarm(const Monitor *monitor);
int monitor_cause(const Monitor *monitor);
double monitor_stiffness(const Monitor *monitor, double k_b); /* that was found; before the first step k_b itself */

/* What it remembers, as doubles. Restoring takes the belief and settings that it was saved under, and returns 1 where
   these doubles are no state. */
int monitor_size(void);
void monitor_save(const Monitor *monitor, double *state);
int monitor_restore(Monitor *monitor, const Belief *belief, double alarm_every, double learning, const double *state);

#endif
