/* Random calls of an FMU, good and bad in any order. Numbers come from a generator of their own: a seed is a run. */
#include "model.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST 12 /* values in one call */

static uint64_t state;

static uint64_t next(void)
{
    state ^= state << 13, state ^= state >> 7, state ^= state << 17; /* Marsaglia's xorshift */
    return state;
}

static int upto(int n)
{
    return (int)(next() % (uint64_t)n);
}

static double fraction(void)
{
    return (double)(next() >> 11) / 9007199254740992.0;
}

/* Mostly a variable's reference, now and then nobody's. */
static unsigned reference(void)
{
    return upto(20) ? (unsigned)upto(N_VARIABLES + 3) : (unsigned)next();
}

/* Mostly a value in a variable's range, now and then anything. */
static double value_of(unsigned number)
{
    static const double ODD[] = {0, -1, 1, 1e-300, 1e300, NAN, INFINITY, -INFINITY, 2147483647, 0.5};
    if (number >= (unsigned)N_VARIABLES || !upto(8))
        return ODD[upto(10)];
    const Variable *v = VARIABLES + number;
    const double limit = v->role == INPUT ? 1e4 : 1e12; /* forces that do not tear the rotor out of its house */
    const double least = fmax(v->least, -limit), most = fmin(v->most, limit);
    if (v->kind != REAL)
        return floor(least + fraction() * (most - least + 1));
    if (!upto(3))
        return v->start;
    return least > 0 ? least * pow(most / least, fraction()) : least + fraction() * (most - least);
}

/* A step that a master could take, or one that none should. */
static double step_size(void)
{
    static const double STEPS[] = {1e-4, 1e-3, 3.3e-3, 0.01};
    static const double ODD[] = {0, -1e-3, NAN, INFINITY, 1e300, 1e-15};
    return upto(12) ? STEPS[upto(4)] : ODD[upto(6)];
}
