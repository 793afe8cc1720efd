/* A slave of FMI 2.0 that says a lot, in the ways that exporters do; functions that nobody calls
   are left out.

   Real: 0 input u, 1 output y = u. String: 2 input greeting, 3 output reply = greeting. Integer:
   4 parameter mode, 6 an enumeration. Boolean: 5 input b, 7 output c = b. In the fourth step mode
   1 asks for the end, 2 discards without asking, 3 is fatal, 4 says that it returns an error but asks,
   5 logs an error without meaning and asks. */

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

typedef struct {
    const fmi2CallbackFunctions *calls;
    char *name;
    double u;
    int mode, level, b, steps;
    char greeting[64];
} Model;

#define SAY(m, status, category, ...)                                                              \
    (m)->calls->logger((m)->calls->componentEnvironment, (m)->name, status, category, __VA_ARGS__)

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String where,
                              const fmi2CallbackFunctions *calls, fmi2Boolean visible,
                              fmi2Boolean logging) {
    (void)visible;
    Model *m = calls->allocateMemory(1, sizeof(Model));
    m->calls = calls;
    m->name = calls->allocateMemory(strlen(name) + 1, 1);
    strcpy(m->name, name);
    strcpy(m->greeting, "hello");
    m->level = 1;
    SAY(m, fmi2OK, "logMade", "%s %d %s %s %d", guid, (int)type, name,
        strncmp(where, "file:///", 8) ? "no URI" : "URI", logging);
    return m;
}
void fmi2FreeInstance(fmi2Component c) {
    Model *m = c;
    SAY(m, fmi2OK, "logMade", "freed");
    m->calls->freeMemory(m->name);
    m->calls->freeMemory(m);
}
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String k[]) {
    SAY((Model *)c, fmi2OK, "logMade", "logging %d of %zu: %s", on, n, n ? k[0] : "-");
    return fmi2OK;
}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tol, fmi2Real start,
                               fmi2Boolean s, fmi2Real stop) {
    return (void)c, (void)t, (void)tol, (void)start, (void)s, (void)stop, fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) {
    SAY((Model *)c, fmi2Warning, "logMade", "terminated");
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2Real x[]) {
    for (size_t i = 0; i < n; i++) x[i] = ((Model *)c)->u + 0 * v[i];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference v[], size_t n,
                       const fmi2Real x[]) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->u = x[i] + 0 * v[i];
    return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference v[], size_t n, int x[]) {
    for (size_t i = 0; i < n; i++) x[i] = v[i] == 4 ? ((Model *)c)->mode : ((Model *)c)->level;
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference v[], size_t n, const int x[]) {
    for (size_t i = 0; i < n; i++) *(v[i] == 4 ? &((Model *)c)->mode : &((Model *)c)->level) = x[i];
    return fmi2OK;
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference v[], size_t n, int x[]) {
    for (size_t i = 0; i < n; i++) x[i] = ((Model *)c)->b + 0 * (int)v[i];
    return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference v[], size_t n, const int x[]) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->b = x[i] + 0 * (int)v[i];
    return fmi2OK;
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2String x[]) {
    for (size_t i = 0; i < n; i++) x[i] = ((Model *)c)->greeting + 0 * v[i];
    return fmi2OK;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference v[], size_t n,
                         const fmi2String x[]) {
    for (size_t i = 0; i < n; i++)
        snprintf(((Model *)c)->greeting, sizeof ((Model *)c)->greeting, "%s", x[i] + 0 * v[i]);
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_way_back) {
    Model *m = c;
    SAY(m, fmi2OK, "logStep", "step %d from %.2f s by %g, #r0# %s #s2# ## %d%% %d", m->steps, t, h,
        "and", 50, no_way_back);
    if (m->steps++ < 3 || m->mode == 0)
        return fmi2OK;
    if (m->mode == 3)
        SAY(m, fmi2Fatal, "logStep", "everything is lost");
    if (m->mode == 4 || m->mode == 5)
        SAY(m, fmi2Error, m->mode == 4 ? "logStatusError" : "logStep", "it broke");
    return m->mode == 3 ? fmi2Fatal : fmi2Discard;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    *value = ((Model *)c)->mode != 2;
    return kind == fmi2Terminated ? fmi2OK : fmi2Error;
}
