/* FMI 3.0 for co-simulation. */
#include "instance.h"

#include "fmi3Functions.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
    Instance *instance;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    double *converted; /* values of a set call, as doubles */
} Slave;

static void say(fmi3LogMessageCallback log, fmi3InstanceEnvironment environment, fmi3Status status, Category category,
                const char *sentence)
{
    if (log)
        log(environment, status, category_name(category), sentence);
}

static fmi3Status result(const Slave *s, const char *wrong)
{
    if (wrong && s->instance->told[ERRORS])
        say(s->log, s->environment, fmi3Error, ERRORS, wrong);
    return wrong ? fmi3Error : fmi3OK;
}

/* The same of a call that begins or ends something. */
static fmi3Status event(const Slave *s, const char *wrong, const char *what)
{
    const char *sentence = wrong ? 0 : instance_event(s->instance, what);
    if (sentence)
        say(s->log, s->environment, fmi3OK, EVENTS, sentence);
    return result(s, wrong);
}

static fmi3Status refused(fmi3Instance instance, const char *sentence)
{
    const Slave *s = instance;
    return s ? result(s, instance_refuse(s->instance, sentence)) : fmi3Error;
}

/* -- life -------------------------------------------------------------------------------------------------------- */

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

/* Whether a token is the GUID, in braces. */
static int is_token(const char *token)
{
    const size_t length = strlen(MODEL_GUID);
    return token && strlen(token) == length + 2 && token[0] == '{' && token[length + 1] == '}' &&
           !strncmp(token + 1, MODEL_GUID, length);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    (void)resources, (void)visible, (void)early_return, (void)intermediate, (void)update;
    if (!name || !is_token(token) || event_mode || n_intermediate) {
        say(log, environment, fmi3Error, ERRORS,
            !name              ? "an instance needs a name"
            : !is_token(token) ? "the instantiation token is not that of this FMU: its binary and its model description "
                                 "come from different builds"
                               : "this FMU has neither an event mode nor intermediate values");
        return 0;
    }
    Slave *s = calloc(1, sizeof *s);
    if (s) {
        s->environment = environment;
        s->log = log;
        s->instance = instance_new(name, logging);
        s->converted = calloc((size_t)N_VARIABLES, sizeof *s->converted);
    }
    if (!s || !s->instance || !s->converted) {
        say(log, environment, fmi3Error, ERRORS, "there is no memory for an instance, or its start values make no model");
        fmi3FreeInstance(s);
        return 0;
    }
    return s;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    Slave *s = instance;
    if (!s)
        return;
    instance_free(s->instance);
    free(s->converted);
    free(s);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    Slave *s = instance;
    return s ? result(s, instance_choose_log(s->instance, on, n, categories)) : fmi3Error;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    (void)tolerance_defined, (void)tolerance;
    Slave *s = instance;
    if (!s)
        return fmi3Error;
    const char *wrong = s->instance->phase == INSTANTIATED ? instance_start(s->instance, start, stop_defined, stop) : 0;
    return result(s, wrong ? wrong : instance_enter_initialization(s->instance));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    Slave *s = instance;
    return s ? event(s, instance_exit_initialization(s->instance), "the simulation starts") : fmi3Error;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    Slave *s = instance;
    return s ? event(s, instance_end(s->instance), "the simulation ends") : fmi3Error;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    Slave *s = instance;
    return s ? event(s, instance_reset(s->instance), "everything is reset") : fmi3Error;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_return,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached)
{
    (void)no_return;
    Slave *s = instance;
    if (!s)
        return fmi3Error;
    const char *wrong = instance_step(s->instance, time, step);
    fmi3Boolean *const never[] = {event, terminate, early};
    for (int k = 0; k < 3; k++)
        if (never[k])
            *never[k] = fmi3False;
    if (reached)
        *reached = s->instance->time;
    return result(s, wrong);
}

/* -- values ------------------------------------------------------------------------------------------------------ */

