/* An FMU's instance, whatever the version of FMI: its values, what may be done when, and why something is refused. */
#ifndef RIGTWIN_INSTANCE_H
#define RIGTWIN_INSTANCE_H

#include "names.h"
#include "model.h"

#include <stddef.h>

typedef enum { INSTANTIATED, INITIALIZING, RUNNING, ENDED } Phase;

/* What an instance tells its host, by category. */
typedef enum { EVENTS, WARNINGS, ERRORS, N_CATEGORIES } Category;

typedef struct {
    Model *model;
    Phase phase;
    double time; /* [s] */
    double stop; /* of the experiment [s]; infinite where none was given */
    int told[N_CATEGORIES]; /* whether the host wants to hear of it */
    int stale;   /* whether the outputs are older than the state */
    double *values, *kept;
    char *name;
    char message[700]; /* of the last call that failed, or the last event */
} Instance;

/* Returns 0 without memory, or where the start values make no model. Errors and warnings are told from the start, events
   only where ``logging`` says so. */
Instance *instance_new(const char *name, int logging);
void instance_free(Instance *instance);

/* The functions below return 0, or a sentence where they fail; they have no effect then. */

/* Go back to where instance_new left it. */
const char *instance_reset(Instance *instance);

/* The time of the start, and that of the end: no step may go beyond it. */
const char *instance_start(Instance *instance, double time, int stop_defined, double stop);

const char *instance_enter_initialization(Instance *instance);
const char *instance_exit_initialization(Instance *instance);
const char *instance_step(Instance *instance, double time, double step);
const char *instance_end(Instance *instance);

/* The values, up to date, after a check that these (n) references are of a kind. */
const char *instance_read(Instance *instance, int kind, const unsigned *references, size_t n, const double **values);

/* Why a variable of a kind that no FMU has cannot be found. */
const char *instance_no_string(Instance *instance, const unsigned *references, size_t n);

/* Set the values (n) of some references; all or none. */
const char *instance_write(Instance *instance, int kind, const unsigned *references, size_t n, const double *values);

/* Take up the derivatives (n) of some inputs for the next step; ``ignored`` is the name of one that has no use for it,
   or 0. */
const char *instance_give_derivatives(Instance *instance, const unsigned *references, size_t n, const int *orders,
                                      const double *values, const char **ignored);

/* A sentence about an input whose derivative is ignored. */
const char *instance_held(Instance *instance, const char *input);

/* Tell or do not tell of these categories (n), of all where n is 0. */
const char *instance_choose_log(Instance *instance, int on, size_t n, const char *const *categories);

/* Name of a category. */
const char *category_name(Category category);

/* A sentence about what has happened; 0 where the host does not want to hear of it. */
const char *instance_event(Instance *instance, const char *what);

/* Keep the state of this instant, in place of the one that ``state`` points to; go back to one; and let one go. */
const char *instance_keep(Instance *instance, void **state);
const char *instance_go_back(Instance *instance, const void *state);
void instance_let_go(void **state);

/* A state's size in bytes, its bytes, and a state of bytes, which only going back to it can refuse. */
const char *instance_state_size(Instance *instance, const void *state, size_t *size);
const char *instance_state_bytes(Instance *instance, const void *state, void *bytes, size_t size);
const char *instance_state_of(Instance *instance, const void *bytes, size_t size, void **state);

#define NULL_ARGUMENT "an argument that is needed is a null pointer"

/* Keep a sentence of one's own as the instance's. */
const char *instance_refuse(Instance *instance, const char *sentence);

#endif
