/* The stiffness behind SofteningBearing's variables. */
#include "model.h"

#include "machine_variables.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct Model {
    double time, values[N_VALUES];
};

Model *model_new(void)
{
    return calloc(1, sizeof(Model));
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
    model->time = time;
    return 0;
}

const char *model_step(Model *model, double time, double step)
{
    model->time = time + step;
    return 0;
}

int model_give_derivative(Model *model, int variable, double rate)
{
    (void)model, (void)variable, (void)rate;
    return 0;
}

void model_outputs(const Model *model, double *outputs)
{
    const double *values = model->values, every = values[CHANGE_EVERY];
    double since = model->time - values[CHANGE_AT];
    if (every > 0)
        since = floor(since / every * (1 + 1e-12)) * every;
    const double share = since <= 0 ? 0 : since >= values[CHANGE_FOR] ? 1 : since / values[CHANGE_FOR];
    outputs[0] = values[K_B_START] * pow(values[K_B_END] / values[K_B_START], share);
}

int model_state_size(const Model *model)
{
    (void)model;
    return 1;
}

void model_save(const Model *model, double *state)
{
    state[0] = model->time;
}

const char *model_restore(Model *model, const double *values, const double *state, int size)
{
    if (size != 1 || !isfinite(state[0]))
        return "this is not a state of this bearing";
    model->time = state[0];
    return model_accept(model, values);
}
