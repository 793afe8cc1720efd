/* x' = a x + b u, advanced exactly for an input held over the step; y = c x + e u at once.
   Initially x = x0 + g u, so that the start may depend on what others start with.

   reals: 0 u, 1 x, 2 y, 3 a, 4 b, 5 x0, 6 c, 7 e, 8 g. */

#include <math.h>

#include "slave.h"

enum { U, X, Y, A, B, X0, C_, E_, G, COUNT };
struct Model {
    double v[COUNT];
    int initialising;
};

static int begin(Model *m, const Log *log) {
    m->v[A] = -1, m->v[B] = 1, m->v[C_] = 1;
    return m->initialising = 1;
}
static int refresh(Model *m) {
    if (m->initialising)
        m->v[X] = m->v[X0] + m->v[G] * m->v[U];
    m->v[Y] = m->v[C_] * m->v[X] + m->v[E_] * m->v[U];
    return fmi2OK;
}
static int leave(Model *m) {
    refresh(m);
    return m->initialising = 0;
}
static int step(Model *m, double t, double h) {
    double a = m->v[A], held = m->v[B] * m->v[U];
    m->v[X] = a == 0 ? m->v[X] + h * held : exp(a * h) * m->v[X] + expm1(a * h) / a * held;
    return fmi2OK;
}
static const Behaviour behaviour = {
    sizeof(Model), .begin = begin, .enter = refresh, .leave = leave, .step = step, .reset = refuse};

GETTER(fmi2, Real, refresh(m), m->v[reference])
SETTER(fmi2, Real, fmi2OK, m->v[reference])
STATE_FUNCTIONS(fmi2, FMUstate, DeSerialize)
