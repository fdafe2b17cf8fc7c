/* Printed by python build_laws.py from rotor/model/force_laws.py; do not edit. */
#include "laws.h"

#include <math.h>

const Law LAWS[N_LAWS] = {
    {"spring", 0, 0},
    {"cubic", 0, 1},
    {"clearance", 0, 1},
    {"hertz", 0, 0},
    {"bilinear", 0, 0},
    {"contact", 0, 1},
    {"jenkins", 1, 0},
};

static double spring(double x, double k, double *derivatives)
{
    derivatives[0] = k;
    return k*x;
}

static double cubic(double x, double k3, double *derivatives)
{
    derivatives[0] = 3*k3*pow(x, 2);
    return k3*pow(x, 3);
}

static double clearance(double x, double k, double gap, double corner, double *derivatives)
{
    const double x0 = pow(corner, 2);
    const double x1 = gap - x;
    const double x2 = sqrt(x0 + pow(x1, 2));
    const double x3 = gap + x;
    const double x4 = sqrt(x0 + pow(x3, 2));
    const double x5 = (1.0/2.0)*k;
    derivatives[0] = -x5*(x1/x2 + x3/x4);
    return x5*(x2 - x4);
}

static double hertz(double x, double k, double d0, double corner, double *derivatives)
{
    const double x0 = pow(corner, 2);
    const double x1 = d0 + x;
    const double x2 = sqrt(x0 + pow(x1, 2));
    const double x3 = x1 + x2;
    const double x4 = d0 - x;
    const double x5 = sqrt(x0 + pow(x4, 2));
    const double x6 = x4 + x5;
    const double x7 = sqrt(2)/sqrt(d0);
    derivatives[0] = -k*((1.0/8.0)*x7*(-sqrt(x3)*(x1/x2 + 1) + sqrt(x6)*(-x4/x5 - 1)) + 1);
    return -k*(x + (1.0/12.0)*x7*(-pow(x3, 3.0/2.0) + pow(x6, 3.0/2.0)));
}

static double bilinear(double x, double k, double ratio, double corner, double *derivatives)
{
    const double x0 = sqrt(pow(corner, 2) + pow(x, 2));
    const double x1 = (1.0/2.0)*k*(ratio - 1);
    derivatives[0] = x1*(x/x0 + 1);
    return x1*(x + x0);
}

static double contact(double x, double k, double gap, double corner, double *derivatives)
{
    const double x0 = pow(corner, 2);
    const double x1 = gap + x;
    const double x2 = sqrt(x0 + pow(x1, 2));
    const double x3 = gap - x;
    const double x4 = sqrt(x0 + pow(x3, 2));
    derivatives[0] = -k*((1.0/2.0)*x1/x2 + (1.0/2.0)*x3/x4 - 1);
    return k*(x - 1.0/2.0*x2 + (1.0/2.0)*x4);
}

static double jenkins(double x, double x_before, double force_before, double k, double limit, double *derivatives)
{
    const double x0 = force_before + k*(x - x_before);
    const double x1 = limit < x0;
    const double x2 = limit < -x0;
    const double x3 = x1 || x2;
    derivatives[0] = ((x3) ? (
   0
)
: (
   k
));
    derivatives[1] = ((x3) ? (
   0
)
: (
   -k
));
    derivatives[2] = ((x3) ? (
   0
)
: (
   1
));
    return ((x1) ? (
   limit
)
: ((x2) ? (
   -limit
)
: (
   x0
)));
}

double law_force(int law, const double *variables, const double *coefficients, double *derivatives)
{
    switch (law) {
    case LAW_SPRING:
        return spring(variables[0], coefficients[0], derivatives);
    case LAW_CUBIC:
        return cubic(variables[0], coefficients[0], derivatives);
    case LAW_CLEARANCE:
        return clearance(variables[0], coefficients[0], coefficients[1], coefficients[2], derivatives);
    case LAW_HERTZ:
        return hertz(variables[0], coefficients[0], coefficients[1], coefficients[2], derivatives);
    case LAW_BILINEAR:
        return bilinear(variables[0], coefficients[0], coefficients[1], coefficients[2], derivatives);
    case LAW_CONTACT:
        return contact(variables[0], coefficients[0], coefficients[1], coefficients[2], derivatives);
    case LAW_JENKINS:
        return jenkins(variables[0], variables[1], variables[2], coefficients[0], coefficients[1], derivatives);
    }
    return NAN;
}
