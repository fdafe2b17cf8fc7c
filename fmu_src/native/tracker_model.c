/* The tracker behind StiffnessTracker's variables. Mirrors fmu_src/tracker_slave.py. */
#include "model.h"
#include "tracker.h"
#include "tracker_variables.h"

#include "constants.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* reduced.c is printed for a rotor when the FMU is built. */
extern const ReducedRotor REDUCED;

struct Model {
    Tracker *tracker;
    Belief belief;
    double inputs[1 + MOST_SENSORS];
};

Model *model_new(void)
{
    static const int nodes[] = SENSOR_NODES;
    Model *model = calloc(1, sizeof *model);
    if (model)
        model->tracker = tracker_new(&REDUCED, N_SENSORS, nodes);
    if (model && !model->tracker) {
        free(model);
        return 0;
    }
    return model;
}

void model_free(Model *model)
{
    tracker_free(model->tracker);
    free(model);
}

static void believe(const double *values, Belief *belief)
{
    memset(belief, 0, sizeof *belief); /* beliefs are compared byte by byte */
    belief->start[STIFFNESS] = log(values[K_B_START]);
    belief->start[BEARING_DAMPING] = log(values[BEARING_DAMPING_AT]);
    belief->start[SHAFT_DAMPING] = log(values[SHAFT_DAMPING_RATIO]);
    belief->std[STIFFNESS] = values[K_B_START_STD];
    belief->std[DISK_MASS] = values[DISK_MASS_STD];
    belief->std[BEARING_DAMPING] = values[BEARING_DAMPING_STD];
    belief->std[SHAFT_DAMPING] = values[SHAFT_DAMPING_STD];
    belief->std[GAIN] = values[GAIN_STD];
    belief->walk = values[K_B_CHANGE];
    belief->noise = values[ACCELERATION_STD];
    belief->driven = (int)values[EXCITATION_NODE] - 1;
}

const char *model_accept(Model *model, const double *values)
{
    Belief belief;
    if (values[METHOD] != KALMAN_FILTER)
        return NO_NETWORK;
    believe(values, &belief);
    if (memcmp(&belief, &model->belief, sizeof belief)) {
        tracker_start(model->tracker, &belief);
        memcpy(&model->belief, &belief, sizeof belief);
    }
    memcpy(model->inputs, values, sizeof(double) * (1 + N_SENSORS));
    return 0;
}

const char *model_start(Model *model, double time)
{
    (void)model;
    return isfinite(time) ? 0 : "the start time must be finite";
}

const char *model_step(Model *model, double time, double step)
{
    (void)time;
    tracker_step(model->tracker, step, model->inputs[0], model->inputs + 1);
    return 0;
}

int model_give_derivative(Model *model, int variable, double rate)
{
    (void)model, (void)variable, (void)rate;
    return 0;
}

void model_outputs(const Model *model, double *outputs)
{
    const double k_b = tracker_stiffness(model->tracker), error = tracker_error(model->tracker);
    outputs[0] = k_b;
    outputs[1] = k_b * exp(-Z90 * error);
    outputs[2] = k_b * exp(Z90 * error);
    outputs[3] = tracker_valid(model->tracker);
}

int model_state_size(const Model *model)
{
    (void)model;
    return tracker_size();
}

void model_save(const Model *model, double *state)
{
    tracker_save(model->tracker, state);
}

const char *model_restore(Model *model, const double *values, const double *state, int size)
{
    Belief belief;
    believe(values, &belief);
    if (size != tracker_size() || tracker_restore(model->tracker, &belief, state))
        return "this is not a state of this tracker";
    memcpy(&model->belief, &belief, sizeof belief);
    memcpy(model->inputs, values, sizeof(double) * (1 + N_SENSORS));
    return 0;
}
