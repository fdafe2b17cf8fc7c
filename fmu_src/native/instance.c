#include "instance.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NO_EFFECT ". The call has no effect; the instance is still usable."

static const char *const CATEGORIES[N_CATEGORIES] = {"logEvents", "logStatusWarning", "logStatusError"};

/* Largest excess of a step's end over the stop time: in steps, and relative to the time. */
#define SAME_STEP 1e-6
#define SAME_STOP 1e-9

/* A saved state starts with the GUID and these; the values and the model's state follow. */
enum { PHASE_AT = 5, TIME_AT, SETTINGS_AT, STATE_AT, HEADER };

static const char *refuse(Instance *s, const char *format, ...)
{
    va_list arguments;
    const size_t room = sizeof s->message;
    int used = snprintf(s->message, room, "%.100s: ", s->name);
    va_start(arguments, format);
    used += vsnprintf(s->message + used, room - (size_t)used, format, arguments);
    va_end(arguments);
    if ((size_t)used < room)
        snprintf(s->message + used, room - (size_t)used, NO_EFFECT);
    return s->message;
}

const char *instance_refuse(Instance *s, const char *sentence)
{
    return refuse(s, "%s", sentence);
}

/* -- life -------------------------------------------------------------------------------------------------------- */

static int begin(Instance *s)
{
    s->model = model_new();
    s->phase = INSTANTIATED;
    s->time = 0;
    s->stop = INFINITY;
    s->stale = 1;
    for (int i = 0; i < N_VARIABLES; i++)
        s->values[i] = VARIABLES[i].start;
    return s->model && !model_accept(s->model, s->values);
}

Instance *instance_new(const char *name, int logging)
{
    const size_t length = strlen(name) + 1;
    Instance *s = calloc(1, sizeof *s);
    if (!s)
        return 0;
    s->name = malloc(length);
    s->values = calloc(2 * (size_t)N_VARIABLES, sizeof *s->values);
    if (s->name && s->values) {
        memcpy(s->name, name, length);
        s->kept = s->values + N_VARIABLES;
        s->told[EVENTS] = logging;
        s->told[WARNINGS] = s->told[ERRORS] = 1;
        if (begin(s))
            return s;
    }
    instance_free(s);
    return 0;
}

void instance_free(Instance *s)
{
    if (!s)
        return;
    if (s->model)
        model_free(s->model);
    free(s->values);
    free(s->name);
    free(s);
}

const char *instance_reset(Instance *s)
{
    Model *before = s->model;
    memcpy(s->kept, s->values, (size_t)N_VARIABLES * sizeof *s->values);
    const Phase phase = s->phase;
    const double time = s->time, stop = s->stop;
    if (begin(s)) {
        model_free(before);
        return 0;
    }
    if (s->model)
        model_free(s->model);
    s->model = before;
    s->phase = phase;
    s->time = time, s->stop = stop;
    memcpy(s->values, s->kept, (size_t)N_VARIABLES * sizeof *s->values);
    return refuse(s, "there is no memory for a new start");
}

static const char *wrong_moment(Instance *s, const char *what)
{
    static const char *const WHEN[] = {"before the initialization", "during the initialization", "during the simulation",
                                       "after the end of the simulation"};
    return refuse(s, "%s is not possible %s", what, WHEN[s->phase]);
}

const char *instance_start(Instance *s, double time, int stop_defined, double stop)
{
    if (s->phase > INITIALIZING)
        return wrong_moment(s, "setting the start time");
    if (stop_defined && !(stop >= time))
        return refuse(s, "the stop time must not lie before the start time of %.9g s, got %.9g s", time, stop);
    const char *wrong = model_start(s->model, time);
    if (wrong)
        return refuse(s, "%s", wrong);
    s->time = time;
    s->stop = stop_defined ? stop : INFINITY;
    return 0;
}

const char *instance_enter_initialization(Instance *s)
{
    if (s->phase != INSTANTIATED)
        return wrong_moment(s, "entering the initialization");
    s->phase = INITIALIZING;
    return 0;
}

const char *instance_exit_initialization(Instance *s)
{
    if (s->phase != INITIALIZING)
        return wrong_moment(s, "leaving the initialization");
    s->phase = RUNNING;
    return 0;
}

const char *instance_step(Instance *s, double time, double step)
{
    if (s->phase != RUNNING)
        return wrong_moment(s, "a step");
    if (time + step - s->stop > SAME_STEP * fabs(step) + SAME_STOP * fmax(1, fabs(s->stop)))
        return refuse(s, "a step to %.9g s goes beyond the stop time of %.9g s", time + step, s->stop);
    if (!isfinite(time + step))
        return refuse(s, "the communication step must be finite, got %.9g s at %.9g s", step, time);
    if (!(step > 0))
        return refuse(s, "the communication step must be positive, got %.9g s", step);
    const char *wrong = model_step(s->model, time, step);
    if (wrong)
        return refuse(s, "%s", wrong);
    s->time = time + step;
    s->stale = 1;
    return 0;
}

