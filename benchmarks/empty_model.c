/* A model that does nothing. */
#include "model.h"

#include <stdlib.h>
#include <string.h>

struct Model {
    int nothing;
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
    (void)model, (void)values;
    return 0;
}

const char *model_start(Model *model, double time)
{
    (void)model, (void)time;
    return 0;
}

const char *model_step(Model *model, double time, double step)
{
    (void)model, (void)time, (void)step;
    return 0;
}

void model_outputs(const Model *model, double *outputs)
{
    (void)model;
    memset(outputs, 0, (size_t)N_OUTPUTS * sizeof *outputs);
}

int model_state_size(const Model *model)
{
    (void)model;
    return 0;
}

void model_save(const Model *model, double *state)
{
    (void)model, (void)state;
}

const char *model_restore(Model *model, const double *values, const double *state, int size)
{
    (void)model, (void)values, (void)state, (void)size;
    return 0;
}
