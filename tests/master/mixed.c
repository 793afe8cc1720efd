/* A slave in C with variables of every type, which fails when it is told to.

   reals: 0 input u, 3 output y = 2 u at once, 6 parameter fail_at; integers: 1 input j,
   4 output n (steps so far, plus j); booleans: 2 input c, 5 output f = not c, as of the last
   step; 7 parameter status: what fails returns it, 8 parameter fail_get (boolean): reading
   fails in place of stepping.

   Functions that a co-simulation master without need of them never calls are left out. */

#include <stdlib.h>
#include <string.h>

typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;
typedef struct {
    const Callbacks *callbacks;
    double u, time, fail_at;
    int j, n, c, f, status, fail_get;
} Model;
typedef void *Component;
typedef int Status;
#define API __attribute__((visibility("default")))

static Status say(Model *m, Status status, const char *text) {
    m->callbacks->logger(m->callbacks->environment, "mixed", status, "logStatus", text);
    return status;
}
API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }
API Status fmi2SetDebugLogging(Component c, int on, size_t n, const char *const k[]) {
    return (void)c, (void)on, (void)n, (void)k, 0;
}
API Component fmi2Instantiate(const char *name, int type, const char *guid, const char *where,
                              const Callbacks *callbacks, int visible, int logging) {
    (void)name, (void)type, (void)guid, (void)where, (void)visible, (void)logging;
    Model *m = calloc(1, sizeof(Model));
    if (m) {
        m->callbacks = callbacks;
        m->fail_at = 1e300;
        m->status = 3;
    }
    return m;
}
API void fmi2FreeInstance(Component c) { free(c); }
API Status fmi2SetupExperiment(Component c, int t, double tol, double start, int s, double stop) {
    return (void)c, (void)t, (void)tol, (void)start, (void)s, (void)stop, 0;
}
API Status fmi2EnterInitializationMode(Component c) { return (void)c, 0; }
API Status fmi2ExitInitializationMode(Component c) { return (void)c, 0; }
API Status fmi2Terminate(Component c) { return say(c, 0, "terminated"); }
API Status fmi2Reset(Component c) { return (void)c, 0; }

#define EACH for (size_t i = 0; i < n; i++)
API Status fmi2GetReal(Component c, const unsigned vr[], size_t n, double value[]) {
    Model *m = c;
    if (m->fail_get && m->time >= m->fail_at)
        return say(m, m->status, "cannot be read any more");
    EACH value[i] = vr[i] == 3 ? 2.0 * m->u : vr[i] == 0 ? m->u : m->fail_at;
    return 0;
}
API Status fmi2SetReal(Component c, const unsigned vr[], size_t n, const double value[]) {
    Model *m = c;
    EACH *(vr[i] == 0 ? &m->u : &m->fail_at) = value[i];
    return 0;
}
API Status fmi2GetInteger(Component c, const unsigned vr[], size_t n, int value[]) {
    Model *m = c;
    EACH value[i] = vr[i] == 4 ? m->n + m->j : m->status;
    return 0;
}
API Status fmi2SetInteger(Component c, const unsigned vr[], size_t n, const int value[]) {
    Model *m = c;
    EACH *(vr[i] == 1 ? &m->j : &m->status) = value[i];
    return 0;
}
API Status fmi2GetBoolean(Component c, const unsigned vr[], size_t n, int value[]) {
    Model *m = c;
    EACH value[i] = vr[i] == 5 ? m->f : m->fail_get;
    return 0;
}
API Status fmi2SetBoolean(Component c, const unsigned vr[], size_t n, const int value[]) {
    Model *m = c;
    EACH *(vr[i] == 2 ? &m->c : &m->fail_get) = value[i];
    return 0;
}
API Status fmi2DoStep(Component c, double t, double h, int keep) {
    Model *m = c;
    (void)keep;
    if (!m->fail_get && t >= m->fail_at)
        return say(m, m->status, "it broke");
    m->time = t + h;
    m->n++;
    m->f = !m->c;
    if (m->n % 4 == 0)
        say(m, 1, "four more");
    return 0;
}
