/* A host without Python: loads an FMU's library and does what a script says, a call a line. Prints what it gets.

   host LIBRARY SCRIPT, with lines: instantiate GUID; start; real, boolean REFERENCE VALUE; step TIME SIZE;
   get REFERENCE; save; back. */
#include "fmi2Functions.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
static HMODULE library;
#define OPEN(path) (library = LoadLibraryA(path))
#define FUNCTION(name) ((void *)GetProcAddress(library, #name))
#else
#include <dlfcn.h>
static void *library;
#define OPEN(path) (library = dlopen(path, RTLD_NOW))
#define FUNCTION(name) dlsym(library, #name)
#endif

#define CALL(name, ...) expect(((name##TYPE *)need(FUNCTION(name), #name))(__VA_ARGS__), #name)

static void *need(void *found, const char *what)
{
    if (!found) {
        fprintf(stderr, "there is no %s\n", what);
        exit(1);
    }
    return found;
}

static void expect(fmi2Status status, const char *what)
{
    if (status != fmi2OK) {
        fprintf(stderr, "%s returned %d\n", what, status);
        exit(1);
    }
}

static void log_message(fmi2ComponentEnvironment env, fmi2String name, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    (void)env, (void)name, (void)status, (void)category;
    fprintf(stderr, "%s\n", message);
}

static fmi2Component instantiate(const char *guid)
{
    static const fmi2CallbackFunctions callbacks = {log_message, calloc, free, 0, 0};
    fmi2InstantiateTYPE *make = (fmi2InstantiateTYPE *)need(FUNCTION(fmi2Instantiate), "fmi2Instantiate");
    fmi2Component made = make("host", fmi2CoSimulation, guid, "", &callbacks, fmi2False, fmi2True);
    return need(made, "instance");
}

/* Through bytes, as another process would. */
static void back_to(fmi2Component c, const fmi2Byte *bytes, size_t size)
{
    fmi2FMUstate state = 0;
    CALL(fmi2DeSerializeFMUstate, c, bytes, size, &state);
    CALL(fmi2SetFMUstate, c, state);
    CALL(fmi2FreeFMUstate, c, &state);
}

static fmi2Byte *saved(fmi2Component c, size_t *size)
{
    fmi2FMUstate state = 0;
    CALL(fmi2GetFMUstate, c, &state);
    CALL(fmi2SerializedFMUstateSize, c, state, size);
    fmi2Byte *bytes = need(malloc(*size), "memory");
    CALL(fmi2SerializeFMUstate, c, state, bytes, *size);
    CALL(fmi2FreeFMUstate, c, &state);
    return bytes;
}

int main(int argc, char **argv)
{
    char line[200], word[20], text[100];
    fmi2Component c = 0;
    fmi2Byte *bytes = 0;
    size_t size = 0;
    need(argc == 3 ? OPEN(argv[1]) : 0, "library");
    FILE *script = need(fopen(argv[2], "r"), "script");
    while (fgets(line, sizeof line, script)) {
        fmi2ValueReference reference = 0;
        fmi2Real value = 0, second = 0;
        sscanf(line, "%19s %99s %lf", word, text, &second);
        reference = (fmi2ValueReference)strtoul(text, 0, 10);
        if (!strcmp(word, "instantiate")) {
            c = instantiate(text);
            CALL(fmi2SetupExperiment, c, fmi2False, 0, 0, fmi2False, 0);
        } else if (!strcmp(word, "start")) {
            CALL(fmi2EnterInitializationMode, c);
            CALL(fmi2ExitInitializationMode, c);
        } else if (!strcmp(word, "real")) {
            CALL(fmi2SetReal, c, &reference, 1, &second);
        } else if (!strcmp(word, "boolean")) {
            const fmi2Boolean yes = second != 0;
            CALL(fmi2SetBoolean, c, &reference, 1, &yes);
        } else if (!strcmp(word, "step")) {
            CALL(fmi2DoStep, c, strtod(text, 0), second, fmi2True);
        } else if (!strcmp(word, "get")) {
            CALL(fmi2GetReal, c, &reference, 1, &value);
            printf("%.17g\n", value);
        } else if (!strcmp(word, "save")) {
            bytes = saved(c, &size);
        } else if (!strcmp(word, "back")) {
            back_to(c, bytes, size);
        }
    }
    ((fmi2FreeInstanceTYPE *)need(FUNCTION(fmi2FreeInstance), "fmi2FreeInstance"))(c);
    free(bytes);
    fclose(script);
    return 0;
}
