/* A host in C, with no Python anywhere: loads an FMI 2.0 binary, runs it, saves, restores.

   host LIBRARY GUID INPUT OUTPUT...

   INPUT is the value reference of a Real input that is driven, or -; OUTPUT are those that are
   compared, in bits. Steps vary. Prints the outputs at the end in hexadecimal, or what failed. */

#include <dlfcn.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"

#define STEPS 60
#define MOST 64

static void *library;
static unsigned input, output[MOST];
static int driven;
static size_t outputs;

static void fail(const char *what) {
    printf("FAILED: %s\n", what);
    exit(1);
}

static void *symbol(const char *name) {
    void *found = dlsym(library, name);
    if (!found) fail(name);
    return found;
}

#define CALL(name, ...)                                                    \
    do {                                                                   \
        fmi2##name##TYPE *function;                                        \
        *(void **)&function = symbol("fmi2" #name);                        \
        if (function(__VA_ARGS__) != fmi2OK) fail(#name);                  \
    } while (0)

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                   fmi2String category, fmi2String message, ...) {
    (void)environment;
    fprintf(stderr, "%s, status %d, %s: %s\n", name, status, category, message);
}

static fmi2Component instance(const char *guid, const char *name) {
    static const fmi2CallbackFunctions functions = {logger, calloc, free, NULL, NULL};
    fmi2InstantiateTYPE *instantiate;
    *(void **)&instantiate = symbol("fmi2Instantiate");
    fmi2Component c =
        instantiate(name, fmi2CoSimulation, guid, "file:///nowhere", &functions, fmi2False, fmi2False);
    if (!c) fail("fmi2Instantiate");
    return c;
}

static double at(int k) { return 0.1 * k + 0.013 * (k % 3); }

static void initialise(fmi2Component c) {
    CALL(SetupExperiment, c, fmi2False, 0.0, 0.0, fmi2True, at(STEPS));
    CALL(EnterInitializationMode, c);
    CALL(ExitInitializationMode, c);
}

/* Steps first to last - 1; outputs after each into `rows`. */
static void run(fmi2Component c, int first, int last, double rows[][MOST]) {
    for (int k = first; k < last; k++) {
        double value = 3.0 * cos(0.7 * k);
        if (driven) CALL(SetReal, c, &input, 1, &value);
        CALL(DoStep, c, at(k), at(k + 1) - at(k), fmi2True);
        CALL(GetReal, c, output, outputs, rows[k]);
    }
}

static void same(double a[][MOST], double b[][MOST], const char *what) {
    for (int k = STEPS / 2; k < STEPS; k++)
        if (memcmp(a[k], b[k], outputs * sizeof(double)) != 0) fail(what);
}

int main(int count, char *arguments[]) {
    static double once[STEPS][MOST], again[STEPS][MOST];
    if (count < 5 || count > 4 + MOST) fail("usage: host LIBRARY GUID INPUT OUTPUT...");
    library = dlopen(arguments[1], RTLD_NOW | RTLD_LOCAL);
    if (!library) fail(dlerror());
    driven = strcmp(arguments[3], "-") != 0;
    input = driven ? (unsigned)atoi(arguments[3]) : 0;
    for (int i = 4; i < count; i++) output[outputs++] = (unsigned)atoi(arguments[i]);

    fmi2Component c = instance(arguments[2], "first"), other = instance(arguments[2], "second");
    initialise(c);
    run(c, 0, STEPS / 2, once);
    fmi2FMUstate state = NULL, read = NULL;
    CALL(GetFMUstate, c, &state);
    size_t size = 0;
    CALL(SerializedFMUstateSize, c, state, &size);
    fmi2Byte *bytes = malloc(size);
    CALL(SerializeFMUstate, c, state, bytes, size);
    run(c, STEPS / 2, STEPS, once);

    CALL(SetFMUstate, c, state); /* back in the same instance */
    run(c, STEPS / 2, STEPS, again);
    same(once, again, "the restored instance goes on differently");
    CALL(DeSerializeFMUstate, other, bytes, size, &read); /* over to one that never ran */
    CALL(SetFMUstate, other, read);
    run(other, STEPS / 2, STEPS, again);
    same(once, again, "the state read from bytes goes on differently");
    CALL(Reset, other);
    initialise(other);
    run(other, 0, STEPS, again);
    same(once, again, "the reset instance runs differently");

    fmi2DoStepTYPE *step;
    *(void **)&step = symbol("fmi2DoStep");
    if (step(other, at(STEPS), 0.01, fmi2True) != fmi2Error) fail("a step past the stop time");

    CALL(FreeFMUstate, c, &state);
    CALL(FreeFMUstate, other, &read);
    if (state || read) fail("a freed state is not NULL");
    free(bytes);
    for (size_t i = 0; i < outputs; i++) printf("%a\n", once[STEPS - 1][i]);
    CALL(Terminate, c);
    fmi2FreeInstanceTYPE *release;
    *(void **)&release = symbol("fmi2FreeInstance");
    release(c);
    release(other);
    dlclose(library);
    return 0;
}
