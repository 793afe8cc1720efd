/* What the slaves in C of the tests share, so that their files hold what is their own.

   A file includes this, completes `struct Model`, defines `behaviour`, and writes the functions
   that get and set values. What `behaviour` leaves out does nothing. With BOTH_VERSIONS defined
   before, it is a slave of FMI 3.0 too, and writes fmi3DoStep itself. Functions that nobody calls
   are left out; some importers look every function up: REFUSED. */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "fmi3Functions.h"

#pragma GCC diagnostic ignored "-Wunused-parameter" /* FMI prescribes more than a slave reads */

typedef struct Model Model;
typedef struct { /* where an instance writes its messages: one of two and three is NULL */
    const fmi2CallbackFunctions *two;
    fmi3LogMessageCallback three;
    void *environment; /* of FMI 3.0 */
    fmi3IntermediateUpdateCallback update; /* of FMI 3.0; NULL: nothing is read within steps */
    const char *category;
    char name[200];
} Log;
typedef struct { /* all but begin and end return an fmi2Status or fmi3Status */
    size_t size; /* of Model */
    int (*begin)(Model *, const Log *); /* of memory that is zero; 0: there is no instance */
    int (*setup)(Model *, double start); /* in FMI 3.0 when it enters the initialisation */
    int (*enter)(Model *);
    int (*leave)(Model *);
    int (*step)(Model *, double time, double step); /* of FMI 2.0 alone */
    int (*terminate)(Model *);
    int (*reset)(Model *);
    int (*save)(Model *); /* before its state is saved */
    void (*end)(Model *); /* before its memory is released */
} Behaviour;
static const Behaviour behaviour; /* the file says which */

/* Write a message, and return its status. */
static inline int say(const Log *log, int status, const char *text) {
    if (log->three)
        log->three(log->environment, (fmi3Status)status, log->category, text);
    else if (log->two)
        log->two->logger(log->two->componentEnvironment, log->name, (fmi2Status)status,
                         log->category, "%s", text);
    return status;
}

__attribute__((used)) static int refuse(Model *m) { return fmi2Error; }

static Model *instantiate(const char *name, Log log) {
    Model *m = calloc(1, behaviour.size);
    snprintf(log.name, sizeof log.name, "%s", name);
    if (m && behaviour.begin && !behaviour.begin(m, &log)) {
        free(m);
        return NULL;
    }
    return m;
}

#define DO(hook, ...) (behaviour.hook ? behaviour.hook(__VA_ARGS__) : 0)
#define COMMON_FUNCTIONS(V)                                                                        \
    const char *V##GetVersion(void) { return V##Version; }                                         \
    V##Status V##SetDebugLogging(void *c, V##Boolean on, size_t n, const V##String categories[]) { \
        return V##OK;                                                                              \
    }                                                                                              \
    V##Status V##ExitInitializationMode(void *c) { return (V##Status)DO(leave, c); }               \
    V##Status V##Terminate(void *c) { return (V##Status)DO(terminate, c); }                        \
    V##Status V##Reset(void *c) { return (V##Status)DO(reset, c); }                                \
    void V##FreeInstance(void *c) {                                                                \
        if (behaviour.end)                                                                         \
            behaviour.end(c);                                                                      \
        free(c);                                                                                   \
    }

COMMON_FUNCTIONS(fmi2)
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String where,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                              fmi2Boolean logging) {
    return instantiate(name, (Log){.two = callbacks, .category = "logAll"});
}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real time,
                               fmi2Boolean s, fmi2Real stop) {
    return (fmi2Status)DO(setup, c, time);
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (fmi2Status)DO(enter, c); }
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keep) {
    return (fmi2Status)DO(step, c, time, step);
}

#ifdef BOTH_VERSIONS
COMMON_FUNCTIONS(fmi3)
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String where,
                                         fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference needed[], size_t n,
                                         fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update) {
    return instantiate(name, (Log){.three = logger, .environment = environment,
                                   .update = n ? update : NULL, .category = "logAll"});
}
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean t, fmi3Float64 tolerance,
                                       fmi3Float64 time, fmi3Boolean s, fmi3Float64 stop) {
    int status = DO(setup, c, time);
    return (fmi3Status)(status ? status : DO(enter, c));
}
#endif

/* The functions that get and set values of a type, such as GETTER(fmi2, Real, ...). `status` is an
   expression of the Model `m`, found before the values are read or after they are set; `value`
   is one of `m` and `reference`. */
#define GETTER(V, Type, status, value)                                                             \
    V##Status V##Get##Type(void *c, const unsigned v[], size_t n, V##Type x[] V##_VALUES) {        \
        Model *m = c;                                                                              \
        int found = status;                                                                        \
        for (size_t i = 0; i < n; i++) {                                                           \
            unsigned reference = v[i];                                                             \
            x[i] = value;                                                                          \
        }                                                                                          \
        return (V##Status)found;                                                                   \
    }
#define SETTER(V, Type, status, value)                                                             \
    V##Status V##Set##Type(void *c, const unsigned v[], size_t n, const V##Type x[] V##_VALUES) {  \
        Model *m = c;                                                                              \
        for (size_t i = 0; i < n; i++) {                                                           \
            unsigned reference = v[i];                                                             \
            value = x[i];                                                                          \
        }                                                                                          \
        return (V##Status)status;                                                                  \
    }
#define fmi2_VALUES
#define fmi3_VALUES , size_t values

/* The functions of a state, which is a copy of the Model; the versions spell their names apart:
   STATE_FUNCTIONS(fmi2, FMUstate, DeSerialize), STATE_FUNCTIONS(fmi3, FMUState, Deserialize). */
#define STATE_FUNCTIONS(V, State, Deserialize)                                                     \
    V##Status V##Get##State(void *c, void **s) {                                                   \
        int status = DO(save, c);                                                                  \
        *s = memcpy(*s ? *s : malloc(sizeof(Model)), c, sizeof(Model));                            \
        return (V##Status)status;                                                                  \
    }                                                                                              \
    V##Status V##Set##State(void *c, void *s) { return memcpy(c, s, sizeof(Model)), V##OK; }       \
    V##Status V##Free##State(void *c, void **s) { return free(*s), *s = NULL, V##OK; }             \
    V##Status V##Serialized##State##Size(void *c, void *s, size_t *n) {                            \
        return *n = sizeof(Model), V##OK;                                                          \
    }                                                                                              \
    V##Status V##Serialize##State(void *c, void *s, V##Byte bytes[], size_t n) {                   \
        return memcpy(bytes, s, n), V##OK;                                                         \
    }                                                                                              \
    V##Status V##Deserialize##State(void *c, const V##Byte bytes[], size_t n, void **s) {          \
        return *s = memcpy(*s ? *s : malloc(n), bytes, n), V##OK;                                  \
    }

/* A function that returns Error, whatever it is given. */
#define REFUSED(name) REFUSED_AS(name, __USER_LABEL_PREFIX__)
#define REFUSED_AS(name, prefix) REFUSED_IN_ASSEMBLER(#name, prefix)
#define REFUSED_IN_ASSEMBLER(name, prefix)                                                         \
    __asm__(".globl " #prefix name "\n.set " #prefix name ", " #prefix "refuse");