static const char *const WRONG_COUNT = "the number of values is not that of the variables";

/* The values of one Float64 variable, scalar or array or the time; how many they are in count. */
static const char *find(const Slave *s, fmi3ValueReference reference, const double **found, size_t *count)
{
    const double *values;
    const fmi3ValueReference number = reference - (fmi3ValueReference)N_VARIABLES;
    *count = 1;
    if (reference >= (fmi3ValueReference)N_VARIABLES && number == (fmi3ValueReference)N_ARRAYS) {
        *found = &s->instance->time;
        return 0;
    }
    const int is_array = reference >= (fmi3ValueReference)N_VARIABLES && number < (fmi3ValueReference)N_ARRAYS;
    const unsigned first = is_array ? (unsigned)ARRAYS[number].first : reference;
    const char *wrong = instance_read(s->instance, REAL, &first, 1, &values);
    if (wrong)
        return wrong;
    *found = values + first;
    if (is_array)
        *count = (size_t)ARRAYS[number].length;
    return 0;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t n, fmi3Float64 to[],
                          size_t n_values)
{
    Slave *s = instance;
    const double *found;
    size_t count, used = 0;
    if (!s || (n && !references) || (n_values && !to))
        return refused(s, NULL_ARGUMENT);
    for (size_t k = 0; k < n; k++, used += count) {
        const char *wrong = find(s, references[k], &found, &count);
        if (wrong)
            return result(s, wrong);
    }
    if (used != n_values) /* before anything is written: an importer that takes an array for one value gets none */
        return refused(s, WRONG_COUNT);
    for (size_t k = 0; k < n; k++, to += count) {
        find(s, references[k], &found, &count);
        memcpy(to, found, count * sizeof *to);
    }
    return fmi3OK;
}

#define GET(name, type, kind, convert)                                                                                \
    fmi3Status name(fmi3Instance instance, const fmi3ValueReference references[], size_t n, type to[], size_t m)      \
    {                                                                                                                 \
        Slave *s = instance;                                                                                          \
        const double *values;                                                                                         \
        if (!s || (n && (!references || !to)))                                                                        \
            return refused(s, NULL_ARGUMENT);                                                                         \
        if (n != m)                                                                                                   \
            return refused(s, WRONG_COUNT);                                                                           \
        const char *wrong = instance_read(s->instance, kind, references, n, &values);                                 \
        for (size_t k = 0; !wrong && k < n; k++)                                                                      \
            to[k] = convert(values[references[k]]);                                                                   \
        return result(s, wrong);                                                                                      \
    }

#define SET(name, type, kind, convert)                                                                                \
    fmi3Status name(fmi3Instance instance, const fmi3ValueReference references[], size_t n, const type values[],      \
                    size_t m)                                                                                         \
    {                                                                                                                 \
        Slave *s = instance;                                                                                          \
        if (!s || (n && (!references || !values)))                                                                    \
            return refused(s, NULL_ARGUMENT);                                                                         \
        if (n != m || n > (size_t)N_VARIABLES)                                                                        \
            return refused(s, WRONG_COUNT);                                                                           \
        for (size_t k = 0; k < n; k++)                                                                                \
            s->converted[k] = convert(values[k]);                                                                     \
        return result(s, instance_write(s->instance, kind, references, n, s->converted));                             \
    }

#define SAME(value) (double)(value)
#define WHOLE(value) (fmi3Int32)(value)
#define LONG(value) (fmi3Int64)(value)
#define TRUTH(value) ((value) != 0)

GET(fmi3GetInt32, fmi3Int32, INTEGER, WHOLE)
GET(fmi3GetInt64, fmi3Int64, INTEGER, LONG) /* enumerations */
GET(fmi3GetBoolean, fmi3Boolean, BOOLEAN, TRUTH)
SET(fmi3SetFloat64, fmi3Float64, REAL, SAME)
SET(fmi3SetInt32, fmi3Int32, INTEGER, SAME)
SET(fmi3SetBoolean, fmi3Boolean, BOOLEAN, SAME)

