/* The rotor as something that lives in time. Mirrors rotor/simulator.py. */
#ifndef RIGTWIN_SIMULATOR_H
#define RIGTWIN_SIMULATOR_H

#include "names.h"
#include "rotor.h"

typedef struct Simulator Simulator;

/* A rotor at rest, or 0 without memory; all memory that it will ever need is taken here. */
Simulator *simulator_new(const Structure *structure);
void simulator_free(Simulator *simulator);

/* Change what the rotor consists of; deflections and velocities stay continuous. Returns a sentence where that is
   impossible, and nothing is changed then; 0 otherwise. */
const char *simulator_configure(Simulator *simulator, const Design *design);

/* Whether the signal is a staircase; it is not until told. */
void simulator_hold(Simulator *simulator, int hold);

/* The signal's value [N] and the built-in sine [N, Hz]. */
void simulator_drive(Simulator *simulator, double force, double amplitude, double frequency);

/* The signal's rate [N/s], for the next step alone. */
void simulator_give_rate(Simulator *simulator, double rate);

/* The clock [s] of a rotor that has not moved yet. */
const char *simulator_start_at(Simulator *simulator, double time);

/* Integrate from a time over a step [s]. */
const char *simulator_advance(Simulator *simulator, double time, double step);

double simulator_time(const Simulator *simulator);
double simulator_force(const Simulator *simulator);

/* (2 n_nodes) y of every node, then z. */
void simulator_accelerations(const Simulator *simulator, double *accelerations);

/* Everything that is needed to go on from here under the same design, as doubles; and going back to it. */
int simulator_snapshot_size(const Simulator *simulator);
void simulator_save(const Simulator *simulator, double *snapshot);
const char *simulator_restore(Simulator *simulator, const Design *design, const double *snapshot, int size);

#endif
