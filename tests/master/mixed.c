/* A slave in C with variables of every type, which fails when it is told to.

   reals: 0 input u, 3 output y = 2 u at once, 6 parameter fail_at; integers: 1 input j,
   4 output n (steps so far, plus j); booleans: 2 input c, 5 output f = not c, as of the last
   step; 7 parameter status: what fails returns it, 8 parameter fail_get (boolean): reading
   fails in place of stepping. */

#include "slave.h"

struct Model {
    Log log;
    double u, time, fail_at;
    int j, n, c, f, status, fail_get;
};

static int begin(Model *m, const Log *log) {
    m->log = *log;
    m->log.category = "logStatus";
    m->fail_at = 1e300;
    return m->status = 3;
}
static int get(Model *m) {
    if (m->fail_get && m->time >= m->fail_at)
        return say(&m->log, m->status, "cannot be read any more");
    return fmi2OK;
}
static int step(Model *m, double t, double h) {
    if (!m->fail_get && t >= m->fail_at)
        return say(&m->log, m->status, "it broke");
    m->time = t + h;
    m->n++;
    m->f = !m->c;
    if (m->n % 4 == 0)
        say(&m->log, fmi2Warning, "four more");
    return fmi2OK;
}
static int terminate(Model *m) { return say(&m->log, fmi2OK, "terminated"); }
static const Behaviour behaviour = {
    sizeof(Model), .begin = begin, .step = step, .terminate = terminate};

GETTER(fmi2, Real, get(m), reference == 3 ? 2.0 * m->u : reference == 0 ? m->u : m->fail_at)
SETTER(fmi2, Real, fmi2OK, *(reference == 0 ? &m->u : &m->fail_at))
GETTER(fmi2, Integer, fmi2OK, reference == 4 ? m->n + m->j : m->status)
SETTER(fmi2, Integer, fmi2OK, *(reference == 1 ? &m->j : &m->status))
GETTER(fmi2, Boolean, fmi2OK, reference == 5 ? m->f : m->fail_get)
SETTER(fmi2, Boolean, fmi2OK, *(reference == 2 ? &m->c : &m->fail_get))
