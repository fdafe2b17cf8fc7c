/* The monitor behind GapMonitor's variables. Mirrors fmu_src/monitor_slave.py. */
#include "model.h"
#include "monitor.h"
#include "monitor_variables.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* reduced.c is printed for a rotor when the FMU is built. */
extern const ReducedRotor REDUCED;

typedef struct {
    Belief belief;
    double alarm_every, learning;
} Settings;

struct Model {
    Monitor *monitor;
    Settings settings;
    double inputs[1 + N_SENSORS], k_b;
};

Model *model_new(void)
{
    Model *model = calloc(1, sizeof *model);
    if (model)
        model->monitor = monitor_new(&REDUCED);
    if (model && !model->monitor) {
        free(model);
        return 0;
    }
    return model;
}

void model_free(Model *model)
{
    monitor_free(model->monitor);
    free(model);
}

static void settle(const double *values, Settings *to)
{
    memset(to, 0, sizeof *to); /* settings are compared byte by byte */
    Belief *belief = &to->belief;
    belief->start[STIFFNESS] = log(values[K_B]);
    belief->start[BEARING_DAMPING] = log(values[BEARING_DAMPING_AT]);
    belief->start[SHAFT_DAMPING] = log(values[SHAFT_DAMPING_RATIO]);
    belief->std[STIFFNESS] = values[K_B_STD];
    belief->std[DISK_MASS] = values[DISK_MASS_STD];
    belief->std[BEARING_DAMPING] = values[BEARING_DAMPING_STD];
    belief->std[SHAFT_DAMPING] = values[SHAFT_DAMPING_STD];
    belief->std[GAIN] = values[GAIN_STD];
    belief->walk = WALK;
    belief->noise = values[ACCELERATION_STD];
    belief->driven = (int)values[EXCITATION_NODE] - 1;
    to->alarm_every = values[ALARM_EVERY];
    to->learning = values[LEARNING_TIME];
}

const char *model_accept(Model *model, const double *values)
{
    Settings settings;
    settle(values, &settings);
    const double k_b = settings.belief.start[STIFFNESS];
    settings.belief.start[STIFFNESS] = 0; /* an input, which may change */
    if (memcmp(&settings, &model->settings, sizeof settings)) {
        model->settings = settings;
        settings.belief.start[STIFFNESS] = k_b;
        monitor_start(model->monitor, &settings.belief, settings.alarm_every, settings.learning);
    }
    memcpy(model->inputs, values, sizeof model->inputs);
    model->k_b = values[K_B];
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
    monitor_step(model->monitor, step, model->inputs[0], model->inputs + 1, model->k_b);
    return 0;
}

int model_give_derivative(Model *model, int variable, double rate)
{
    (void)model, (void)variable, (void)rate;
    return 0;
}

void model_outputs(const Model *model, double *outputs)
{
    outputs[0] = monitor_drift(model->monitor);
    outputs[1] = monitor_alarm(model->monitor);
    outputs[2] = monitor_cause(model->monitor);
    outputs[3] = monitor_stiffness(model->monitor, model->k_b);
}

int model_state_size(const Model *model)
{
    (void)model;
    return monitor_size();
}

void model_save(const Model *model, double *state)
{
    monitor_save(model->monitor, state);
}

const char *model_restore(Model *model, const double *values, const double *state, int size)
{
    Settings settings;
    settle(values, &settings);
    if (size != monitor_size() ||
        monitor_restore(model->monitor, &settings.belief, settings.alarm_every, settings.learning, state))
        return "this is not a state of this monitor";
    settings.belief.start[STIFFNESS] = 0;
    model->settings = settings;
    memcpy(model->inputs, values, sizeof model->inputs);
    model->k_b = values[K_B];
    return 0;
}
