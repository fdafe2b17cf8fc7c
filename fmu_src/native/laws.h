/* Printed by python build_laws.py from rotor/model/force_laws.py; do not edit. */
#ifndef RIGTWIN_LAWS_H
#define RIGTWIN_LAWS_H

#include "names.h"

enum { LAW_SPRING, LAW_CUBIC, LAW_CLEARANCE, LAW_HERTZ, LAW_BILINEAR, LAW_CONTACT, LAW_JENKINS, N_LAWS };

typedef struct {
    const char *name;
    int memory, radial;
} Law;

extern const Law LAWS[N_LAWS];

/* Force [N] of a law and its derivatives by its variables: x, or x, x_before, force_before of one with memory. */
double law_force(int law, const double *variables, const double *coefficients, double *derivatives);

#endif
