/* A slave of FMI 3.0 with events, for events.py, which declares what a test needs of it.

   It holds the master to the standard: a Clock that ticks, a discrete input or an update of
   discrete states outside of event mode, a clocked variable that is read or set while its Clock does
   not tick, be it in the initialisation, and a step in event mode are errors.

   `tick` (time-based): ticks counts it, sampled is the input x at it; every second one lets the
   output Clock fired tick. `alarm` (countdown): begins `alarm_after` after each change of u; alarms
   counts it. `trigger` (triggered): triggers counts it, fired ticks with it. When u changes, y is
   u + 1 after two updates of discrete states, up to limit. At event_at a time event adds 100 to y.
   At stop_early a step returns with an event, which adds 1000 to y. echo is message, reversed. */

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#pragma GCC diagnostic ignored "-Wunused-parameter" /* FMI prescribes more than a slave reads */

enum { TICK = 1, ALARM, TRIGGER, FIRED };
enum { TICKS = 10, ALARMS, TRIGGERS, LIMIT, U = 20, Y };
enum { X = 30, SAMPLED, RAMP, EVENT_AT, ALARM_AFTER, STOP_EARLY, GROWTH, INTERVAL, Z };
enum { MESSAGE = 40, ECHO, N = 50, ROW, DOUBLED };
enum { LONGEST = 64 };

typedef struct {
    fmi3LogMessageCallback log;
    fmi3IntermediateUpdateCallback update;
    fmi3InstanceEnvironment environment;
    bool events, early, event_mode, initialising;
    bool ticking[FIRED + 1], evaluated, jumped;
    bool event, alarm_new;
    int iterations;
    fmi3Int32 ticks, alarms, triggers, limit, u, seen, y;
    fmi3Float64 time, x, z, sampled, event_at, alarm_after, stop_early, growth, interval;
    fmi3UInt64 n;
    fmi3Float64 row[LONGEST];
    size_t size;
    fmi3Byte message[LONGEST], echo[LONGEST];
} Model;

static fmi3Status wrong(Model *m, const char *what, unsigned reference) {
    char text[200];
    snprintf(text, sizeof text, "%s (%u) at t = %.17g", what, reference, m->time);
    m->log(m->environment, fmi3Error, "logStatusError", text);
    return fmi3Error;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference required[], size_t count, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    Model *m = calloc(1, sizeof(Model));
    *m = (Model){.log = log, .environment = environment, .events = events, .early = early,
                 .update = count ? update : NULL, .limit = 5, .event_at = 1e300, .growth = 1,
                 .alarm_after = 1e300, .stop_early = 1e300, .interval = 0.1, .n = 2};
    return m;
}
fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock) {
    return fmi3InstantiateCoSimulation(name, token, resources, visible, logging, false, false, NULL,
                                       0, environment, log, NULL);
}
void fmi3FreeInstance(fmi3Instance it) { free(it); }
fmi3Status fmi3SetDebugLogging(fmi3Instance it, fmi3Boolean on, size_t n, const fmi3String k[]) {
    return fmi3OK;
}
fmi3Status fmi3EnterConfigurationMode(fmi3Instance it) { return fmi3OK; }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance it) { return fmi3OK; }
fmi3Status fmi3EnterInitializationMode(fmi3Instance it, fmi3Boolean d, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean s, fmi3Float64 stop) {
    Model *m = it;
    m->time = start, m->initialising = true;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance it) {
    Model *m = it;
    m->initialising = false, m->event_mode = m->events, m->seen = m->u;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance it) { return fmi3OK; }
fmi3Status fmi3EnterEventMode(fmi3Instance it) {
    Model *m = it;
    if (!m->events || m->event_mode)
        return wrong(m, "entering event mode", 0);
    m->event_mode = true;
    return fmi3OK;
}
fmi3Status fmi3EnterStepMode(fmi3Instance it) {
    Model *m = it;
    if (!m->event_mode)
        return wrong(m, "entering step mode", 0);
    m->event_mode = false;
    return fmi3OK;
}

