/* A slave of FMI 1.0 for co-simulation: every type, messages with arguments, every way to end.

   Real: 0 input u, 1 output x, whose slope is gain u, 2 parameter gain, 3 output gap: how far the
   slave was from where a step began. Integer: 0 input n, also output m; 1 parameter mode, 2 output
   repeated: steps that were no new ones, 3 output tasks: initialisations. Boolean: 0 input b, 1
   output c = b. String: 0 input s, 1 output t = s. In the fourth step mode 1 discards at the end of
   the run, 2 discards half of the step, 3 is an error, 4 fatal, 5 pending, 6 a warning. */

#include <stdio.h>
#include <string.h>

#include "fmi1Functions.h"

#pragma GCC diagnostic ignored "-Wunused-parameter" /* FMI prescribes more than a slave reads */

#define NAME(F) old_fmi1_fmi##F

typedef struct {
    fmi1CallbackFunctions calls;
    char name[100], s[100];
    double u, x, gain, gap, time, reached;
    int n, mode, repeated, tasks, steps, logging;
    char b;
} Model;

#define SAY(m, status, ...) (m)->calls.logger(m, (m)->name, status, "old", __VA_ARGS__)

const char *NAME(GetVersion)(void) { return "1.0"; }
const char *NAME(GetTypesPlatform)(void) { return "standard32"; }

static void begin(Model *m) {
    m->u = m->x = m->gap = m->time = 0.0, m->gain = 1.0;
    m->n = m->mode = m->repeated = m->tasks = m->steps = 0, m->b = 0;
    strcpy(m->s, "old");
}

fmi1Component NAME(InstantiateSlave)(fmi1String name, fmi1String guid, fmi1String place,
                                     fmi1String type, fmi1Real timeout, fmi1Boolean visible,
                                     fmi1Boolean interactive, fmi1CallbackFunctions calls,
                                     fmi1Boolean logging) {
    if (strcmp(guid, "{old}") || strcmp(type, "application/x-fmu-sharedlibrary") || visible ||
        interactive || calls.stepFinished)
        return NULL;
    Model *m = calls.allocateMemory(1, sizeof *m);
    m->calls = calls, m->logging = logging;
    snprintf(m->name, sizeof m->name, "%s", name);
    begin(m);
    if (logging)
        SAY(m, fmi1OK, "%s, #r2#: %s %d %g", name, strncmp(place, "file:///", 8) ? "no URI" : "URI",
            7, 0.5);
    return m;
}
void NAME(FreeSlaveInstance)(fmi1Component c) { ((Model *)c)->calls.freeMemory(c); }
fmi1Status NAME(SetDebugLogging)(fmi1Component c, fmi1Boolean on) {
    return ((Model *)c)->logging = on, fmi1OK;
}
fmi1Status NAME(InitializeSlave)(fmi1Component c, fmi1Real start, fmi1Boolean ends, fmi1Real end) {
    Model *m = c;
    m->time = start, m->tasks++;
    if (ends && end < start)
        return fmi1Error;
    if (m->mode == 9) {
        SAY(m, fmi1Error, "mode %d is not allowed", m->mode);
        return fmi1Error;
    }
    return fmi1OK;
}
fmi1Status NAME(TerminateSlave)(fmi1Component c) {
    if (((Model *)c)->logging)
        SAY((Model *)c, fmi1OK, "terminated after %d steps", ((Model *)c)->steps);
    return fmi1OK;
}
fmi1Status NAME(ResetSlave)(fmi1Component c) { return begin(c), fmi1OK; }
fmi1Status NAME(DoStep)(fmi1Component c, fmi1Real time, fmi1Real size, fmi1Boolean is_new) {
    Model *m = c;
    m->gap = time - m->time;
    m->repeated += is_new != fmi1True;
    if (++m->steps == 4 && m->mode) {
        m->reached = m->mode == 1 ? time + size : time + size / 2;
        SAY(m, m->mode == 6 ? fmi1Warning : fmi1Error, "mode %d", m->mode);
        return (fmi1Status)(int[]){0, 2, 2, 3, 4, 5, 1}[m->mode];
    }
    m->x += size * m->gain * m->u;
    m->time = time + size;
    return fmi1OK;
}
fmi1Status NAME(GetRealStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1Real *value) {
    if (kind != fmi1LastSuccessfulTime)
        return fmi1Discard;
    *value = ((Model *)c)->reached;
    return fmi1OK;
}

/* Nobody calls these, and some importers look them up. */
#define REFUSED(F)                                                                                 \
    fmi1Status NAME(F)(fmi1Component c) { return fmi1Error; }
REFUSED(GetStatus)
REFUSED(GetIntegerStatus)
REFUSED(GetBooleanStatus)
REFUSED(GetStringStatus)
REFUSED(CancelStep)
REFUSED(SetRealInputDerivatives)
REFUSED(GetRealOutputDerivatives)

#define MOVES(KIND, T, OF)                                                                         \
    fmi1Status NAME(Get##KIND)(fmi1Component c, const fmi1ValueReference r[], size_t n, T v[]) {   \
        for (size_t i = 0; i < n; i++)                                                             \
            v[i] = *OF((Model *)c, r[i]);                                                          \
        return fmi1OK;                                                                             \
    }                                                                                              \
    fmi1Status NAME(Set##KIND)(fmi1Component c, const fmi1ValueReference r[], size_t n,            \
                               const T v[]) {                                                      \
        for (size_t i = 0; i < n; i++)                                                             \
            *OF((Model *)c, r[i]) = v[i];                                                          \
        return fmi1OK;                                                                             \
    }
static double *real(Model *m, unsigned r) {
    return (double *[]){&m->u, &m->x, &m->gain, &m->gap}[r];
}
static int *integer(Model *m, unsigned r) {
    return (int *[]){&m->n, &m->mode, &m->repeated, &m->tasks}[r];
}
static char *boolean(Model *m, unsigned r) { return &m->b; }
MOVES(Real, fmi1Real, real)
MOVES(Integer, fmi1Integer, integer)
MOVES(Boolean, fmi1Boolean, boolean)

fmi1Status NAME(GetString)(fmi1Component c, const fmi1ValueReference r[], size_t n,
                           fmi1String v[]) {
    for (size_t i = 0; i < n; i++)
        v[i] = ((Model *)c)->s;
    return fmi1OK;
}
fmi1Status NAME(SetString)(fmi1Component c, const fmi1ValueReference r[], size_t n,
                           const fmi1String v[]) {
    for (size_t i = 0; i < n; i++)
        snprintf(((Model *)c)->s, sizeof ((Model *)c)->s, "%s", v[i]);
    return fmi1OK;
}
