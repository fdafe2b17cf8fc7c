/* The network behind StiffnessEstimator's variables. Mirrors fmu_src/estimator_slave.py. */
#include "model.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#define N_FEATURES 6
#define N_ANSWERS 5

/* network.c is printed from the ONNX file when the FMU is built. */
void network(const float *features, float *estimate);

struct Model {
    float features[N_FEATURES];
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
    for (int k = 0; k < N_FEATURES; k++)
        model->features[k] = (float)fmax(-FLT_MAX, fmin(FLT_MAX, values[k]));
    return 0;
}

const char *model_start(Model *model, double time)
{
    (void)model;
    return isfinite(time) ? 0 : "the start time must be finite";
}

const char *model_step(Model *model, double time, double step)
{
    (void)model, (void)time, (void)step;
    return 0;
}

int model_give_derivative(Model *model, int variable, double rate)
{
    (void)model, (void)variable, (void)rate;
    return 0;
}

void model_outputs(const Model *model, double *outputs)
{
    float estimate[N_ANSWERS];
    network(model->features, estimate);
    for (int k = 0; k < N_ANSWERS - 1; k++)
        outputs[k] = estimate[k];
    outputs[N_ANSWERS - 1] = estimate[N_ANSWERS - 1] > 0.5f;
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
    (void)state;
    return size ? "this is not a state of this estimator" : model_accept(model, values);
}