const char *instance_end(Instance *s)
{
    if (s->phase != RUNNING)
        return wrong_moment(s, "ending the simulation");
    s->phase = ENDED;
    return 0;
}

/* -- values ------------------------------------------------------------------------------------------------------ */

static const char *check_reference(Instance *s, int kind, unsigned reference)
{
    static const char *const KINDS[] = {"Real", "Integer", "Boolean"};
    if (reference < (unsigned)N_VARIABLES && VARIABLES[reference].kind == kind)
        return 0;
    return refuse(s, "there is no %s variable with value reference %u", KINDS[kind], reference);
}

const char *instance_no_string(Instance *s, const unsigned *references, size_t n)
{
    if (n && !references)
        return refuse(s, NULL_ARGUMENT);
    return n ? refuse(s, "there is no String variable with value reference %u", references[0]) : 0;
}

const char *instance_read(Instance *s, int kind, const unsigned *references, size_t n, const double **values)
{
    for (size_t k = 0; k < n; k++) {
        const char *wrong = check_reference(s, kind, references[k]);
        if (wrong)
            return wrong;
    }
    if (s->stale)
        model_outputs(s->model, s->values + N_VARIABLES - N_OUTPUTS);
    s->stale = 0;
    *values = s->values;
    return 0;
}

/* Why a value cannot be that of a variable. */
static const char *check_value(Instance *s, const Variable *v, double value)
{
    const char *gap = v->unit[0] ? " " : "";
    if (!isfinite(value))
        return refuse(s, "%s must be a finite number, got %g", v->name, value);
    if (value < v->least)
        return refuse(s, "%s must be at least %g%s%s, got %g", v->name, v->least, gap, v->unit, value);
    if (value > v->most)
        return refuse(s, "%s must be at most %g%s%s, got %g", v->name, v->most, gap, v->unit, value);
    if (v->kind != REAL && value != rint(value))
        return refuse(s, "%s must be a whole number, got %g", v->name, value);
    return 0;
}

static const char *check_settable(Instance *s, const Variable *v, double value)
{
    if (v->role == OUTPUT)
        return refuse(s, "%s is an output and cannot be set", v->name);
    if (s->phase == ENDED)
        return refuse(s, "%s cannot be set after the end of the simulation", v->name);
    if (v->role == FIXED && s->phase > INITIALIZING)
        return refuse(s, "%s can only be set before the simulation starts", v->name);
    return check_value(s, v, value);
}

const char *instance_write(Instance *s, int kind, const unsigned *references, size_t n, const double *values)
{
    const char *wrong = 0;
    for (size_t k = 0; k < n && !wrong; k++) {
        wrong = check_reference(s, kind, references[k]);
        if (!wrong)
            wrong = check_settable(s, VARIABLES + references[k], values[k]);
    }
    if (wrong)
        return wrong;
    memcpy(s->kept, s->values, (size_t)N_VARIABLES * sizeof *s->values);
    for (size_t k = 0; k < n; k++)
        s->values[references[k]] = values[k];
    wrong = model_accept(s->model, s->values);
    if (wrong) {
        memcpy(s->values, s->kept, (size_t)N_VARIABLES * sizeof *s->values);
        return refuse(s, "%s", wrong);
    }
    s->stale = 1;
    return 0;
}

const char *instance_give_derivatives(Instance *s, const unsigned *references, size_t n, const int *orders,
                                      const double *values, const char **ignored)
{
    *ignored = 0;
    for (size_t k = 0; k < n; k++) {
        const char *wrong = check_reference(s, REAL, references[k]);
        if (wrong)
            return wrong;
        const Variable *v = VARIABLES + references[k];
        if (v->role != INPUT)
            return refuse(s, "%s is no input: it takes no derivative", v->name);
        if (orders[k] != 1)
            return refuse(s, "%s takes its first derivative only, got order %d", v->name, orders[k]);
        if (!isfinite(values[k]))
            return refuse(s, "the derivative of %s must be a finite number, got %g", v->name, values[k]);
    }
    for (size_t k = 0; k < n; k++)
        if (!model_give_derivative(s->model, (int)references[k], values[k]) && values[k] != 0)
            *ignored = VARIABLES[references[k]].name;
    return 0;
}

const char *instance_held(Instance *s, const char *input)
{
    snprintf(s->message, sizeof s->message, "%.100s: %s is held over a step: its derivative has no effect", s->name, input);
    return s->message;
}

/* -- what the host hears ----------------------------------------------------------------------------------------- */

const char *category_name(Category category)
{
    return CATEGORIES[category];
}

const char *instance_choose_log(Instance *s, int on, size_t n, const char *const *categories)
{
    if (n && !categories)
        return refuse(s, NULL_ARGUMENT);
    for (size_t k = 0; k < n; k++) {
        int known = 0;
        for (int c = 0; c < N_CATEGORIES; c++)
            known |= categories[k] && !strcmp(categories[k], CATEGORIES[c]);
        if (!known)
            return refuse(s, "there is no log category %.50s", categories[k] ? categories[k] : "without a name");
    }
    for (int c = 0; c < N_CATEGORIES; c++) {
        int meant = !n;
        for (size_t k = 0; k < n; k++)
            meant |= !strcmp(categories[k], CATEGORIES[c]);
        if (meant)
            s->told[c] = on;
    }
    return 0;
}

