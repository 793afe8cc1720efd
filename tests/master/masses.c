/* One mass of the two-mass oscillator, advanced exactly for inputs held over the step.

   m x'' = -c x - d x' + (side > 0 ? c12 (u1 - x) + d12 (u2 - x') : u1)

   side 0: u1 is the force of the coupling spring; side 1: u1, u2 are position and speed of the
   other mass, and the force of the coupling spring is the output f, which depends on them at once.

   reals: 0 u1, 1 u2, 2 x, 3 v, 4 f, 5 m, 6 c, 7 d, 8 c12, 9 d12, 10 side. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { U1, U2, X, V, F, MASS, C_, D_, C12, D12, SIDE, COUNT };
typedef struct {
    double v[COUNT];
} Model;
typedef void *Component;
typedef int Status;
#define API __attribute__((visibility("default")))
#define N 4

static void multiply(double a[N][N], double b[N][N], double out[N][N]) {
    double found[N][N];
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            found[i][j] = 0;
            for (int k = 0; k < N; k++)
                found[i][j] += a[i][k] * b[k][j];
        }
    memcpy(out, found, sizeof found);
}
/* exp of [A B; 0 0] h by a series, scaled and squared: states, then held inputs */
static void advance(Model *m, double h) {
    double *p = m->v, out = p[SIDE] > 0;
    double k = p[C_] + out * p[C12], damping = p[D_] + out * p[D12];
    double a[N][N] = {{0, 1, 0, 0},
                      {-k / p[MASS], -damping / p[MASS], (out ? p[C12] : 1) / p[MASS],
                       (out ? p[D12] : 0) / p[MASS]},
                      {0, 0, 0, 0},
                      {0, 0, 0, 0}};
    double e[N][N] = {{0}}, term[N][N] = {{0}};
    int squarings = 10;
    for (int i = 0; i < N; i++) {
        e[i][i] = term[i][i] = 1;
        for (int j = 0; j < N; j++)
            a[i][j] *= h / (1 << squarings);
    }
    for (int n = 1; n < 14; n++) {
        multiply(term, a, term);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++)
                e[i][j] += term[i][j] /= n;
    }
    for (int n = 0; n < squarings; n++)
        multiply(e, e, e);
    double s[N] = {p[X], p[V], p[U1], p[U2]}, next[2] = {0, 0};
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < N; j++)
            next[i] += e[i][j] * s[j];
    p[X] = next[0], p[V] = next[1];
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
    if (m)
        m->v[MASS] = 1;
    return m;
}
API void fmi2FreeInstance(Component c) { free(c); }
API Status fmi2SetupExperiment(Component c, int t, double tol, double start, int s, double stop) {
    return (void)c, (void)t, (void)tol, (void)start, (void)s, (void)stop, 0;
}
API Status fmi2EnterInitializationMode(Component c) { return (void)c, 0; }
API Status fmi2ExitInitializationMode(Component c) { return (void)c, 0; }
API Status fmi2Terminate(Component c) { return (void)c, 0; }
API Status fmi2Reset(Component c) { return (void)c, 3; }
API Status fmi2GetReal(Component c, const unsigned vr[], size_t n, double value[]) {
    double *p = ((Model *)c)->v;
    p[F] = p[C12] * (p[X] - p[U1]) + p[D12] * (p[V] - p[U2]);
    for (size_t i = 0; i < n; i++)
        value[i] = p[vr[i]];
    return 0;
}
API Status fmi2SetReal(Component c, const unsigned vr[], size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++)
        ((Model *)c)->v[vr[i]] = value[i];
    return 0;
}
API Status fmi2DoStep(Component c, double t, double h, int keep) {
    (void)t, (void)keep;
    return advance(c, h), 0;
}
