/* What is printed when the FMU is built: the rotor of one rig (rig.c), and what its variables mean (design.c). */
#ifndef RIGTWIN_ROTOR_MODEL_H
#define RIGTWIN_ROTOR_MODEL_H

#include "names.h"
#include "rotor.h"

extern const Structure STRUCTURE;

/* Places of the exciter's variables among the values. */
extern const int FORCE, FORCE_AMPLITUDE, FORCE_FREQUENCY, HELD_FORCE;

#endif