const char *instance_event(Instance *s, const char *what)
{
    if (!s->told[EVENTS])
        return 0;
    snprintf(s->message, sizeof s->message, "%.100s: %s at %.9g s", s->name, what, s->time);
    return s->message;
}

/* -- states ------------------------------------------------------------------------------------------------------ */

static int n_settings(void)
{
    return N_VARIABLES - N_OUTPUTS;
}

static void save(const Instance *s, double *content)
{
    memset(content, 0, HEADER * sizeof *content);
    memcpy(content, MODEL_GUID, strlen(MODEL_GUID));
    content[PHASE_AT] = s->phase;
    content[TIME_AT] = s->time;
    content[SETTINGS_AT] = n_settings();
    content[STATE_AT] = model_state_size(s->model);
    memcpy(content + HEADER, s->values, (size_t)n_settings() * sizeof *content);
    model_save(s->model, content + HEADER + n_settings());
}

/* Whether these bytes are a state at all, for these variables. */
static int is_state(const double *content, size_t size)
{
    if (size < (HEADER + (size_t)n_settings()) * sizeof *content || size % sizeof *content)
        return 0;
    if (memcmp(content, MODEL_GUID, strlen(MODEL_GUID)))
        return 0;
    const size_t left = size / sizeof *content - HEADER - (size_t)n_settings();
    const double phase = content[PHASE_AT];
    if (!(phase == INSTANTIATED || phase == INITIALIZING || phase == RUNNING || phase == ENDED))
        return 0;
    if (content[SETTINGS_AT] != n_settings() || content[STATE_AT] != (double)left || !isfinite(content[TIME_AT]))
        return 0;
    for (size_t i = 0; i < left; i++)
        if (!isfinite(content[HEADER + n_settings() + i]))
            return 0;
    return 1;
}

static const char *restore(Instance *s, const double *content, size_t size)
{
    if (!is_state(content, size))
        return refuse(s, "this is not a state that this FMU saved");
    const double *values = content + HEADER, *state = values + n_settings();
    for (int i = 0; i < n_settings(); i++) {
        const char *wrong = check_value(s, VARIABLES + i, values[i]);
        if (wrong)
            return wrong;
    }
    const char *wrong = model_restore(s->model, values, state, (int)content[STATE_AT]);
    if (wrong)
        return refuse(s, "%s", wrong);
    memcpy(s->values, values, (size_t)n_settings() * sizeof *values);
    s->phase = (Phase)(int)content[PHASE_AT];
    s->time = content[TIME_AT];
    s->stale = 1;
    return 0;
}

/* What FMI's FMU states point to. */
typedef struct {
    size_t size; /* [bytes] */
    double *content;
} Saved;

static Saved *new_saved(size_t size)
{
    Saved *saved = malloc(sizeof *saved);
    if (!saved)
        return 0;
    saved->size = size;
    saved->content = calloc(size / sizeof(double) + 1, sizeof(double));
    if (saved->content)
        return saved;
    free(saved);
    return 0;
}

void instance_let_go(void **state)
{
    Saved *saved = *state;
    if (saved)
        free(saved->content);
    free(saved);
    *state = 0;
}

const char *instance_keep(Instance *s, void **state)
{
    const int doubles = HEADER + n_settings() + model_state_size(s->model);
    Saved *saved = new_saved((size_t)doubles * sizeof(double));
    if (!saved)
        return refuse(s, "there is no memory for a state");
    save(s, saved->content);
    instance_let_go(state);
    *state = saved;
    return 0;
}

const char *instance_go_back(Instance *s, const void *state)
{
    const Saved *saved = state;
    return saved ? restore(s, saved->content, saved->size) : refuse(s, "there is no state to go back to");
}

const char *instance_state_size(Instance *s, const void *state, size_t *size)
{
    if (!state || !size)
        return refuse(s, "there is no state to serialize");
    *size = ((const Saved *)state)->size;
    return 0;
}

const char *instance_state_bytes(Instance *s, const void *state, void *bytes, size_t size)
{
    const Saved *saved = state;
    if (!saved || !bytes)
        return refuse(s, "there is no state to serialize");
    if (size < saved->size)
        return refuse(s, "the state is larger than the room for it");
    memcpy(bytes, saved->content, saved->size);
    return 0;
}

const char *instance_state_of(Instance *s, const void *bytes, size_t size, void **state)
{
    if (!bytes || !state)
        return refuse(s, "there is no state to read");
    Saved *saved = new_saved(size);
    if (!saved)
        return refuse(s, "there is no memory for a state");
    memcpy(saved->content, bytes, size);
    instance_let_go(state);
    *state = saved;
    return 0;
}
