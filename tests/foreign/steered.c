/* A slave of FMI 2.0 or 3.0 that does as its parameters say.

   1 output x, the time; 9 input u; 10 output y, which follows u slowly and drifts; Integers (Int32): 2 call, one of the list below; 3 status, what that call
   returns; 4 ends, whether the slave wants to end then; 5 early, earlyReturn of its step; 6
   arithmetic, a call of the list that changes how the processor rounds and lets tiny numbers count
   as zero. Reals: 7 at, the time from which on the call is not OK; 8 until, the last successful
   time; if negative, it is not said. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

enum { NOTHING, MAKE, STEP, GET, SET, ENTER, EXIT, RESET, SAVE, TERMINATE, FREE };
enum { X = 1, CALL, STATUS, ENDS, EARLY, ARITHMETIC, AT, UNTIL, U, Y };

typedef struct {
    double x, number[11];
} Model;
typedef unsigned Reference;
#define API __attribute__((visibility("default")))

static void change_arithmetic(void) {
#if defined(__x86_64__)
    unsigned short x87;
    _mm_setcsr(_mm_getcsr() | 0x8000 | 0x2000 | 0x0040); /* flush to zero, down, denormals are zero */
    __asm__ volatile("fnstcw %0" : "=m"(x87));
    x87 |= 0x0400; /* down there too, as fesetround does */
    __asm__ volatile("fldcw %0" : : "m"(x87));
#elif defined(__aarch64__)
    uint64_t word;
    __asm__ volatile("mrs %0, fpcr" : "=r"(word));
    __asm__ volatile("msr fpcr, %0" : : "r"(word | 1u << 24 | 2u << 22)); /* flush to zero, down */
#endif
}

static int call(Model *m, int what) {
    if ((int)m->number[ARITHMETIC] == what)
        change_arithmetic();
    return (int)m->number[CALL] == what && m->x >= m->number[AT] - 1e-9 ? (int)m->number[STATUS] : 0;
}

static void *make(const char *guid) {
    Model *m = calloc(1, sizeof(Model));
    if (guid[0] == 'c') /* its GUID begins so if it is to do it at once */
        change_arithmetic();
    return m;
}

static int get_numbers(Model *m, const Reference vr[], size_t n, double value[]) {
    for (size_t i = 0; i < n; i++)
        value[i] = vr[i] == X ? m->x : m->number[vr[i]];
    return call(m, GET);
}

static int set_numbers(Model *m, const Reference vr[], size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++)
        m->number[vr[i]] = value[i];
    return call(m, SET);
}

static int set_integers(Model *m, const Reference vr[], size_t n, const int32_t value[]) {
    for (size_t i = 0; i < n; i++)
        m->number[vr[i]] = value[i];
    return 0;
}

static int step(Model *m, double t, double h) {
    m->x = t;
    m->number[Y] = 0.9 * m->number[Y] + 0.1 * m->number[U] + h / 3.0;
    int status = call(m, STEP);
    m->x = t + h;
    return status;
}

static int save(Model *m, void **state) {
    *state = calloc(1, sizeof(Model));
    *(Model *)*state = *m;
    return call(m, SAVE);
}

static void end(Model *m) {
    call(m, FREE);
    free(m);
}

/* FMI 2.0 */
API void *fmi2Instantiate(const char *name, int type, const char *guid, const char *where,
                          const void *callbacks, int visible, int logging) {
    return (void)name, (void)type, (void)where, (void)callbacks, (void)visible, (void)logging,
           make(guid);
}
API void fmi2FreeInstance(void *c) { end(c); }
API int fmi2SetupExperiment(void *c, int t, double tol, double start, int s, double stop) {
    return (void)c, (void)t, (void)tol, (void)start, (void)s, (void)stop, 0;
}
API int fmi2EnterInitializationMode(void *c) { return call(c, ENTER); }
API int fmi2ExitInitializationMode(void *c) { return call(c, EXIT); }
API int fmi2Terminate(void *c) { return call(c, TERMINATE); }
API int fmi2Reset(void *c) { return call(c, RESET); }
API int fmi2GetReal(void *c, const Reference vr[], size_t n, double value[]) {
    return get_numbers(c, vr, n, value);
}
API int fmi2SetReal(void *c, const Reference vr[], size_t n, const double value[]) {
    return set_numbers(c, vr, n, value);
}
API int fmi2SetInteger(void *c, const Reference vr[], size_t n, const int value[]) {
    return set_integers(c, vr, n, value);
}
API int fmi2GetFMUstate(void *c, void **state) { return save(c, state); }
API int fmi2FreeFMUstate(void *c, void **state) { return (void)c, free(*state), *state = NULL, 0; }
API int fmi2DoStep(void *c, double t, double h, int final) { return (void)final, step(c, t, h); }
API int fmi2GetBooleanStatus(void *c, int kind, int *value) {
    *value = ((Model *)c)->number[ENDS] != 0;
    return kind == 3 ? 0 : 3;
}
API int fmi2GetRealStatus(void *c, int kind, double *value) {
    *value = ((Model *)c)->number[UNTIL];
    return kind != 2 ? 3 : *value < 0 ? 2 : 0;
}

/* FMI 3.0 */
API void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *where,
                                      bool visible, bool logging, bool events, bool early,
                                      const Reference needed[], size_t count, void *environment,
                                      void *logger, void *update) {
    return (void)name, (void)where, (void)visible, (void)logging, (void)events, (void)early,
           (void)needed, (void)count, (void)environment, (void)logger, (void)update, make(token);
}
API void fmi3FreeInstance(void *c) { end(c); }
API int fmi3EnterInitializationMode(void *c, bool t, double tol, double start, bool s, double stop) {
    return (void)t, (void)tol, (void)start, (void)s, (void)stop, call(c, ENTER);
}
API int fmi3ExitInitializationMode(void *c) { return call(c, EXIT); }
API int fmi3Terminate(void *c) { return call(c, TERMINATE); }
API int fmi3Reset(void *c) { return call(c, RESET); }
API int fmi3GetFloat64(void *c, const Reference vr[], size_t n, double value[], size_t m) {
    return (void)m, get_numbers(c, vr, n, value);
}
API int fmi3SetFloat64(void *c, const Reference vr[], size_t n, const double value[], size_t m) {
    return (void)m, set_numbers(c, vr, n, value);
}
API int fmi3SetInt32(void *c, const Reference vr[], size_t n, const int32_t value[], size_t m) {
    return (void)m, set_integers(c, vr, n, value);
}
API int fmi3GetFMUState(void *c, void **state) { return save(c, state); }
API int fmi3FreeFMUState(void *c, void **state) { return (void)c, free(*state), *state = NULL, 0; }
API int fmi3DoStep(void *c, double t, double h, bool final, bool *event, bool *ended, bool *early,
                   double *reached) {
    (void)final;
    Model *m = c;
    bool now = (int)m->number[CALL] == STEP && t >= m->number[AT] - 1e-9;
    *event = false;
    *ended = now && m->number[ENDS] != 0;
    *early = now && m->number[EARLY] != 0;
    *reached = now && m->number[UNTIL] >= 0 ? m->number[UNTIL] : t + h;
    return step(m, t, h);
}
