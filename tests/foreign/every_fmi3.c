/* A slave of FMI 3.0 with variables of every type; functions that nobody calls are left out.

   Every type T has four variables, value reference 10 * (place of T below) + slot: slot 0 an
   input, 1 an output equal to it, 2 an input array, 3 an output array with the elements of 2 in
   reverse order. Float64's arrays are n x 3 and 3 x n with n a structural parameter, the second
   the first one transposed; the others have two elements. Then: 200 n, 201 parameter end_at,
   202 parameter fail_at, 203 parameter status, 204 tunable gain, 205 output x with an exact
   start, 206 output size (of a step, negative once there is no way back), 207 local fixed to 7
   whatever it is given, 208 an enumeration. */

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

enum { F64, F32, I8, U8, I16, U16, I32, U32, I64, U64, BOOL, STRING, TYPES };
enum { N = 200, END_AT, FAIL_AT, STATUS, GAIN, X, SIZE, SEVEN, LEVEL };
enum { LONGEST = 32, TEXT = 64 };

#define STORE(T) fmi3##T T[4][LONGEST];
typedef struct {
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
    fmi3UInt64 n;
    fmi3Float64 end_at, fail_at, gain, x, size, seven;
    fmi3Int32 status;
    fmi3Int64 level;
    bool configuring;
    STORE(Float64) STORE(Float32) STORE(Int8) STORE(UInt8) STORE(Int16) STORE(UInt16)
    STORE(Int32) STORE(UInt32) STORE(Int64) STORE(UInt64) STORE(Boolean)
    char String[4][LONGEST][TEXT];
} Model;

static fmi3Status say(Model *m, fmi3Status status, const char *category, const char *text) {
    m->log(m->environment, status, category, text);
    return status;
}

static size_t length(const Model *m, unsigned slot, int type) {
    return slot < 2 ? 1 : type == F64 ? 3 * m->n : 2;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference required[], size_t count, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    (void)name, (void)visible, (void)logging, (void)required, (void)update;
    char text[256];
    snprintf(text, sizeof text, "token %s, resources end with '%c', options %d %d %zu", token,
             resources[strlen(resources) - 1], events, early, count);
    log(environment, fmi3OK, "made", text);
    Model *m = calloc(1, sizeof(Model));
    *m = (Model){.log = log, .environment = environment, .n = 2, .end_at = 1e300,
                 .fail_at = 1e300, .gain = 1, .x = 5, .seven = 7, .level = 1, .status = 3};
    return m;
}
void fmi3FreeInstance(fmi3Instance it) { free(it); }
fmi3Status fmi3SetDebugLogging(fmi3Instance it, fmi3Boolean on, size_t n, const fmi3String k[]) {
    return say(it, fmi3OK, "chosen", on && n ? k[0] : "nothing");
}
fmi3Status fmi3EnterConfigurationMode(fmi3Instance it) {
    ((Model *)it)->configuring = true;
    return fmi3OK;
}
fmi3Status fmi3ExitConfigurationMode(fmi3Instance it) {
    ((Model *)it)->configuring = false;
    return fmi3OK;
}
fmi3Status fmi3EnterInitializationMode(fmi3Instance it, fmi3Boolean tolerance, fmi3Float64 t,
                                       fmi3Float64 start, fmi3Boolean stops, fmi3Float64 stop) {
    char text[TEXT];
    (void)tolerance, (void)t;
    snprintf(text, sizeof text, "from %g to %g", start, stops ? stop : -1.0);
    return say(it, fmi3OK, "", text);
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance it) {
    ((Model *)it)->seven = 7;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance it) { return say(it, fmi3OK, "made", "terminated"); }

static void *special(Model *m, fmi3ValueReference reference) {
    switch (reference) {
    case N: return &m->n;
    case END_AT: return &m->end_at;
    case FAIL_AT: return &m->fail_at;
    case STATUS: return &m->status;
    case GAIN: return &m->gain;
    case X: return &m->x;
    case SIZE: return &m->size;
    case LEVEL: return &m->level;
    default: return &m->seven;
    }
}

/* What stands in a slot of a type: the outputs are made of the inputs when they are read. */
#define AT(m, T, slot, j, type)                                                                    \
    m->T[(slot) < 2 ? 0 : 2][(slot) < 3                ? (j)                                       \
                             : (type) == F64 ? (j) % m->n * 3 + (j) / m->n                         \
                                             : 1 - (j)]
