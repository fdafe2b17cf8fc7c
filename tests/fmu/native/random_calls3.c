/* FMI 3.0: SEED SEQUENCES. */
#include "random_calls.h"

#include "fmi3Functions.h"

static long said;

static void hear(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)environment, (void)status;
    said += category && strlen(message) > 20;
}

static double time_now;
static fmi3FMUState kept[3];
static fmi3Byte *bytes;
static size_t n_bytes;

static void set(fmi3Instance c)
{
    fmi3ValueReference references[MOST];
    fmi3Float64 reals[MOST];
    fmi3Int32 integers[MOST];
    fmi3Boolean booleans[MOST];
    const size_t n = (size_t)upto(upto(4) ? 2 : MOST), m = upto(20) ? n : n + 1;
    const int kind = upto(4);
    memset(reals, 0, sizeof reals), memset(integers, 0, sizeof integers), memset(booleans, 0, sizeof booleans);
    for (size_t k = 0; k < n; k++) {
        do
            references[k] = reference();
        while (upto(10) && (references[k] >= (unsigned)N_VARIABLES || VARIABLES[references[k]].kind != kind));
        reals[k] = value_of(references[k]);
        integers[k] = fabs(reals[k]) < 2e9 ? (int)reals[k] : 1 << upto(31);
        booleans[k] = upto(2);
    }
    const fmi3ValueReference *from = upto(50) ? references : 0;
    if (kind == REAL)
        fmi3SetFloat64(c, from, n, reals, m < MOST ? m : n);
    else if (kind == INTEGER)
        fmi3SetInt32(c, from, n, integers, m < MOST ? m : n);
    else if (kind == BOOLEAN)
        fmi3SetBoolean(c, from, n, booleans, m < MOST ? m : n);
    else
        fmi3SetString(c, from, n, 0, n);
}

static void get(fmi3Instance c)
{
    fmi3ValueReference references[MOST];
    fmi3Float64 reals[200];
    fmi3Int32 integers[MOST];
    fmi3Boolean booleans[MOST];
    const size_t n = (size_t)upto(MOST), m = upto(5) ? n : (size_t)upto(200);
    for (size_t k = 0; k < n; k++)
        references[k] = reference();
    const fmi3ValueReference *from = upto(50) ? references : 0;
    switch (upto(4)) {
    case 0:
        fmi3GetInt32(c, from, n, integers, n);
        break;
    case 1:
        fmi3GetBoolean(c, from, n, booleans, n);
        break;
    case 2:
        fmi3GetUInt64(c, from, n, 0, n);
        break;
    default:
        fmi3GetFloat64(c, from, n, upto(50) ? reals : 0, m);
    }
}

static void serialize(fmi3Instance c)
{
    size_t size = 0;
    if (fmi3SerializedFMUStateSize(c, kept[upto(3)], &size) != fmi3OK)
        return;
    fmi3FMUState now = 0;
    fmi3GetFMUState(c, &now);
    fmi3SerializedFMUStateSize(c, now, &size);
    free(bytes);
    n_bytes = size;
    bytes = malloc(size);
    fmi3SerializeFMUState(c, now, bytes, upto(10) ? size : size - 1);
    fmi3FreeFMUState(c, &now);
    for (int k = upto(3) ? 0 : upto(20); k > 0; k--) /* a file that has suffered */
        bytes[next() % size] = (fmi3Byte)next();
}

static void call(fmi3Instance c)
{
    const double h = step_size();
    fmi3Boolean event, terminate, early;
    fmi3Float64 reached;
    switch (upto(16)) {
    case 0:
        fmi3EnterStepMode(c);
        break;
    case 1:
        fmi3EnterInitializationMode(c, 0, 0, upto(5) ? 0 : value_of(0), 0, 0);
        break;
    case 2:
    case 3:
        fmi3ExitInitializationMode(c);
        break;
    case 4:
        if (!upto(4))
            fmi3Terminate(c);
        break;
    case 5:
        if (!upto(4) && fmi3Reset(c) == fmi3OK)
            time_now = 0;
        break;
    case 6:
        fmi3GetFMUState(c, upto(30) ? kept + upto(3) : 0);
        break;
    case 7:
        fmi3SetFMUState(c, kept[upto(3)]);
        break;
    case 8:
        serialize(c);
        break;
    case 9:
        if (bytes)
            fmi3DeserializeFMUState(c, bytes, upto(10) ? n_bytes : n_bytes / 2, kept + upto(3));
        break;
    case 10:
        fmi3EnterEventMode(c), fmi3SetTime(c, 0), fmi3GetDirectionalDerivative(c, 0, 0, 0, 0, 0, 0, 0, 0);
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
            if (fmi3DoStep(c, upto(20) ? time_now : value_of(0), h, 1, &event, &terminate, upto(20) ? &early : 0, &reached) == fmi3OK)
                time_now += h;
    }
}

int main(int argc, char **argv)
{
    char token[64];
    if (argc != 3)
        return 2;
    snprintf(token, sizeof token, "{%s}", MODEL_GUID);
    state = 0x9E3779B97F4A7C15u ^ (uint64_t)strtoull(argv[1], 0, 10);
    for (long sequence = atol(argv[2]); sequence > 0; sequence--) {
        fmi3Instance c = fmi3InstantiateCoSimulation("random", upto(100) ? token : "{another}", 0, 0, 1, 0, upto(2), 0,
                                                     0, 0, hear, 0);
        time_now = 0;
        if (upto(3)) {
            set(c), set(c), set(c);
            fmi3EnterInitializationMode(c, 0, 0, 0, 0, 0), fmi3ExitInitializationMode(c);
        }
        for (int calls = 10 + upto(30); calls > 0; calls--)
            call(upto(200) ? c : 0);
        for (int k = 0; c && k < 3; k++)
            fmi3FreeFMUState(c, kept + k);
        fmi3FreeInstance(c);
    }
    free(bytes);
    printf("%ld sentences\n", said);
    return 0;
}
