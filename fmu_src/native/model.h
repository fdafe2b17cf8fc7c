/* What an FMU is, apart from FMI: its variables, and the model behind them. variables.c is printed when the FMU is
   built; a model is rotor_model.c or estimator_model.c. */
#ifndef RIGTWIN_MODEL_H
#define RIGTWIN_MODEL_H

#include "names.h"

enum { REAL, INTEGER, BOOLEAN };
enum { INPUT, TUNABLE, FIXED, OUTPUT };

/* Its value reference is its place in the table; outputs are the last ones. */
typedef struct {
    const char *name, *unit;
    int kind, role;
    double start, least, most;
} Variable;

/* Outputs beside each other, once more as one array; its value reference is its place after the variables. */
typedef struct {
    int first, length;
} Array;

extern const char MODEL_NAME[], MODEL_GUID[];
extern const Variable VARIABLES[];
extern const Array ARRAYS[];
extern const int N_VARIABLES, N_OUTPUTS, N_ARRAYS;

typedef struct Model Model;

/* A model at its start values; 0 without memory. All memory that it will ever need is taken here. */
Model *model_new(void);
void model_free(Model *model);

/* The functions below return a sentence where they fail, and nothing is changed then; 0 otherwise. */

/* Take up the values (N_VARIABLES) of inputs and parameters. */
const char *model_accept(Model *model, const double *values);

/* The time [s] of a model that has not moved yet. */
const char *model_start(Model *model, double time);

/* A step of a positive, finite length. */
const char *model_step(Model *model, double time, double step);

/* Take up the rate of a Real input at this instant, for the next step; whether the model has a use for it. */
int model_give_derivative(Model *model, int variable, double rate);

/* (N_OUTPUTS) */
void model_outputs(const Model *model, double *outputs);

/* What it remembers, as doubles. */
int model_state_size(const Model *model);
void model_save(const Model *model, double *state);

/* Go back to a state of ``size`` doubles that was saved under these values. */
const char *model_restore(Model *model, const double *values, const double *state, int size);

#endif