/* What the Clocks do that tick, once per super-dense instant. */
static void evaluate(Model *m) {
    if (!m->evaluated && m->ticking[TICK]) {
        m->ticks++, m->sampled = m->x, m->evaluated = true;
        m->ticking[FIRED] = m->ticks % 2 == 0;
    }
    if (!m->evaluated && m->ticking[TRIGGER])
        m->triggers++, m->ticking[FIRED] = m->evaluated = true;
    if (!m->evaluated && m->ticking[ALARM])
        m->alarms++, m->evaluated = true;
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance it, fmi3ValueReference clock,
                                      fmi3Float64 time) {
    Model *m = it;
    m->time = time, m->ticking[clock] = true;
    evaluate(m);
    m->ticking[clock] = m->evaluated = false;
    return fmi3OK;
}
fmi3Status fmi3SetClock(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                        const fmi3Clock values[]) {
    Model *m = it;
    if (!m->event_mode)
        return wrong(m, "a Clock ticks outside of event mode", v[0]);
    for (size_t i = 0; i < n; i++)
        m->ticking[v[i]] = values[i];
    return fmi3OK;
}
fmi3Status fmi3GetClock(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                        fmi3Clock values[]) {
    Model *m = it;
    if (!m->event_mode)
        return wrong(m, "a Clock is read outside of event mode", v[0]);
    evaluate(m);
    for (size_t i = 0; i < n; i++)
        values[i] = m->ticking[v[i]];
    return fmi3OK;
}
static fmi3IntervalQualifier interval(Model *m, unsigned reference, double *value) {
    if (reference == ALARM) {
        bool is_new = m->alarm_new;
        m->alarm_new = false, *value = m->alarm_after;
        return is_new ? fmi3IntervalChanged : fmi3IntervalNotYetKnown;
    }
    *value = m->interval * pow(m->growth, m->ticks);
    return fmi3IntervalChanged;
}
fmi3Status fmi3GetIntervalDecimal(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    for (size_t i = 0; i < n; i++)
        qualifiers[i] = interval(it, v[i], intervals + i);
    return fmi3OK;
}
fmi3Status fmi3GetIntervalFraction(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[]) {
    for (size_t i = 0; i < n; i++) /* thirds of a second, which no double is */
        counters[i] = 1, resolutions[i] = 3, qualifiers[i] = fmi3IntervalChanged;
    return fmi3OK;
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                               fmi3Float64 shifts[]) {
    for (size_t i = 0; i < n; i++)
        shifts[i] = 0.05;
    return fmi3OK;
}
fmi3Status fmi3GetShiftFraction(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                                fmi3UInt64 counters[], fmi3UInt64 resolutions[]) {
    for (size_t i = 0; i < n; i++)
        counters[i] = 1, resolutions[i] = 7;
    return fmi3OK;
}
fmi3Status fmi3SetIntervalDecimal(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                                  const fmi3Float64 intervals[]) {
    Model *m = it;
    if (!m->initialising)
        return wrong(m, "an interval is set outside of the initialisation", v[0]);
    m->interval = intervals[0];
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance it, fmi3Boolean *need, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *defined, fmi3Float64 *next) {
    Model *m = it;
    if (!m->event_mode)
        return wrong(m, "an update outside of event mode", 0);
    evaluate(m);
    *need = *terminate = *nominals = *values = false;
    if (m->seen != m->u && m->iterations++ == 0)
        *need = true;
    else if (m->seen != m->u) {
        m->seen = m->u, m->iterations = 0, m->alarm_new = m->alarm_after < 1e300;
        if (m->u < m->limit)
            m->y = m->u + 1;
    }
    if (m->event)
        m->y += 1000, m->event = false;
    if (m->time >= m->event_at)
        m->y += 100, m->event_at = 1e300;
    *defined = m->event_at < 1e300, *next = m->event_at;
    memset(m->ticking, 0, sizeof m->ticking);
    m->evaluated = false;
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance it, fmi3Float64 time, fmi3Float64 step, fmi3Boolean final,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early,
                      fmi3Float64 *last) {
    Model *m = it;
    double until = time + step;
    if (m->event_mode || fabs(time - m->time) > 1e-9)
        return wrong(m, m->event_mode ? "a step in event mode" : "a step from elsewhere", 0);
    *event = *end = *early = false;
    bool stops = until > m->stop_early && m->stop_early >= time;
    if (stops)
        *event = m->event = m->events, *early = m->early;
    if (*early)
        until = m->stop_early;
    for (int i = 1; m->update && i <= 4; i++) {
        fmi3Boolean wanted;
        fmi3Float64 at;
        m->time = time + i * (until - time) / 4;
        m->update(m->environment, m->time, false, true, i != 2, false, &wanted, &at);
    }
    if (stops)
        m->stop_early = 1e300;
    m->time = *last = until;
    return fmi3OK;
}