/* -- states ------------------------------------------------------------------------------------------------------ */

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    if (instance && state)
        instance_let_go(state);
    return instance ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    Slave *s = instance;
    return s && state ? result(s, instance_keep(s->instance, state)) : refused(s, NULL_ARGUMENT);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    Slave *s = instance;
    return s ? result(s, instance_go_back(s->instance, state)) : fmi3Error;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    Slave *s = instance;
    return s ? result(s, instance_state_size(s->instance, state, size)) : fmi3Error;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    Slave *s = instance;
    return s ? result(s, instance_state_bytes(s->instance, state, bytes, size)) : fmi3Error;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    Slave *s = instance;
    return s ? result(s, instance_state_of(s->instance, bytes, size, state)) : fmi3Error;
}

/* -- what this FMU leaves out ------------------------------------------------------------------------------------ */

#define NO_GET(name, type)                                                                                            \
    fmi3Status name(fmi3Instance instance, const fmi3ValueReference references[], size_t n, type to[], size_t m)      \
    {                                                                                                                 \
        (void)references, (void)to;                                                                                   \
        return n || m || !instance ? refused(instance, "there are no variables of this type") : fmi3OK;               \
    }

#define NO_VALUES(kind)                                                                                               \
    NO_GET(fmi3Get##kind, fmi3##kind)                                                                                 \
    NO_GET(fmi3Set##kind, const fmi3##kind)

NO_VALUES(Float32)
NO_VALUES(Int8)
NO_VALUES(UInt8)
NO_VALUES(Int16)
NO_VALUES(UInt16)
NO_VALUES(UInt32)
NO_GET(fmi3SetInt64, const fmi3Int64)
NO_VALUES(UInt64)
NO_VALUES(String)

#define LEFT_OUT(name, arguments, sentence)                                                                           \
    fmi3Status name arguments                                                                                         \
    {                                                                                                                 \
        return refused(instance, sentence);                                                                           \
    }

#define NO_TYPE "there are no variables of this type"
#define NO_CLOCK "there are no clocks"
#define NO_DERIVATIVE "there are no derivatives"
#define NO_EVENT "there is no event mode"
#define CO_SIMULATION "this FMU is for co-simulation only"
#define NO_STRUCTURE "there are no structural parameters"
#define NO_ELEMENTS "dependencies are not known element by element"

#ifdef __GNUC__
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    say(log, environment, fmi3Error, ERRORS, CO_SIMULATION);
    return 0;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    say(log, environment, fmi3Error, ERRORS, CO_SIMULATION);
    return 0;
}

LEFT_OUT(fmi3GetBinary, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, size_t sizes[], fmi3Binary to[], size_t m), NO_TYPE)
LEFT_OUT(fmi3SetBinary, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const size_t sizes[], const fmi3Binary v[], size_t m), NO_TYPE)
LEFT_OUT(fmi3GetClock, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3Clock to[]), NO_CLOCK)
LEFT_OUT(fmi3SetClock, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Clock v[]), NO_CLOCK)
LEFT_OUT(fmi3GetIntervalDecimal, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3Float64 to[], fmi3IntervalQualifier q[]), NO_CLOCK)
LEFT_OUT(fmi3GetIntervalFraction, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3UInt64 a[], fmi3UInt64 b[], fmi3IntervalQualifier q[]), NO_CLOCK)
LEFT_OUT(fmi3GetShiftDecimal, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3Float64 to[]), NO_CLOCK)
LEFT_OUT(fmi3GetShiftFraction, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, fmi3UInt64 a[], fmi3UInt64 b[]), NO_CLOCK)
LEFT_OUT(fmi3SetIntervalDecimal, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[]), NO_CLOCK)
LEFT_OUT(fmi3SetIntervalFraction, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3UInt64 a[], const fmi3UInt64 b[]), NO_CLOCK)
LEFT_OUT(fmi3SetShiftDecimal, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[]), NO_CLOCK)
LEFT_OUT(fmi3SetShiftFraction, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3UInt64 a[], const fmi3UInt64 b[]), NO_CLOCK)
LEFT_OUT(fmi3ActivateModelPartition, (fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time), NO_CLOCK)
LEFT_OUT(fmi3GetNumberOfVariableDependencies, (fmi3Instance instance, fmi3ValueReference r, size_t *n), NO_ELEMENTS)
LEFT_OUT(fmi3GetVariableDependencies, (fmi3Instance instance, fmi3ValueReference r, size_t a[], fmi3ValueReference b[], size_t c[], fmi3DependencyKind k[], size_t n), NO_ELEMENTS)
LEFT_OUT(fmi3GetDirectionalDerivative, (fmi3Instance instance, const fmi3ValueReference u[], size_t n_u, const fmi3ValueReference k[], size_t n_k, const fmi3Float64 seed[], size_t n_seed, fmi3Float64 to[], size_t n), NO_DERIVATIVE)
LEFT_OUT(fmi3GetAdjointDerivative, (fmi3Instance instance, const fmi3ValueReference u[], size_t n_u, const fmi3ValueReference k[], size_t n_k, const fmi3Float64 seed[], size_t n_seed, fmi3Float64 to[], size_t n), NO_DERIVATIVE)
LEFT_OUT(fmi3GetOutputDerivatives, (fmi3Instance instance, const fmi3ValueReference r[], size_t n, const fmi3Int32 orders[], fmi3Float64 to[], size_t m), NO_DERIVATIVE)
LEFT_OUT(fmi3EnterConfigurationMode, (fmi3Instance instance), NO_STRUCTURE)
LEFT_OUT(fmi3ExitConfigurationMode, (fmi3Instance instance), NO_STRUCTURE)
LEFT_OUT(fmi3EnterEventMode, (fmi3Instance instance), NO_EVENT)
LEFT_OUT(fmi3EnterStepMode, (fmi3Instance instance), NO_EVENT)
LEFT_OUT(fmi3EvaluateDiscreteStates, (fmi3Instance instance), NO_EVENT)
LEFT_OUT(fmi3UpdateDiscreteStates, (fmi3Instance instance, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *c, fmi3Boolean *d, fmi3Boolean *e, fmi3Float64 *time), NO_EVENT)
LEFT_OUT(fmi3EnterContinuousTimeMode, (fmi3Instance instance), CO_SIMULATION)
LEFT_OUT(fmi3CompletedIntegratorStep, (fmi3Instance instance, fmi3Boolean no_return, fmi3Boolean *event, fmi3Boolean *terminate), CO_SIMULATION)
LEFT_OUT(fmi3SetTime, (fmi3Instance instance, fmi3Float64 time), CO_SIMULATION)
LEFT_OUT(fmi3SetContinuousStates, (fmi3Instance instance, const fmi3Float64 x[], size_t n), CO_SIMULATION)
LEFT_OUT(fmi3GetContinuousStateDerivatives, (fmi3Instance instance, fmi3Float64 to[], size_t n), CO_SIMULATION)
LEFT_OUT(fmi3GetEventIndicators, (fmi3Instance instance, fmi3Float64 to[], size_t n), CO_SIMULATION)
LEFT_OUT(fmi3GetContinuousStates, (fmi3Instance instance, fmi3Float64 to[], size_t n), CO_SIMULATION)
LEFT_OUT(fmi3GetNominalsOfContinuousStates, (fmi3Instance instance, fmi3Float64 to[], size_t n), CO_SIMULATION)
LEFT_OUT(fmi3GetNumberOfEventIndicators, (fmi3Instance instance, size_t *n), CO_SIMULATION)
LEFT_OUT(fmi3GetNumberOfContinuousStates, (fmi3Instance instance, size_t *n), CO_SIMULATION)

#ifdef __GNUC__
#pragma GCC diagnostic pop
#endif
