#include "instance.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "arithmetic.h"

static const char *const PHASES[] = {"instantiated", "initializing", "running", "terminated",
                                     "failed"};
static const char *const KINDS[] = {"Real", "Integer"};

/* ---- messages */

static const char *const CATEGORIES[] = {"logAll", "logStatusWarning", "logStatusDiscard",
                                         "logStatusError", "logStatusFatal"};
#define CATEGORY_COUNT (sizeof CATEGORIES / sizeof *CATEGORIES)

void instance_log(Instance *it, Status status, const char *text) {
    if (it->sink && (it->shown & (1u | 1u << status)))
        it->sink(it->owner, status, CATEGORIES[status], text);
}

Status instance_show(Instance *it, int on, size_t count, const char *const categories[]) {
    unsigned shown = on && count == 0 ? 1u : 0u;
    if (count > 0 && !categories) return instance_refuse(it, "the list of categories is missing");
    for (size_t i = 0; i < count; i++) {
        size_t k = 0;
        while (k < CATEGORY_COUNT && categories[i] && strcmp(categories[i], CATEGORIES[k]) != 0) k++;
        if (k == CATEGORY_COUNT || !categories[i])
            return instance_refuse(it, "there is no log category %s",
                                   categories[i] ? categories[i] : "(none)");
        if (on) shown |= 1u << k;
    }
    it->shown = shown;
    return FINE;
}

Status instance_refuse(Instance *it, const char *format, ...) {
    Message why;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(why.text, sizeof why.text, format, arguments);
    va_end(arguments);
    if (it->phase != FAILED) it->failure = why;
    it->phase = FAILED;
    instance_log(it, FAILURE, why.text);
    return FAILURE;
}

Status instance_decline(Instance *it, Status status, const char *format, ...) {
    Message why;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(why.text, sizeof why.text, format, arguments);
    va_end(arguments);
    instance_log(it, status, why.text);
    return status;
}

static Status not_now(Instance *it, const char *call) {
    if (it->phase != FAILED) return instance_refuse(it, "%s is not allowed while %s", call,
                                                    PHASES[it->phase]);
    return instance_decline(it, FAILURE,
                            "%s is not allowed while failed (%s); reset the instance, or set a "
                            "saved state",
                            call, it->failure.text);
}

/* ---- life cycle */

static void set_defaults(Instance *it) {
    for (size_t i = 0; i < (size_t)MODEL_VARIABLES; i++) it->v[i] = model_variables[i].start;
    it->phase = INSTANTIATED;
    it->time = 0.0;
    it->stop = INFINITY;
    it->stale = 0;
    it->failure.text[0] = 0;
}

Instance *instance_new(Sink *sink, void *owner, int logging) {
    Instance *it = calloc(1, sizeof *it);
    if (!it) return NULL;
    it->behaviour = behaviour_new();
    if (!it->behaviour) {
        free(it);
        return NULL;
    }
    it->sink = sink;
    it->owner = owner;
    /* why a call was refused is no debugging: it is told unless it is switched off later */
    it->shown = logging ? 1u : 1u << DISCARDED | 1u << FAILURE | 1u << FATAL;
    set_defaults(it);
    return it;
}

void instance_free(Instance *it) {
    if (it) behaviour_free(it->behaviour);
    free(it);
}

Status instance_set_experiment(Instance *it, double start, double stop) {
    if (it->phase != INSTANTIATED) return not_now(it, "setting the start time");
    if (!isfinite(start))
        return instance_refuse(it, "the start time must be finite, got %s", shortest(start).text);
    if (!(stop >= start))
        return instance_refuse(it, "the stop time, %s s, must not be before the start time, %s s",
                               shortest(stop).text, shortest(start).text);
    it->time = start;
    it->stop = stop;
    return FINE;
}

static Status initialise(Instance *it) {
    Message why;
    if (!behaviour_initialise(it->behaviour, it->v, it->time, &why))
        return instance_refuse(it, "initialisation: %s", why.text);
    it->stale = 0;
    return FINE;
}

