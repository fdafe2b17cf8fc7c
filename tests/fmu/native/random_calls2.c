/* FMI 2.0: SEED SEQUENCES. */
#include "random_calls.h"

#include "fmi2Functions.h"

static long said;

static void hear(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                 fmi2String message, ...)
{
    (void)environment, (void)status;
    said += name && category && strlen(message) > 20;
}

static double time_now;
static fmi2FMUstate kept[3];
static fmi2Byte *bytes;
static size_t n_bytes;

static void set(fmi2Component c)
{
    fmi2ValueReference references[MOST];
    fmi2Real reals[MOST];
    fmi2Integer integers[MOST];
    const size_t n = (size_t)upto(upto(4) ? 2 : MOST);
    const int kind = upto(4);
    for (size_t k = 0; k < n; k++) {
        do
            references[k] = reference();
        while (upto(10) && (references[k] >= (unsigned)N_VARIABLES || VARIABLES[references[k]].kind != kind));
        reals[k] = value_of(references[k]);
        integers[k] = fabs(reals[k]) < 2e9 ? (int)reals[k] : 1 << upto(31);
    }
    const fmi2ValueReference *from = upto(50) ? references : 0;
    if (kind == REAL)
        fmi2SetReal(c, from, n, reals);
    else if (kind == INTEGER)
        fmi2SetInteger(c, from, n, integers);
    else if (kind == BOOLEAN)
        fmi2SetBoolean(c, from, n, integers);
    else
        fmi2SetString(c, from, n, 0);
}

static void get(fmi2Component c)
{
    fmi2ValueReference references[MOST];
    fmi2Real reals[MOST];
    fmi2Integer integers[MOST];
    const size_t n = (size_t)upto(MOST);
    for (size_t k = 0; k < n; k++)
        references[k] = reference();
    const fmi2ValueReference *from = upto(50) ? references : 0;
    switch (upto(4)) {
    case 0:
        fmi2GetInteger(c, from, n, integers);
        break;
    case 1:
        fmi2GetBoolean(c, from, n, integers);
        break;
    case 2:
        fmi2GetString(c, from, n, 0);
        break;
    default:
        fmi2GetReal(c, from, n, upto(50) ? reals : 0);
    }
}

static void serialize(fmi2Component c)
{
    size_t size = 0;
    if (fmi2SerializedFMUstateSize(c, kept[upto(3)], &size) != fmi2OK)
        return;
    fmi2FMUstate now = 0;
    fmi2GetFMUstate(c, &now);
    fmi2SerializedFMUstateSize(c, now, &size);
    free(bytes);
    n_bytes = size;
    bytes = malloc(size);
    fmi2SerializeFMUstate(c, now, bytes, upto(10) ? size : size - 1);
    fmi2FreeFMUstate(c, &now);
    for (int k = upto(3) ? 0 : upto(20); k > 0; k--) /* a file that has suffered */
        bytes[next() % size] = (fmi2Byte)next();
}

static void call(fmi2Component c)
{
    const double h = step_size();
    switch (upto(16)) {
    case 0:
        fmi2SetupExperiment(c, 0, 0, upto(5) ? 0 : value_of(0), 0, 0);
        break;
    case 1:
        fmi2EnterInitializationMode(c);
        break;
    case 2:
    case 3:
        fmi2ExitInitializationMode(c);
        break;
    case 4:
        if (!upto(4))
            fmi2Terminate(c);
        break;
    case 5:
        if (!upto(4) && fmi2Reset(c) == fmi2OK)
            time_now = 0;
        break;
    case 6:
        fmi2GetFMUstate(c, upto(30) ? kept + upto(3) : 0);
        break;
    case 7:
        fmi2SetFMUstate(c, kept[upto(3)]);
        break;
    case 8:
        serialize(c);
        break;
    case 9:
        if (bytes)
            fmi2DeSerializeFMUstate(c, bytes, upto(10) ? n_bytes : n_bytes / 2, kept + upto(3));
        break;
    case 10:
        fmi2CancelStep(c), fmi2GetRealStatus(c, fmi2LastSuccessfulTime, 0), fmi2GetDirectionalDerivative(c, 0, 0, 0, 0, 0, 0);
        break;
    case 11:
    case 12:
        set(c);
        break;
    case 13:
        get(c);
        break;
    default:
        for (int k = upto(6); k > 0; k--)
            if (fmi2DoStep(c, upto(20) ? time_now : value_of(0), h, 1) == fmi2OK)
                time_now += h;
    }
}

int main(int argc, char **argv)
{
    const fmi2CallbackFunctions host = {hear, calloc, free, 0, 0};
    if (argc != 3)
        return 2;
    state = 0x9E3779B97F4A7C15u ^ (uint64_t)strtoull(argv[1], 0, 10);
    for (long sequence = atol(argv[2]); sequence > 0; sequence--) {
        fmi2Component c = fmi2Instantiate("random", upto(100) ? fmi2CoSimulation : fmi2ModelExchange,
                                          upto(100) ? MODEL_GUID : "another", 0, &host, 0, 1);
        time_now = 0;
        if (upto(3)) {
            fmi2SetupExperiment(c, 0, 0, 0, 0, 0);
            set(c), set(c), set(c);
            fmi2EnterInitializationMode(c), fmi2ExitInitializationMode(c);
        }
        for (int calls = 10 + upto(30); calls > 0; calls--)
            call(upto(200) ? c : 0);
        for (int k = 0; c && k < 3; k++)
            fmi2FreeFMUstate(c, kept + k);
        fmi2FreeInstance(c);
    }
    free(bytes);
    printf("%ld sentences\n", said);
    return 0;
}
