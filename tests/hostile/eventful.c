/* A slave of FMI 3.0 with events and Clocks that misbehaves where, when and how its parameters say.

   y is its time. `tick` ticks every 0.1 s, `beat` every 0.2 s and `third` every 1/3 s; a time event
   comes every 0.25 s. The parameters `fault` and `call` count along the lists below; the fault
   happens in that call from the time `at` on. A number that is wrong is the one which that call
   returns: the last successful time, the next event, an interval, a size, ... */

#include <math.h>
#include <signal.h>

#define BOTH_VERSIONS
#include "slave.h"

enum { /* calls */
    STEP, WITHIN, ENTER_EVENT, UPDATE, ENTER_STEP, TICK, INTERVAL, FRACTION, SHIFT, GET, BINARY,
    TEXT, LOG, FREE
};
enum { /* faults */
    NOTHING,
    /* the process ends, the call does not */
    SEGFAULT, ABORT, EXIT_0, HANG,
    /* statuses */
    ERROR, FATAL,
    /* instants and intervals */
    PAST, NEGATIVE, NOW, TINY, AHEAD, HUGE_NUMBER, NOT_A_NUMBER, INFINITE, NO_RESOLUTION,
    NO_QUALIFIER,
    /* events without an end, and the end at no time */
    ENDLESS, END,
    /* sizes */
    LARGE, LARGEST, NO_ADDRESS, LONG,
    /* what is called when the instance is freed */
    AFTER_THE_END
};
enum { TICKS = 1, BEATS, THIRDS, Y = 10, BLOB, WORDS, U, FAULT, CALL, AT };

struct Model {
    Log log;
    double time, at, u;
    int32_t fault, call;
    int event_mode, ended;
};

static Log at_the_end; /* where to log after the instance is freed */

/* Every function begins with this: the fault that happens in it, or NOTHING. */
static int misbehaves(Model *m, int call) {
    static volatile int *nowhere;
    if (m->fault == NOTHING || m->call != call || m->time < m->at - 1e-9)
        return NOTHING;
    switch (m->fault) {
    case SEGFAULT: signal(SIGSEGV, SIG_DFL); *nowhere = 1; break;
    case ABORT: signal(SIGABRT, SIG_DFL); raise(SIGABRT); break;
    case EXIT_0: exit(0);
    case HANG: for (volatile int on = 1; on;) {} break;
    }
    return m->fault;
}

static fmi3Status status_of(Model *m, int fault) {
    if (fault == ERROR || fault == FATAL)
        return (fmi3Status)say(&m->log, fault == ERROR ? fmi3Error : fmi3Fatal,
                               "the <pump> has lost its prime");
    return fmi3OK;
}

/* An instant that is no such, in place of a true one. */
static double instant(const Model *m, int fault, double right) {
    switch (fault) {
    case PAST: return m->time - 0.05;
    case NEGATIVE: return -3.0;
    case NOW: return m->time;
    case TINY: return m->time + 1e-9;
    case AHEAD: return m->time + 0.5;
    case HUGE_NUMBER: return 1e300;
    case NOT_A_NUMBER: return NAN;
    case INFINITE: return INFINITY;
    default: return right;
    }
}

/* As `instant`, of an interval. */
static double interval(int fault, double right) {
    switch (fault) {
    case NEGATIVE: return -3.0;
    case NOW: return 0.0;
    case TINY: return 1e-12;
    case HUGE_NUMBER: return 1e300;
    case NOT_A_NUMBER: return NAN;
    case INFINITE: return INFINITY;
    default: return right;
    }
}

/* A text of so many letters, which is never freed. */
static char *long_text(size_t size) {
    static char *made;
    if (made == NULL && (made = malloc(size + 1)))
        memset(made, '~', size), made[size] = 0;
    return made;
}

static int begin(Model *m, const Log *log) { return m->log = *log, 1; }
static int setup(Model *m, double time) { return m->time = time, fmi3OK; }
static int leave(Model *m) { return m->event_mode = 1, fmi3OK; }
static void end(Model *m) {
    if (m->fault == AFTER_THE_END)
        at_the_end = m->log;
}
__attribute__((destructor)) static void unloaded(void) {
    fmi3Boolean early;
    fmi3Float64 when;
    if (at_the_end.three == NULL)
        return;
    say(&at_the_end, fmi3Error, "after the end");
    if (at_the_end.update)
        at_the_end.update(at_the_end.environment, 0.5, false, true, true, false, &early, &when);
}
static const Behaviour behaviour = {
    sizeof(Model), .begin = begin, .setup = setup, .leave = leave, .end = end,
};

/* --- events and steps */

#define MODE(name, which, mode)                                                                    \
    fmi3Status name(fmi3Instance c) {                                                              \
        Model *m = c;                                                                              \
        int status = status_of(m, misbehaves(m, which));                                           \
        m->event_mode = mode;                                                                      \
        return (fmi3Status)status;                                                                 \
    }