Status instance_enter_initialization(Instance *it) {
    if (it->phase != INSTANTIATED) return not_now(it, "enterInitializationMode");
    it->phase = INITIALIZING;
    it->stale = 1; /* outputs are computed when they are asked for */
    return FINE;
}

Status instance_exit_initialization(Instance *it) {
    if (it->phase != INITIALIZING) return not_now(it, "exitInitializationMode");
    Status status = initialise(it);
    if (status == FINE) it->phase = RUNNING;
    return status;
}

Status instance_terminate(Instance *it) {
    if (it->phase != RUNNING) return not_now(it, "terminate");
    it->phase = TERMINATED;
    return FINE;
}

Status instance_reset(Instance *it) {
    set_defaults(it);
    return FINE;
}

Status instance_step(Instance *it, double from, double size) {
    if (it->phase != RUNNING) return not_now(it, "doStep");
    if (!(isfinite(size) && size >= 0.0))
        return instance_refuse(it, "the step must be finite and not negative, got %s s",
                               shortest(size).text);
    if (!isfinite(from))
        return instance_refuse(it, "the step must start at a finite time, got %s s",
                               shortest(from).text);
    /* a master that adds up its steps drifts by rounding; anything more is an error */
    if (fabs(from - it->time) > 1e-9 * greater(1.0, fabs(it->time)))
        return instance_refuse(it,
                               "the step starts at t = %s s, but the instance is at %s s; set a "
                               "saved state to go back",
                               shortest(from).text, shortest(it->time).text);
    double end = from + size;
    if (!isfinite(end)) return instance_refuse(it, "the step must end at a finite time");
    if (end - it->stop > 1e-9 * greater(1.0, fabs(it->stop)))
        return instance_refuse(it, "the step ends at t = %s s, after the stop time of %s s",
                               shortest(end).text, shortest(it->stop).text);
    if (end > it->time) {
        Message why;
        if (!behaviour_advance(it->behaviour, it->v, end, &why))
            return instance_decline(it, DISCARDED, "doStep at t = %s s: %s", shortest(from).text,
                                    why.text);
        it->time = end;
        it->stale = 0;
    }
    return FINE;
}

/* ---- variables */

static Status refresh(Instance *it) {
    Message why;
    if (it->phase == INITIALIZING) return initialise(it);
    if (it->phase == RUNNING && !behaviour_refresh(it->behaviour, it->v, &why))
        return instance_refuse(it, "outputs: %s", why.text);
    it->stale = 0;
    return FINE;
}

static Status unknown_reference(Instance *it, unsigned vr) {
    return instance_refuse(it, "value reference %u is unknown; 1 to %d exist", vr,
                           MODEL_VARIABLES);
}

static Status known(Instance *it, const unsigned *vr, size_t count, const void *values, Kind kind) {
    if (count > 0 && (!vr || !values))
        return instance_refuse(it, "the value references or values are missing");
    for (size_t i = 0; i < count; i++) {
        if (place(vr[i]) >= (unsigned)MODEL_VARIABLES) return unknown_reference(it, vr[i]);
        const Variable *variable = &model_variables[place(vr[i])];
        if (variable->kind != kind)
            return instance_refuse(it, "value reference %u (%s) is of type %s, not %s", vr[i],
                                   variable->name, KINDS[variable->kind], KINDS[kind]);
    }
    return FINE;
}

static Status readable(Instance *it, const unsigned *vr, size_t count, const void *values,
                       Kind kind) {
    Status status = known(it, vr, count, values, kind);
    if (status == FINE && it->stale) status = refresh(it);
    return status;
}

Status instance_get_reals(Instance *it, const unsigned *vr, size_t count, double *values) {
    Status status = readable(it, vr, count, values, REAL);
    if (status == FINE)
        for (size_t i = 0; i < count; i++) values[i] = it->v[place(vr[i])];
    return status;
}

Status instance_get_integers(Instance *it, const unsigned *vr, size_t count, int *values) {
    Status status = readable(it, vr, count, values, INTEGER);
    if (status == FINE)
        for (size_t i = 0; i < count; i++) values[i] = (int)it->v[place(vr[i])];
    return status;
}

