/* A slave of FMI 2.0 or 3.0 that fails where and when it is told to, and says what is done to it.

   0 input u, 1 output x: the sum of all u, each times its step; 2 parameter fail_in: a call of
   the list below; 3 parameter status: what that call returns, or, if negative, the signal that
   ends the process in it; 4 parameter fail_at: the time from which on it does. Status 1000: it
   never returns; 1001: it takes a gigabyte of memory; 1002: it prints 3000 lines; 2000 + n: it
   calls exit(n). */

#include <stdbool.h>
#include <stddef.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NOTHING, STEP, GET, SET, ENTER, EXIT, TERMINATE, FREE };

typedef void (*Logger2)(void *, const char *, int, const char *, const char *, ...);
typedef void (*Logger3)(void *, int, const char *, const char *);
typedef struct {
    Logger2 logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;
typedef struct {
    Logger2 two;
    Logger3 three;
    void *environment;
    double u, x, time, fail_at;
    int fail_in, status;
} Model;
typedef unsigned Reference;
#define API __attribute__((visibility("default")))

static int say(Model *m, int status, const char *text) {
    if (m->three)
        m->three(m->environment, status, "logAll", text);
    else
        m->two(m->environment, "faulty", status, "logAll", "%s", text);
    return status;
}

static int misbehave(int status) {
    if (status >= 2000)
        exit(status - 2000);
    if (status == 1000)
        for (volatile int on = 1; on;) {
        }
    for (int i = 0; status == 1001 && i < 1024; i++)
        memset(malloc(1 << 20), 1, 1 << 20);
    for (int i = 0; status == 1002 && i < 3000; i++)
        printf("line %d of the pump\n", i);
    if (status == 1002)
        fprintf(stderr, "the pump is hot\n");
    return 0;
}

static int call(Model *m, int what, double now) {
    if (m->fail_in != what || now < m->fail_at - 1e-9)
        return 0;
    if (m->status < 0) {
        signal(-m->status, SIG_DFL);
        raise(-m->status);
    }
    if (m->status >= 1000)
        return misbehave(m->status);
    return say(m, m->status, "the <pump> has lost its prime");
}

static int step(Model *m, double t, double h) {
    int status = call(m, STEP, t);
    if (status == 0) {
        m->x += h * m->u;
        m->time = t + h;
    }
    return status;
}

static int get_real(Model *m, double value[], size_t n) {
    for (size_t i = 0; i < n; i++)
        value[i] = m->x;
    return call(m, GET, m->time);
}

static int set_real(Model *m, const Reference vr[], size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++)
        *(vr[i] == 0 ? &m->u : &m->fail_at) = value[i];
    return call(m, SET, m->time);
}

static int set_integer(Model *m, const Reference vr[], size_t n, const int32_t value[]) {
    for (size_t i = 0; i < n; i++)
        *(vr[i] == 2 ? &m->fail_in : &m->status) = value[i];
    return 0;
}

static int terminate(Model *m) {
    say(m, 0, "terminated");
    return call(m, TERMINATE, m->time);
}

static void end(Model *m) {
    call(m, FREE, m->time);
    say(m, 0, "freed");
    free(m);
}

/* FMI 2.0 */
API void *fmi2Instantiate(const char *name, int type, const char *guid, const char *where,
                          const Callbacks *callbacks, int visible, int logging) {
    (void)name, (void)type, (void)guid, (void)where, (void)visible, (void)logging;
    Model *m = calloc(1, sizeof(Model));
    m->two = callbacks->logger;
    m->environment = callbacks->environment;
    return m;
}
API void fmi2FreeInstance(void *c) { end(c); }
API int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const k[]) {
    return (void)c, (void)on, (void)n, (void)k, 0;
}
API int fmi2SetupExperiment(void *c, int t, double tol, double start, int s, double stop) {
    return (void)c, (void)t, (void)tol, (void)start, (void)s, (void)stop, 0;
}
API int fmi2EnterInitializationMode(void *c) { return call(c, ENTER, 0.0); }
API int fmi2ExitInitializationMode(void *c) { return call(c, EXIT, 0.0); }
API int fmi2Terminate(void *c) { return terminate(c); }
API int fmi2GetReal(void *c, const Reference vr[], size_t n, double value[]) {
    return (void)vr, get_real(c, value, n);
}
API int fmi2SetReal(void *c, const Reference vr[], size_t n, const double value[]) {
    return set_real(c, vr, n, value);
}
API int fmi2SetInteger(void *c, const Reference vr[], size_t n, const int value[]) {
    return set_integer(c, vr, n, value);
}
API int fmi2DoStep(void *c, double t, double h, int final) { return (void)final, step(c, t, h); }
API int fmi2GetBooleanStatus(void *c, int kind, int *value) {
    return (void)c, (void)kind, *value = 0, 0;
}

/* FMI 3.0 */
API void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *where,
                                      bool visible, bool logging, bool events, bool early,
                                      const Reference needed[], size_t count, void *environment,
                                      Logger3 logger, void *update) {
    (void)name, (void)token, (void)where, (void)visible, (void)logging, (void)events, (void)early;
    (void)needed, (void)count, (void)update;
    Model *m = calloc(1, sizeof(Model));
    m->three = logger;
    m->environment = environment;
    return m;
}
API void fmi3FreeInstance(void *c) { end(c); }
API int fmi3SetDebugLogging(void *c, bool on, size_t n, const char *const k[]) {
    return (void)c, (void)on, (void)n, (void)k, 0;
}
API int fmi3EnterInitializationMode(void *c, bool t, double tol, double start, bool s, double stop) {
    return (void)t, (void)tol, (void)start, (void)s, (void)stop, call(c, ENTER, 0.0);
}
API int fmi3ExitInitializationMode(void *c) { return call(c, EXIT, 0.0); }
API int fmi3Terminate(void *c) { return terminate(c); }
API int fmi3GetFloat64(void *c, const Reference vr[], size_t n, double value[], size_t m) {
    return (void)vr, (void)n, get_real(c, value, m);
}
API int fmi3SetFloat64(void *c, const Reference vr[], size_t n, const double value[], size_t m) {
    return (void)m, set_real(c, vr, n, value);
}
API int fmi3SetInt32(void *c, const Reference vr[], size_t n, const int32_t value[], size_t m) {
    return (void)m, set_integer(c, vr, n, value);
}
API int fmi3DoStep(void *c, double t, double h, bool final, bool *event, bool *ended, bool *early,
                   double *reached) {
    (void)final;
    *event = *ended = *early = false;
    int status = step(c, t, h);
    *reached = status ? t : t + h;
    return status;
}
