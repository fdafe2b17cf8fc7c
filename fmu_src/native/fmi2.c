/* FMI 2.0 for co-simulation. */
#include "instance.h"

#include "fmi2Functions.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
    Instance *instance;
    fmi2CallbackFunctions host;
    double *converted; /* values of a set call, as doubles */
} Slave;

/* The sentence is the format itself, its percent signs doubled: not every host hands on what follows a format. */
static void say(const fmi2CallbackFunctions *host, const char *name, fmi2Status status, Category category,
                const char *sentence)
{
    char format[2 * sizeof ((Instance *)0)->message];
    size_t used = 0;
    for (; *sentence && used < sizeof format - 2; sentence++) {
        if (*sentence == '%')
            format[used++] = '%';
        format[used++] = *sentence;
    }
    format[used] = 0;
    if (host->logger)
        host->logger(host->componentEnvironment, name, status, category_name(category), format);
}

static fmi2Status result(const Slave *s, const char *wrong)
{
    if (wrong && s->instance->told[ERRORS])
        say(&s->host, s->instance->name, fmi2Error, ERRORS, wrong);
    return wrong ? fmi2Error : fmi2OK;
}

/* The same of a call that begins or ends something. */
static fmi2Status event(const Slave *s, const char *wrong, const char *what)
{
    const char *sentence = wrong ? 0 : instance_event(s->instance, what);
    if (sentence)
        say(&s->host, s->instance->name, fmi2OK, EVENTS, sentence);
    return result(s, wrong);
}

static fmi2Status refused(fmi2Component c, const char *sentence)
{
    const Slave *s = c;
    return s ? result(s, instance_refuse(s->instance, sentence)) : fmi2Error;
}

/* -- life -------------------------------------------------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources, (void)visible;
    if (!host)
        return 0;
    if (!name || !guid || type != fmi2CoSimulation || strcmp(guid, MODEL_GUID)) {
        say(host, name ? name : MODEL_NAME, fmi2Error, ERRORS,
            !name                      ? "an instance needs a name"
            : type != fmi2CoSimulation ? "this FMU is for co-simulation only"
                                       : "the GUID is not that of this FMU: its binary and its model description "
                                         "come from different builds");
        return 0;
    }
    Slave *s = calloc(1, sizeof *s);
    if (s) {
        s->host = *host;
        s->instance = instance_new(name, logging != fmi2False);
        s->converted = calloc((size_t)N_VARIABLES, sizeof *s->converted);
    }
    if (!s || !s->instance || !s->converted) {
        say(host, name, fmi2Error, ERRORS, "there is no memory for an instance, or its start values make no model");
        fmi2FreeInstance(s);
        return 0;
    }
    return s;
}

void fmi2FreeInstance(fmi2Component c)
{
    Slave *s = c;
    if (!s)
        return;
    instance_free(s->instance);
    free(s->converted);
    free(s);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    Slave *s = c;
    return s ? result(s, instance_choose_log(s->instance, on != fmi2False, n, categories)) : fmi2Error;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)tolerance_defined, (void)tolerance;
    Slave *s = c;
    return s ? result(s, instance_start(s->instance, start, stop_defined != fmi2False, stop)) : fmi2Error;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    Slave *s = c;
    return s ? result(s, instance_enter_initialization(s->instance)) : fmi2Error;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Slave *s = c;
    return s ? event(s, instance_exit_initialization(s->instance), "the simulation starts") : fmi2Error;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    Slave *s = c;
    return s ? event(s, instance_end(s->instance), "the simulation ends") : fmi2Error;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    Slave *s = c;
    return s ? event(s, instance_reset(s->instance), "everything is reset") : fmi2Error;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_return)
{
    (void)no_return;
    Slave *s = c;
    return s ? result(s, instance_step(s->instance, time, step)) : fmi2Error;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return refused(c, "there is no step to cancel: they are all done when doStep returns");
}

/* -- values ------------------------------------------------------------------------------------------------------ */

static const double *read(fmi2Component c, int kind, const fmi2ValueReference *references, size_t n, const void *to,
                          fmi2Status *status)
{
    Slave *s = c;
    const double *values = 0;
    if (!s || (n && (!references || !to)))
        *status = refused(c, NULL_ARGUMENT);
    else
        *status = result(s, instance_read(s->instance, kind, references, n, &values));
    return *status == fmi2OK ? values : 0;
}

#define GET(name, type, kind)                                                                                     \
    fmi2Status name(fmi2Component c, const fmi2ValueReference references[], size_t n, type to[])                      \
    {                                                                                                                 \
        fmi2Status status;                                                                                            \
        const double *values = read(c, kind, references, n, to, &status);                                             \
        for (size_t k = 0; values && k < n; k++)                                                                      \
            to[k] = (type)values[references[k]];                                                                      \
        return status;                                                                                                \
    }

