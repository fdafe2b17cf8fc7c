/* The rotor behind RotorRig's variables. Mirrors fmu_src/rotor_slave.py. */
#include "rotor_model.h"

#include "model.h"
#include "simulator.h"

#include <stdlib.h>
#include <string.h>

struct Model {
    Simulator *simulator;
    Design design;
};

Model *model_new(void)
{
    Model *model = calloc(1, sizeof *model);
    if (model)
        model->simulator = simulator_new(&STRUCTURE);
    if (model && !model->simulator) {
        free(model);
        return 0;
    }
    return model;
}

void model_free(Model *model)
{
    simulator_free(model->simulator);
    free(model);
}

static void drive(Model *model, const double *values)
{
    simulator_hold(model->simulator, values[HELD_FORCE] != 0);
    simulator_drive(model->simulator, values[FORCE], values[FORCE_AMPLITUDE], values[FORCE_FREQUENCY]);
}

const char *model_accept(Model *model, const double *values)
{
    Design design;
    design_of(values, &design);
    if (memcmp(&design, &model->design, sizeof design)) {
        const char *wrong = simulator_configure(model->simulator, &design);
        if (wrong)
            return wrong;
        memcpy(&model->design, &design, sizeof design);
    }
    drive(model, values);
    return 0;
}

const char *model_start(Model *model, double time)
{
    return simulator_start_at(model->simulator, time);
}

const char *model_step(Model *model, double time, double step)
{
    return simulator_advance(model->simulator, time, step);
}

int model_give_derivative(Model *model, int variable, double rate)
{
    if (variable == FORCE)
        simulator_give_rate(model->simulator, rate);
    return variable == FORCE;
}

void model_outputs(const Model *model, double *outputs)
{
    simulator_accelerations(model->simulator, outputs);
    outputs[N_OUTPUTS - 1] = simulator_force(model->simulator);
}

int model_state_size(const Model *model)
{
    return simulator_snapshot_size(model->simulator);
}

void model_save(const Model *model, double *state)
{
    simulator_save(model->simulator, state);
}

const char *model_restore(Model *model, const double *values, const double *state, int size)
{
    Design design;
    design_of(values, &design);
    const char *wrong = simulator_restore(model->simulator, &design, state, size);
    if (wrong)
        return wrong;
    memcpy(&model->design, &design, sizeof design);
    return 0;
}
