/* The governor behind SpeedSupervisor's variables. */
#include "model.h"

#include "machine_variables.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The header is printed for a rotor when the FMU is built: resonances [rad/s] at stiffnesses that are even in their
   logarithm, rising, one resonance after the other; and frequencies [rad/s] and phases [rad] of the probe. */

/* What it remembers: doubles, as a state is saved. */
typedef struct {
    double time, phase, speed;
    double k_b;    /* the last one that was valid; 0: none was */
    double wanted; /* speed for which ``below`` was counted */
    double below;  /* number of resonances below it; -1: not yet */
} Memory;

struct Model {
    Memory memory;
    double values[N_VALUES];
};

#define STATE ((int)(sizeof(Memory) / sizeof(double)))

Model *model_new(void)
{
    Model *model = calloc(1, sizeof(Model));
    if (model)
        model->memory.below = -1;
    return model;
}

void model_free(Model *model)
{
    free(model);
}

const char *model_accept(Model *model, const double *values)
{
    memcpy(model->values, values, sizeof model->values);
    return 0;
}

const char *model_start(Model *model, double time)
{
    if (!isfinite(time))
        return "the start time must be finite";
    model->memory.time = time;
    return 0;
}

static double resonance(int number, double k_b)
{
    const double *row = RESONANCES + number * N_STIFFNESSES;
    double place = (log(k_b) - LOWEST_LN_K) / SPACING;
    place = fmax(0, fmin(N_STIFFNESSES - 1, place));
    const int at = place < N_STIFFNESSES - 1 ? (int)place : N_STIFFNESSES - 2;
    return row[at] + (place - at) * (row[at + 1] - row[at]);
}

/* How many resonances are below the speed that is wanted: counted when it changes, and not when the resonances move. */
static int resonances_below(Memory *m, double wanted)
{
    if (m->below >= 0 && m->wanted == wanted)
        return (int)m->below;
    m->wanted = wanted;
    for (m->below = 0; m->below < N_RESONANCES && resonance((int)m->below, m->k_b) < wanted;)
        m->below++;
    return (int)m->below;
}

/* The speed that is wanted, or the nearest one to it that keeps its distance between the same resonances. */
static double allowed(Memory *m, const double *values)
{
    const double wanted = values[SPEED_WANTED];
    if (!values[SUPERVISE] || m->k_b == 0) {
        m->below = -1;
        return wanted;
    }
    const int below = resonances_below(m, wanted);
    const double least = below ? resonance(below - 1, m->k_b) * (1 + values[MARGIN]) : 0;
    const double most = below < N_RESONANCES ? resonance(below, m->k_b) * (1 - values[MARGIN]) : INFINITY;
    return least > most ? (least + most) / 2 : fmax(least, fmin(most, wanted));
}

const char *model_step(Model *model, double time, double step)
{
    Memory *m = &model->memory;
    const double *values = model->values, most = values[ACCELERATION] * step, before = m->speed;
    if (values[VALID] && values[K_B] > 0)
        m->k_b = values[K_B];
    m->speed += fmax(-most, fmin(most, allowed(m, values) - m->speed));
    m->phase = fmod(m->phase + step * (before + m->speed) / 2, TURN);
    m->time = time + step;
    return 0;
}

int model_give_derivative(Model *model, int variable, double rate)
{
    (void)model, (void)variable, (void)rate;
    return 0;
}

static double nearest(const Memory *m)
{
    double found = 0;
    for (int k = 0; m->k_b > 0 && k < N_RESONANCES; k++) {
        const double here = resonance(k, m->k_b);
        if (!k || fabs(here - m->speed) < fabs(found - m->speed))
            found = here;
    }
    return found;
}

void model_outputs(const Model *model, double *outputs)
{
    const Memory *m = &model->memory;
    double probe = 0;
    for (int k = 0; model->values[PROBE] > 0 && k < N_LINES; k++)
        probe += sin(PROBE_FREQUENCY[k] * m->time + PROBE_PHASE[k]);
    outputs[0] = model->values[UNBALANCE_MOMENT] * m->speed * m->speed * sin(m->phase);
    outputs[0] += model->values[PROBE] * sqrt(2.0 / N_LINES) * probe;
    outputs[1] = m->speed;
    outputs[2] = nearest(m);
}

int model_state_size(const Model *model)
{
    (void)model;
    return STATE;
}

void model_save(const Model *model, double *state)
{
    memcpy(state, &model->memory, sizeof model->memory);
}

const char *model_restore(Model *model, const double *values, const double *state, int size)
{
    Memory memory;
    for (int k = 0; k < STATE && size == STATE; k++)
        if (!isfinite(state[k]))
            size = 0;
    if (size != STATE)
        return "this is not a state of this supervisor";
    memcpy(&memory, state, sizeof memory);
    if (memory.below < -1 || memory.below > N_RESONANCES || memory.k_b < 0)
        return "this is not a state of this supervisor";
    model->memory = memory;
    return model_accept(model, values);
}