static Status writable(Instance *it, unsigned vr, double value) {
    const Variable *variable = &model_variables[place(vr)];
    if (variable->causality == INPUT && value - value == 0.0 && value >= variable->minimum &&
        value <= variable->maximum)
        return FINE; /* by far the most frequent */
    if (!isfinite(value))
        return instance_refuse(it, "%s must be finite, got %s", variable->name,
                               shortest(value).text);
    if (variable->causality == OUTPUT && it->phase != INSTANTIATED)
        return instance_refuse(it, "%s is an output and cannot be written", variable->name);
    if (variable->causality == PARAMETER && it->phase != INSTANTIATED && it->phase != INITIALIZING)
        return instance_refuse(
            it, "%s is a fixed parameter and cannot be written after initialisation",
            variable->name);
    if (value < variable->minimum || value > variable->maximum) {
        int below = value < variable->minimum;
        return instance_refuse(it, "%s must be at %s %s, got %s", variable->name,
                               below ? "least" : "most",
                               shortest(below ? variable->minimum : variable->maximum).text,
                               shortest(value).text);
    }
    return FINE;
}

static Status may_write(Instance *it) {
    return it->phase == FAILED || it->phase == TERMINATED ? not_now(it, "writing a variable") : FINE;
}

Status instance_set_reals(Instance *it, const unsigned *vr, size_t count, const double *values) {
    Status status = may_write(it);
    if (status == FINE) status = known(it, vr, count, values, REAL);
    for (size_t i = 0; status == FINE && i < count; i++) status = writable(it, vr[i], values[i]);
    if (status != FINE) return status;
    for (size_t i = 0; i < count; i++) it->v[place(vr[i])] = values[i];
    it->stale = 1;
    return FINE;
}

Status instance_set_integers(Instance *it, const unsigned *vr, size_t count, const int *values) {
    Status status = may_write(it);
    if (status == FINE) status = known(it, vr, count, values, INTEGER);
    for (size_t i = 0; status == FINE && i < count; i++) status = writable(it, vr[i], values[i]);
    if (status != FINE) return status;
    for (size_t i = 0; i < count; i++) it->v[place(vr[i])] = values[i];
    it->stale = 1;
    return FINE;
}

Status instance_no_such_type(Instance *it, const unsigned *vr, size_t count, const char *type) {
    if (count == 0) return FINE;
    if (!vr) return instance_refuse(it, "the value references are missing");
    if (place(vr[0]) >= (unsigned)MODEL_VARIABLES) return unknown_reference(it, vr[0]);
    const Variable *variable = &model_variables[place(vr[0])];
    return instance_refuse(it, "value reference %u (%s) is of type %s, not %s", vr[0],
                           variable->name, KINDS[variable->kind], type);
}

Status instance_direction(Instance *it, const unsigned *unknown, size_t unknowns,
                          const unsigned *inputs, size_t knowns, const double *seed,
                          double *change) {
    double moved[MOST_VARIABLES] = {0.0}, out[MOST_VARIABLES] = {0.0};
    if (it->phase != RUNNING && it->phase != INITIALIZING)
        return not_now(it, "getDirectionalDerivative");
    Status status = known(it, unknown, unknowns, change, REAL);
    if (status == FINE) status = known(it, inputs, knowns, seed, REAL);
    for (size_t i = 0; status == FINE && i < unknowns; i++)
        if (model_variables[place(unknown[i])].causality != OUTPUT)
            status = instance_refuse(it, "%s is no output: it has no derivative",
                                     model_variables[place(unknown[i])].name);
    for (size_t i = 0; status == FINE && i < knowns; i++)
        if (model_variables[place(inputs[i])].causality != INPUT)
            status = instance_refuse(it, "%s is no input: nothing is derived by it",
                                     model_variables[place(inputs[i])].name);
    if (status == FINE && it->stale) status = refresh(it);
    if (status != FINE) return status;
    for (size_t i = 0; i < knowns; i++) moved[place(inputs[i])] += seed[i];
    behaviour_direction(it->behaviour, it->v, moved, out);
    for (size_t i = 0; i < unknowns; i++) change[i] = out[place(unknown[i])];
    return FINE;
}
