/* The tracker behind StiffnessTracker's variables. Mirrors fmu_src/tracker_slave.py. */
#include "model.h"
#include "tracker.h"
#include "tracker_network.h"
#include "tracker_variables.h"

#include "constants.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* reduced.c is printed for a rotor when the FMU is built. */
extern const ReducedRotor REDUCED;

struct Model {
    Tracker *tracker;
    NetworkTracker *network; /* 0: none knows the rig */
    Belief belief;
    int method;
    double inputs[1 + MOST_SENSORS];
};

Model *model_new(void)
{
    static const int nodes[] = SENSOR_NODES;
    Model *model = calloc(1, sizeof *model);
    if (!model)
        return 0;
    model->tracker = tracker_new(&REDUCED, N_SENSORS, nodes);
    model->network = HAS_NETWORK ? network_tracker_new() : 0;
    if (!model->tracker || (HAS_NETWORK && !model->network)) {
        model_free(model);
        return 0;
    }
    return model;
}

void model_free(Model *model)
{
    if (model->tracker)
        tracker_free(model->tracker);
    network_tracker_free(model->network);
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

/* Why the method cannot be; 0 where it can. */
static const char *refusal(const double *values)
{
    if (values[METHOD] == KALMAN_FILTER)
        return 0;
    return !HAS_NETWORK ? NO_NETWORK : values[EXCITATION_NODE] != network_tracker_node() ? OTHER_NODE : 0;
}

/* The parameters have changed: begin anew. */
static void begin(Model *model)
{
    if (model->method == KALMAN_FILTER)
        tracker_start(model->tracker, &model->belief);
    else
        network_tracker_start(model->network, model->belief.start[STIFFNESS], model->belief.std[STIFFNESS]);
}

const char *model_accept(Model *model, const double *values)
{
    Belief belief;
    const char *why = refusal(values);
    if (why)
        return why;
    believe(values, &belief);
    if (memcmp(&belief, &model->belief, sizeof belief) || model->method != (int)values[METHOD]) {
        memcpy(&model->belief, &belief, sizeof belief);
        model->method = (int)values[METHOD];
        begin(model);
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
    if (model->method != KALMAN_FILTER)
        return network_tracker_step(model->network, step, model->inputs);
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
    const int filter = model->method == KALMAN_FILTER;
    const double k_b = filter ? tracker_stiffness(model->tracker) : exp(network_tracker_ln_k(model->network));
    const double error = filter ? tracker_error(model->tracker) : network_tracker_error(model->network);
    outputs[0] = k_b;
    outputs[1] = k_b * exp(-Z90 * error);
    outputs[2] = k_b * exp(Z90 * error);
    outputs[3] = filter ? tracker_valid(model->tracker) : network_tracker_valid(model->network);
}

int model_state_size(const Model *model)
{
    return model->method == KALMAN_FILTER ? tracker_size() : network_tracker_size();
}

void model_save(const Model *model, double *state)
{
    if (model->method == KALMAN_FILTER)
        tracker_save(model->tracker, state);
    else
        network_tracker_save(model->network, state);
}

const char *model_restore(Model *model, const double *values, const double *state, int size)
{
    static const char other[] = "this is not a state of this tracker";
    Belief belief;
    const int filter = values[METHOD] == KALMAN_FILTER;
    if (refusal(values))
        return other;
    believe(values, &belief);
    if (size != (filter ? tracker_size() : network_tracker_size()))
        return other;
    if (filter ? tracker_restore(model->tracker, &belief, state) : network_tracker_restore(model->network, state))
        return other;
    model->method = (int)values[METHOD];
    memcpy(&model->belief, &belief, sizeof belief);
    memcpy(model->inputs, values, sizeof(double) * (1 + N_SENSORS));
    return 0;
}
