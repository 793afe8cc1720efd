/* x' = a x + b u, advanced exactly for an input held over the step; y = c x + e u at once.
   Initially x = x0 + g u, so that the start may depend on what others start with.

   reals: 0 u, 1 x, 2 y, 3 a, 4 b, 5 x0, 6 c, 7 e, 8 g. Functions that nobody calls are left out. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { U, X, Y, A, B, X0, C_, E_, G, COUNT };
typedef struct {
    double v[COUNT];
    int initialising;
} Model;
typedef void *Component;
typedef int Status;
#define API __attribute__((visibility("default")))

static void refresh(Model *m) {
    if (m->initialising)
        m->v[X] = m->v[X0] + m->v[G] * m->v[U];
    m->v[Y] = m->v[C_] * m->v[X] + m->v[E_] * m->v[U];
}
API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }
API Status fmi2SetDebugLogging(Component c, int on, size_t n, const char *const k[]) {
    return (void)c, (void)on, (void)n, (void)k, 0;
}
API Component fmi2Instantiate(const char *name, int type, const char *guid, const char *where,
                              const void *callbacks, int visible, int logging) {
    (void)name, (void)type, (void)guid, (void)where, (void)callbacks, (void)visible, (void)logging;
    Model *m = calloc(1, sizeof(Model));
    if (m) {
        m->v[A] = -1, m->v[B] = 1, m->v[C_] = 1;
        m->initialising = 1;
    }
    return m;
}
API void fmi2FreeInstance(Component c) { free(c); }
API Status fmi2SetupExperiment(Component c, int t, double tol, double start, int s, double stop) {
    return (void)c, (void)t, (void)tol, (void)start, (void)s, (void)stop, 0;
}
API Status fmi2EnterInitializationMode(Component c) { return refresh(c), 0; }
API Status fmi2ExitInitializationMode(Component c) {
    refresh(c);
    ((Model *)c)->initialising = 0;
    return 0;
}
API Status fmi2Terminate(Component c) { return (void)c, 0; }
API Status fmi2Reset(Component c) { return (void)c, 3; }
API Status fmi2GetReal(Component c, const unsigned vr[], size_t n, double value[]) {
    refresh(c);
    for (size_t i = 0; i < n; i++)
        value[i] = ((Model *)c)->v[vr[i]];
    return 0;
}
API Status fmi2SetReal(Component c, const unsigned vr[], size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++)
        ((Model *)c)->v[vr[i]] = value[i];
    return 0;
}
API Status fmi2DoStep(Component c, double t, double h, int keep) {
    Model *m = c;
    (void)t, (void)keep;
    double a = m->v[A], held = m->v[B] * m->v[U];
    m->v[X] = a == 0 ? m->v[X] + h * held : exp(a * h) * m->v[X] + expm1(a * h) / a * held;
    return 0;
}
API Status fmi2GetFMUstate(Component c, void **s) {
    if (!*s)
        *s = malloc(sizeof(Model));
    return *s ? memcpy(*s, c, sizeof(Model)), 0 : 3;
}
API Status fmi2SetFMUstate(Component c, void *s) { return memcpy(c, s, sizeof(Model)), 0; }
API Status fmi2FreeFMUstate(Component c, void **s) { return (void)c, free(*s), *s = 0, 0; }
API Status fmi2SerializedFMUstateSize(Component c, void *s, size_t *n) {
    return (void)c, (void)s, *n = sizeof(Model), 0;
}
API Status fmi2SerializeFMUstate(Component c, void *s, char *b, size_t n) {
    return (void)c, memcpy(b, s, n), 0;
}
API Status fmi2DeSerializeFMUstate(Component c, const char *b, size_t n, void **s) {
    if (!*s)
        *s = malloc(sizeof(Model));
    return (void)c, *s ? memcpy(*s, b, n), 0 : 3;
}
