/* The force of a master's signal between the points at which the master gives it. Mirrors rotor/time/exciter.py, which
   says how and why. */
#ifndef RIGTWIN_EXCITER_H
#define RIGTWIN_EXCITER_H

#include "names.h"

/* The force t seconds after a step's start: force + rate t + curvature t^2 / 2. */
typedef struct {
    double force, rate, curvature;
} Course;

/* All numbers are doubles, so that a snapshot is a copy. */
typedef struct {
    double hold, sample, previous, last_step; /* hold and given: 0 or 1; last_step 0: there was none */
    double force, rate;                       /* on the rotor, at this instant [N, N/s] */
    double given, given_rate;                 /* by the master, for the next step */
} Exciter;

/* Take up the signal's value at this instant [N]. */
void exciter_set(Exciter *exciter, double sample);

/* Take up its rate at this instant [N/s], for the next step alone. */
void exciter_give_rate(Exciter *exciter, double rate);

/* The force over the next h seconds. */
Course exciter_course(const Exciter *exciter, double h);

/* Be at the end of a step with this course. */
void exciter_advance(Exciter *exciter, const Course *course, double h);

#endif