static fmi3Status refused(Model *m, unsigned reference) {
    if (!m->events)
        return fmi3OK;
    unsigned clock = reference == TICKS || reference == SAMPLED ? TICK
                     : reference == ALARMS                      ? ALARM
                     : reference == TRIGGERS                    ? TRIGGER
                                                                : 0;
    if (clock && !m->ticking[clock])
        return wrong(m, "a clocked variable is read while its Clock does not tick", reference);
    return fmi3OK;
}
fmi3Status fmi3GetInt32(fmi3Instance it, const fmi3ValueReference v[], size_t n, fmi3Int32 x[],
                        size_t count) {
    Model *m = it;
    evaluate(m);
    for (size_t i = 0; i < n; i++) {
        if (refused(m, v[i]))
            return fmi3Error;
        x[i] = v[i] == TICKS      ? m->ticks
               : v[i] == ALARMS   ? m->alarms
               : v[i] == TRIGGERS ? m->triggers
               : v[i] == Y        ? m->y
                                  : m->u;
    }
    return fmi3OK;
}
fmi3Status fmi3SetInt32(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                        const fmi3Int32 x[], size_t count) {
    Model *m = it;
    for (size_t i = 0; i < n; i++)
        if (v[i] == LIMIT)
            m->limit = x[i];
        else if (x[i] != m->u && m->events && !m->event_mode && m->time > 0)
            return wrong(m, "a discrete input changes outside of event mode", v[i]);
        else
            m->u = x[i];
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                          fmi3Float64 x[], size_t count) {
    Model *m = it;
    evaluate(m);
    for (size_t i = 0, j = 0; i < n; i++) {
        if (refused(m, v[i]))
            return fmi3Error;
        if (v[i] == DOUBLED)
            for (fmi3UInt64 e = 0; e < m->n; e++)
                x[j++] = 2 * m->row[e];
        else
            x[j++] = v[i] == SAMPLED ? m->sampled : v[i] == RAMP ? m->time : v[i] == Z ? m->z : m->x;
    }
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                          const fmi3Float64 x[], size_t count) {
    Model *m = it;
    for (size_t i = 0, j = 0; i < n; i++)
        switch (v[i]) {
        case Z:
            if (!m->ticking[TRIGGER])
                return wrong(m, "a clocked variable is set while its Clock does not tick", Z);
            m->z = x[j++];
            break;
        case X:
            m->x = x[j++];
            m->sampled = m->ticking[TICK] ? m->x : m->sampled;
            break;
        case EVENT_AT: m->event_at = x[j++]; break;
        case ALARM_AFTER: m->alarm_after = x[j++]; break;
        case STOP_EARLY: m->stop_early = x[j++]; break;
        case GROWTH: m->growth = x[j++]; break;
        case INTERVAL: m->interval = x[j++]; break;
        case ROW:
            for (fmi3UInt64 e = 0; e < m->n; e++)
                m->row[e] = x[j++];
        }
    return fmi3OK;
}
fmi3Status fmi3SetUInt64(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                         const fmi3UInt64 x[], size_t count) {
    ((Model *)it)->n = x[0];
    return fmi3OK;
}
fmi3Status fmi3SetBinary(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                         const size_t sizes[], const fmi3Binary values[], size_t count) {
    Model *m = it;
    m->size = sizes[0];
    memcpy(m->message, values[0], m->size);
    return fmi3OK;
}
fmi3Status fmi3GetBinary(fmi3Instance it, const fmi3ValueReference v[], size_t n, size_t sizes[],
                         fmi3Binary values[], size_t count) {
    Model *m = it;
    for (size_t i = 0; i < m->size; i++)
        m->echo[i] = m->message[m->size - 1 - i];
    sizes[0] = m->size, values[0] = m->echo;
    return fmi3OK;
}
fmi3Status fmi3GetFMUState(fmi3Instance it, fmi3FMUState *state) {
    *state = memcpy(*state ? *state : malloc(sizeof(Model)), it, sizeof(Model));
    return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance it, fmi3FMUState state) {
    memcpy(it, state, sizeof(Model));
    return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance it, fmi3FMUState *state) {
    free(*state), *state = NULL;
    return fmi3OK;
}
