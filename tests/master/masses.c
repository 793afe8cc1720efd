/* One mass of the two-mass oscillator, advanced exactly for inputs held over the step.

   m x'' = -c x - d x' + (side > 0 ? c12 (u1 - x) + d12 (u2 - x') : u1)

   side 0: u1 is the force of the coupling spring; side 1: u1, u2 are position and speed of the
   other mass, and the force of the coupling spring is the output f, which depends on them at once.

   reals: 0 u1, 1 u2, 2 x, 3 v, 4 f, 5 m, 6 c, 7 d, 8 c12, 9 d12, 10 side. */

#include "slave.h"

enum { U1, U2, X, V, F, MASS, C_, D_, C12, D12, SIDE, COUNT };
struct Model {
    double v[COUNT];
};
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
static int step(Model *m, double t, double h) {
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
    return fmi2OK;
}
static int begin(Model *m, const Log *log) { return m->v[MASS] = 1; }
static int refresh(double *p) {
    p[F] = p[C12] * (p[X] - p[U1]) + p[D12] * (p[V] - p[U2]);
    return fmi2OK;
}
static const Behaviour behaviour = {sizeof(Model), .begin = begin, .step = step, .reset = refuse};

GETTER(fmi2, Real, refresh(m->v), m->v[reference])
SETTER(fmi2, Real, fmi2OK, m->v[reference])