#define MOVE(T, type)                                                                              \
    fmi3Status fmi3Get##T(fmi3Instance it, const fmi3ValueReference vr[], size_t n,                \
                          fmi3##T values[], size_t size) {                                         \
        Model *m = it;                                                                             \
        size_t k = 0;                                                                              \
        for (size_t i = 0; i < n; i++) {                                                           \
            if (vr[i] >= N) {                                                                      \
                values[k++] = *(fmi3##T *)special(m, vr[i]);                                       \
                continue;                                                                          \
            }                                                                                      \
            unsigned slot = vr[i] % 10;                                                            \
            for (size_t j = 0; j < length(m, slot, type) && k < size; j++)                         \
                values[k++] = AT(m, T, slot, j, type);                                             \
        }                                                                                          \
        return k == size ? fmi3OK : say(m, fmi3Error, "bad", "another number of values");          \
    }                                                                                              \
    fmi3Status fmi3Set##T(fmi3Instance it, const fmi3ValueReference vr[], size_t n,                \
                          const fmi3##T values[], size_t size) {                                   \
        Model *m = it;                                                                             \
        size_t k = 0;                                                                              \
        for (size_t i = 0; i < n; i++) {                                                           \
            if (vr[i] == N && !m->configuring)                                                     \
                return say(m, fmi3Error, "bad", "n is set in configuration mode");                 \
            if (vr[i] == GAIN && (double)values[k] < 0)                                            \
                return say(m, fmi3Discard, "bad", "the gain must not be negative");                \
            if (vr[i] >= N) {                                                                      \
                *(fmi3##T *)special(m, vr[i]) = values[k++];                                       \
                continue;                                                                          \
            }                                                                                      \
            for (size_t j = 0; j < length(m, vr[i] % 10, type) && k < size; j++)                   \
                m->T[vr[i] % 10][j] = values[k++];                                                 \
        }                                                                                          \
        return k == size ? fmi3OK : say(m, fmi3Error, "bad", "another number of values");          \
    }
MOVE(Float64, F64)
MOVE(Float32, F32)
MOVE(Int8, I8)
MOVE(UInt8, U8)
MOVE(Int16, I16)
MOVE(UInt16, U16)
MOVE(Int32, I32)
MOVE(UInt32, U32)
MOVE(Int64, I64)
MOVE(UInt64, U64)
MOVE(Boolean, BOOL)

fmi3Status fmi3GetString(fmi3Instance it, const fmi3ValueReference vr[], size_t n,
                         fmi3String values[], size_t size) {
    Model *m = it;
    size_t k = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < length(m, vr[i] % 10, STRING); j++)
            values[k++] = AT(m, String, vr[i] % 10, j, STRING);
    return k == size ? fmi3OK : fmi3Error;
}
fmi3Status fmi3SetString(fmi3Instance it, const fmi3ValueReference vr[], size_t n,
                         const fmi3String values[], size_t size) {
    Model *m = it;
    size_t k = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < length(m, vr[i] % 10, STRING); j++)
            snprintf(m->String[vr[i] % 10][j], TEXT, "%s", values[k++]);
    return k == size ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetBinary(fmi3Instance it, const fmi3ValueReference vr[], size_t n, size_t sizes[],
                         fmi3Binary values[], size_t size) {
    (void)it, (void)vr, (void)n, (void)size;
    sizes[0] = 3, values[0] = (fmi3Binary) "\x00\xff%";
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance it, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_way_back,
                      fmi3Boolean *events, fmi3Boolean *ends, fmi3Boolean *early,
                      fmi3Float64 *reached) {
    Model *m = it;
    *events = false;
    *early = false;
    *reached = t + h;
    *ends = t + h >= m->end_at;
    if (t >= m->fail_at)
        return say(m, (fmi3Status)m->status, "bad", "it broke");
    m->x += h * m->gain;
    m->size = no_way_back ? -h : h;
    return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance it, fmi3FMUState *state) {
    if (!*state)
        *state = malloc(sizeof(Model));
    memcpy(*state, it, sizeof(Model));
    return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance it, fmi3FMUState state) {
    memcpy(it, state, sizeof(Model));
    return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance it, fmi3FMUState *state) {
    free(*state);
    *state = NULL;
    return say(it, fmi3OK, "made", "a state is freed");
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance it, fmi3FMUState state, size_t *size) {
    (void)it, (void)state;
    *size = sizeof(Model);
    return fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance it, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size) {
    (void)it;
    memcpy(bytes, state, size);
    return fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance it, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state) {
    (void)it;
    *state = malloc(size);
    memcpy(*state, bytes, size);
    return fmi3OK;
}
