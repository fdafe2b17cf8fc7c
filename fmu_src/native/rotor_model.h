/* What rig.c holds, which is printed when the FMU is built: the rotor of one rig, and its variables' meaning. */
#ifndef RIGTWIN_ROTOR_MODEL_H
#define RIGTWIN_ROTOR_MODEL_H

#include "rotor.h"

extern const Structure STRUCTURE;

/* Places of the exciter's variables among the values. */
extern const int FORCE, FORCE_AMPLITUDE, FORCE_FREQUENCY;

/* The design that the values of all variables stand for. */
void design_of(const double *values, Design *design);

#endif
