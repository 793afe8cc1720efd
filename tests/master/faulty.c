/* A slave of FMI 2.0 or 3.0 that fails where and when it is told to, and says what is done to it.

   0 input u, 1 output x: the sum of all u, each times its step; 2 parameter fail_in: a call of
   the list below; 3 parameter status: what that call returns, or, if negative, the signal that
   ends the process in it; 4 parameter fail_at: the time from which on it does. Status 1000: it
   never returns; 1001: it takes a gigabyte of memory; 1002: it prints 3000 lines; 2000 + n: it
   calls exit(n). */

#include <signal.h>

#define BOTH_VERSIONS
#include "slave.h"

enum { NOTHING, STEP, GET, SET, ENTER, EXIT, TERMINATE, FREE };

struct Model {
    Log log;
    double u, x, time, fail_at;
    int fail_in, status;
};

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
    return say(&m->log, m->status, "the <pump> has lost its prime");
}

static int step(Model *m, double t, double h) {
    int status = call(m, STEP, t);
    if (status == 0) {
        m->x += h * m->u;
        m->time = t + h;
    }
    return status;
}

static int begin(Model *m, const Log *log) { return m->log = *log, 1; }
static int enter(Model *m) { return call(m, ENTER, 0.0); }
static int leave(Model *m) { return call(m, EXIT, 0.0); }

static int terminate(Model *m) {
    say(&m->log, fmi2OK, "terminated");
    return call(m, TERMINATE, m->time);
}

static void end(Model *m) {
    call(m, FREE, m->time);
    say(&m->log, fmi2OK, "freed");
}

static const Behaviour behaviour = {
    sizeof(Model),
    .begin = begin, .enter = enter, .leave = leave, .step = step,
    .terminate = terminate, .reset = refuse, .end = end,
};

#define VALUES(V, Reals, Integers)                                                                 \
    GETTER(V, Reals, call(m, GET, m->time), reference == 0 ? m->u : m->x)                          \
    SETTER(V, Reals, call(m, SET, m->time), *(reference == 0 ? &m->u : &m->fail_at))               \
    SETTER(V, Integers, V##OK, *(reference == 2 ? &m->fail_in : &m->status))
VALUES(fmi2, Real, Integer)
VALUES(fmi3, Float64, Int32)
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    return *value = fmi2False, fmi2OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean keep,
                      fmi3Boolean *event, fmi3Boolean *ended, fmi3Boolean *early,
                      fmi3Float64 *reached) {
    int status = step(c, t, h);
    *event = *ended = *early = false;
    *reached = status ? t : t + h;
    return (fmi3Status)status;
}