GET(fmi2GetReal, fmi2Real, REAL)
GET(fmi2GetInteger, fmi2Integer, INTEGER)
GET(fmi2GetBoolean, fmi2Boolean, BOOLEAN)

static fmi2Status write(Slave *s, int kind, const fmi2ValueReference *references, size_t n, const double *values)
{
    return result(s, instance_write(s->instance, kind, references, n, values));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2Real values[])
{
    return c && (!n || (references && values)) ? write(c, REAL, references, n, values) : refused(c, NULL_ARGUMENT);
}

#define SET(name, type, kind, as_double)                                                                              \
    fmi2Status name(fmi2Component c, const fmi2ValueReference references[], size_t n, const type values[])            \
    {                                                                                                                 \
        Slave *s = c;                                                                                                 \
        if (!s || (n && (!references || !values)))                                                                    \
            return refused(c, NULL_ARGUMENT);                                                                         \
        if (n > (size_t)N_VARIABLES)                                                                                  \
            return refused(c, "these are more values than there are variables");                                      \
        for (size_t k = 0; k < n; k++)                                                                                \
            s->converted[k] = as_double(values[k]);                                                                   \
        return write(s, kind, references, n, s->converted);                                                           \
    }

#define WHOLE(value) (double)(value)
#define TRUTH(value) ((value) ? 1.0 : 0.0)

SET(fmi2SetInteger, fmi2Integer, INTEGER, WHOLE)
SET(fmi2SetBoolean, fmi2Boolean, BOOLEAN, TRUTH)

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference references[], size_t n, fmi2String to[])
{
    (void)to;
    Slave *s = c;
    return s ? result(s, instance_no_string(s->instance, references, n)) : fmi2Error;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2String values[])
{
    (void)values;
    Slave *s = c;
    return s ? result(s, instance_no_string(s->instance, references, n)) : fmi2Error;
}

/* -- states ------------------------------------------------------------------------------------------------------ */

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (c && state)
        instance_let_go(state);
    return c ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Slave *s = c;
    return s && state ? result(s, instance_keep(s->instance, state)) : refused(c, NULL_ARGUMENT);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    Slave *s = c;
    return s ? result(s, instance_go_back(s->instance, state)) : fmi2Error;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    Slave *s = c;
    return s ? result(s, instance_state_size(s->instance, state, size)) : fmi2Error;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    Slave *s = c;
    return s ? result(s, instance_state_bytes(s->instance, state, bytes, size)) : fmi2Error;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    Slave *s = c;
    return s ? result(s, instance_state_of(s->instance, bytes, size, state)) : fmi2Error;
}

/* -- what a co-simulation slave may leave out -------------------------------------------------------------------- */

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real d_known[],
                                        fmi2Real d_unknown[])
{
    (void)unknown, (void)n_unknown, (void)known, (void)n_known, (void)d_known, (void)d_unknown;
    return refused(c, "there are no directional derivatives");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference references[], size_t n,
                                       const fmi2Integer order[], const fmi2Real values[])
{
    Slave *s = c;
    const char *ignored;
    if (!s || (n && (!references || !order || !values)))
        return refused(c, NULL_ARGUMENT);
    const char *wrong = instance_give_derivatives(s->instance, references, n, order, values, &ignored);
    if (wrong || !ignored)
        return result(s, wrong);
    if (s->instance->told[WARNINGS])
        say(&s->host, s->instance->name, fmi2Warning, WARNINGS, instance_held(s->instance, ignored));
    return fmi2Warning;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference references[], size_t n,
                                        const fmi2Integer order[], fmi2Real to[])
{
    (void)references, (void)n, (void)order, (void)to;
    return refused(c, "there are no output derivatives");
}

static fmi2Status never_pending(fmi2Component c)
{
    return c && refused(c, "there is no status to ask for: steps are done when doStep returns") ? fmi2Discard : fmi2Error;
}

#define NEVER_PENDING(name, type)                                                                                     \
    fmi2Status name(fmi2Component c, const fmi2StatusKind kind, type *to)                                             \
    {                                                                                                                 \
        (void)kind, (void)to;                                                                                         \
        return never_pending(c);                                                                                      \
    }

NEVER_PENDING(fmi2GetStatus, fmi2Status)
NEVER_PENDING(fmi2GetRealStatus, fmi2Real)
NEVER_PENDING(fmi2GetIntegerStatus, fmi2Integer)
NEVER_PENDING(fmi2GetBooleanStatus, fmi2Boolean)
NEVER_PENDING(fmi2GetStringStatus, fmi2String)