MODE(fmi3EnterEventMode, ENTER_EVENT, 1)
MODE(fmi3EnterStepMode, ENTER_STEP, 0)

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *need, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *defined, fmi3Float64 *next) {
    Model *m = c;
    int fault = misbehaves(m, UPDATE);
    *nominals = *values = false;
    *need = fault == ENDLESS;
    *terminate = fault == END;
    *defined = true;
    *next = instant(m, fault, 0.25 * (floor((m->time + 1e-9) / 0.25) + 1.0));
    return status_of(m, fault);
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean final,
                      fmi3Boolean *event, fmi3Boolean *ended, fmi3Boolean *early,
                      fmi3Float64 *reached) {
    Model *m = c;
    fmi3Boolean wanted;
    fmi3Float64 when;
    m->time = t;
    if (at_the_end.three)
        say(&at_the_end, fmi3OK, "by an instance that is freed");
    if (misbehaves(m, LOG) == LONG)
        m->log.three(m->log.environment, fmi3OK, m->log.category, long_text(50 << 20));
    int fault = misbehaves(m, STEP), within = misbehaves(m, WITHIN);
    *reached = instant(m, fault, t + h);
    *early = *event = fault >= PAST && fault <= INFINITE;
    *ended = fault == END;
    if (fault == END)
        *reached = NAN;
    double until = *early && (fault == NOW || fault == TINY) ? *reached : t + h;
    double told = instant(m, within, until);
    m->time = until;
    if (m->log.update)
        m->log.update(m->log.environment, told, false, true, true, false, &wanted, &when);
    return status_of(m, fault);
}

fmi3Status fmi3SetClock(fmi3Instance c, const unsigned v[], size_t n, const fmi3Clock x[]) {
    return status_of(c, misbehaves(c, TICK));
}

static fmi3IntervalQualifier qualifier(int fault) {
    return fault == NO_QUALIFIER ? (fmi3IntervalQualifier)77 : fmi3IntervalChanged;
}
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const unsigned v[], size_t n, fmi3Float64 x[],
                                  fmi3IntervalQualifier qualifiers[]) {
    int fault = v[0] == BEATS ? NOTHING : misbehaves(c, INTERVAL);
    for (size_t i = 0; i < n; i++)
        x[i] = interval(fault, v[i] == BEATS ? 0.2 : 0.1), qualifiers[i] = qualifier(fault);
    return status_of(c, fault);
}
fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const unsigned v[], size_t n,
                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[]) {
    int fault = misbehaves(c, FRACTION);
    for (size_t i = 0; i < n; i++) {
        counters[i] = fault == NOW ? 0 : 1, qualifiers[i] = qualifier(fault);
        resolutions[i] = fault == NO_RESOLUTION ? 0 : fault == TINY ? UINT64_MAX : 3;
    }
    return status_of(c, fault);
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const unsigned v[], size_t n, fmi3Float64 x[]) {
    int fault = misbehaves(c, SHIFT);
    for (size_t i = 0; i < n; i++)
        x[i] = interval(fault, 0.1);
    return status_of(c, fault);
}
fmi3Status fmi3GetShiftFraction(fmi3Instance c, const unsigned v[], size_t n,
                                fmi3UInt64 counters[], fmi3UInt64 resolutions[]) {
    int fault = misbehaves(c, SHIFT);
    for (size_t i = 0; i < n; i++)
        counters[i] = 1, resolutions[i] = fault == NO_RESOLUTION ? 0 : 3;
    return status_of(c, fault);
}

/* --- variables */

GETTER(fmi3, Float64, status_of(m, misbehaves(m, GET)), reference == Y ? m->time : m->at)
SETTER(fmi3, Float64, fmi3OK, *(reference == AT ? &m->at : &m->u))
SETTER(fmi3, Int32, fmi3OK, *(reference == FAULT ? &m->fault : &m->call))
fmi3Status fmi3GetString(fmi3Instance c, const unsigned v[], size_t n, fmi3String x[],
                         size_t values) {
    int fault = misbehaves(c, TEXT);
    for (size_t i = 0; i < n; i++)
        x[i] = fault == LONG ? long_text(100 << 20) : "as it should be";
    return status_of(c, fault);
}
fmi3Status fmi3GetBinary(fmi3Instance c, const unsigned v[], size_t n, size_t sizes[],
                         fmi3Binary x[], size_t values) {
    int fault = misbehaves(c, BINARY);
    sizes[0] = fault == LARGE     ? (size_t)1 << 40
               : fault == LARGEST ? SIZE_MAX
               : fault == LONG    ? (size_t)100 << 20
                                  : 2;
    x[0] = (fmi3Binary)(fault == LONG ? long_text(100 << 20) : "ok");
    if (fault == NO_ADDRESS)
        x[0] = NULL;
    return status_of(c, fault);
}
STATE_FUNCTIONS(fmi3, FMUState, Deserialize)
