/* The smallest FMI 2.0 co-simulation FMU that does something: x' = u - x, N times, one Euler
   step per communication step. What is left of a run of two of them is the master. */

#include <stdlib.h>

typedef struct {
    double x[N], u[N];
} Model;

typedef void *Component;
typedef int Status;

#define API __attribute__((visibility("default")))

API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }
API Status fmi2SetDebugLogging(Component c, int on, size_t n, const char *const k[]) {
    (void)c, (void)on, (void)n, (void)k;
    return 0;
}
API Component fmi2Instantiate(const char *name, int type, const char *guid, const char *where,
                              const void *callbacks, int visible, int logging) {
    (void)name, (void)type, (void)guid, (void)where, (void)callbacks, (void)visible, (void)logging;
    Model *m = calloc(1, sizeof(Model));
    for (int i = 0; m && i < N; i++)
        m->x[i] = 1.0;
    return m;
}
API void fmi2FreeInstance(Component c) { free(c); }
API Status fmi2SetupExperiment(Component c, int t, double tol, double start, int s, double stop) {
    (void)c, (void)t, (void)tol, (void)start, (void)s, (void)stop;
    return 0;
}
API Status fmi2EnterInitializationMode(Component c) { return (void)c, 0; }
API Status fmi2ExitInitializationMode(Component c) { return (void)c, 0; }
API Status fmi2Terminate(Component c) { return (void)c, 0; }
API Status fmi2Reset(Component c) { return (void)c, 0; }
API Status fmi2GetReal(Component c, const unsigned vr[], size_t n, double value[]) {
    Model *m = c;
    for (size_t i = 0; i < n; i++)
        value[i] = m->x[vr[i]];
    return 0;
}
API Status fmi2SetReal(Component c, const unsigned vr[], size_t n, const double value[]) {
    Model *m = c;
    for (size_t i = 0; i < n; i++)
        m->u[vr[i] - N] = value[i];
    return 0;
}
API Status fmi2DoStep(Component c, double t, double h, int keep) {
    Model *m = c;
    (void)t, (void)keep;
    for (int i = 0; i < N; i++)
        m->x[i] += h * (m->u[i] - m->x[i]);
    return 0;
}
#define REFUSED(name, ...)                                                                         \
    API Status name(__VA_ARGS__) { return 3; }
REFUSED(fmi2GetInteger, Component c, const unsigned *v, size_t n, int *x)
REFUSED(fmi2GetBoolean, Component c, const unsigned *v, size_t n, int *x)
REFUSED(fmi2GetString, Component c, const unsigned *v, size_t n, const char **x)
REFUSED(fmi2SetInteger, Component c, const unsigned *v, size_t n, const int *x)
REFUSED(fmi2SetBoolean, Component c, const unsigned *v, size_t n, const int *x)
REFUSED(fmi2SetString, Component c, const unsigned *v, size_t n, const char *const *x)
REFUSED(fmi2GetFMUstate, Component c, void **s)
REFUSED(fmi2SetFMUstate, Component c, void *s)
REFUSED(fmi2FreeFMUstate, Component c, void **s)
REFUSED(fmi2SerializedFMUstateSize, Component c, void *s, size_t *n)
REFUSED(fmi2SerializeFMUstate, Component c, void *s, char *b, size_t n)
REFUSED(fmi2DeSerializeFMUstate, Component c, const char *b, size_t n, void **s)
REFUSED(fmi2GetDirectionalDerivative, Component c, const unsigned *u, size_t n, const unsigned *k,
        size_t m, const double *d, double *r)
REFUSED(fmi2SetRealInputDerivatives, Component c, const unsigned *v, size_t n, const int *o,
        const double *x)
REFUSED(fmi2GetRealOutputDerivatives, Component c, const unsigned *v, size_t n, const int *o,
        double *x)
REFUSED(fmi2CancelStep, Component c)
REFUSED(fmi2GetStatus, Component c, int k, Status *v)
REFUSED(fmi2GetRealStatus, Component c, int k, double *v)
REFUSED(fmi2GetIntegerStatus, Component c, int k, int *v)
REFUSED(fmi2GetBooleanStatus, Component c, int k, int *v)
REFUSED(fmi2GetStringStatus, Component c, int k, const char **v)

/* The bound: what a master for these two FMUs alone would be. */
typedef Status Get(Component, const unsigned *, size_t, double *);
typedef Status Set(Component, const unsigned *, size_t, const double *);
typedef Status Step(Component, double, double, int);
API int bare_loop(Get *get_a, Set *set_a, Step *step_a, Component a, Get *get_b, Set *set_b,
                  Step *step_b, Component b, const unsigned *out, const unsigned *in, double h,
                  long steps) {
    double ya[N], yb[N];
    for (long k = 0; k < steps; k++)
        if (get_a(a, out, N, ya) || get_b(b, out, N, yb) || set_a(a, in, N, yb) ||
            set_b(b, in, N, ya) || step_a(a, (double)k * h, h, 1) || step_b(b, (double)k * h, h, 1))
            return 1;
    return 0;
}
