/* A sensor: sampling, bias, drift, noise, steps, range, freezing. With a stamp its values are seen
   at the next communication point, without one at once. As fmu_src/sensor/behaviour.py. */

#include <stdio.h>
#include <stdlib.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "draws.h"
#include "model.h"
#include "variable.h"

#define LANES ((size_t)MODEL_INPUTS)
#define STAMPED (MODEL_STATES == 0) /* without drifts: those are of a sensor that is seen at once */
#define MOST_SAMPLES 0x1p53

struct Behaviour {
    double start, time;       /* of the run; of the present instant */
    double samples;           /* of the instants before */
    double kept[MOST_INPUTS]; /* the values of the instant before */
};

#define SAVED (3 + LANES)

/* In whole nanoseconds, as masters count: not what rounding made of a sum of steps. */
static double whole(double t) { return rint(t * 1e9) / 1e9; }

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Behaviour)); }

void behaviour_free(Behaviour *b) { free(b); }

/* How many samples belong to the present instant and those before: with a stamp the instants
   before `end`, without one those up to now. */
static double taken_at(const Behaviour *b, const double *v, double end) {
    double period = v[V_sample_time], until = STAMPED ? end : b->time;
    double first = b->start + (STAMPED ? v[V_offset] : 0.0);
    /* an instant before `end`, or after now, only by rounding */
    double near = greater(1e-9 * greater(period, 1e-3), 16.0 * spacing(until));
    if (!(period > 0.0)) return b->samples + (b->time + near >= first ? 1.0 : 0.0);
    double taken = floor((until + (STAMPED ? -near : near) - first) / period) + 1.0;
    return taken < b->samples ? b->samples : taken; /* not a number stays, and is refused */
}

static int is_frozen(const Behaviour *b, const double *v) {
    if (STAMPED || !(b->samples > 0.0)) return 0;
    return v[V_frozen] >= 0.5 || (v[V_freeze_from] <= b->time && b->time < v[V_freeze_until]);
}

static double draw(const double *v, size_t lane, double taken) {
    Source source = {(uint64_t)v[V_seed], model_text};
    uint64_t k = (uint64_t)(taken - 1.0);
    char purpose[32];
    snprintf(purpose, sizeof purpose, "noise %u", (unsigned)lane + 1);
    if (!STAMPED && v[V_uniform] >= 0.5) return 2.0 * draw_uniform(&source, purpose, 0, k) - 1.0;
    return draw_normal(&source, purpose, k);
}

/* The values that are kept, or new ones if a sample is due. */
static int values(const Behaviour *b, const double *v, double end, double *out, Message *why) {
    double t = b->time, taken = taken_at(b, v, end);
    if (!(taken <= MOST_SAMPLES))
        return say(why, "samples %s s apart cannot be counted up to t = %s s",
                   shortest(v[V_sample_time]).text, shortest(STAMPED ? end : t).text);
    if (taken == b->samples || is_frozen(b, v)) {
        memcpy(out, b->kept, sizeof(double) * LANES);
        return 1;
    }
    for (size_t i = 0; i < LANES; i++) {
        double x = v[model_inputs[i]] + v[model_initials[i]], noise = v[model_others[i]];
        double step = STAMPED ? 0.0 : v[model_watched[i]];
        if (!STAMPED) x += v[model_states[i]] * (t - b->start);
        if (noise > 0.0) x += noise * draw(v, i, taken);
        if (!isfinite(step > 0.0 ? x / step : x))
            return say(why, "%s is not finite at t = %s s",
                       model_variables[model_outputs[i]].name, shortest(t).text);
        if (step > 0.0) x = step * rint(x / step);
        out[i] = STAMPED ? x : lesser(greater(x, v[model_measured[i]]), v[model_acting[i]]);
    }
    return 1;
}

static void publish(double *v, const double *out) {
    for (size_t i = 0; i < LANES; i++) v[model_outputs[i]] = out[i];
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    *b = (Behaviour){.start = whole(start), .time = whole(start)};
    if (!STAMPED) return behaviour_refresh(b, v, why);
    v[V_stamp] = start - 1.0;
    publish(v, b->kept);
    return 1;
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    Behaviour next = *b;
    if (!values(b, v, end, next.kept, why)) return 0;
    next.samples = taken_at(b, v, end);
    next.time = whole(end);
    if (STAMPED) {
        if (next.samples > b->samples) v[V_stamp] = b->time;
        publish(v, next.kept);
    } else if (!behaviour_refresh(&next, v, why)) {
        return 0;
    }
    *b = next;
    return 1;
}

int behaviour_refresh(Behaviour *b, double *v, Message *why) {
    double out[MOST_INPUTS];
    if (STAMPED) return 1;
    if (!values(b, v, b->time, out, why)) return 0;
    publish(v, out);
    return 1;
}

/* Steps and range apart, a value moves as its input, its bias and its drift do. */
void behaviour_direction(const Behaviour *b, const double *v, const double *change, double *out) {
    if (STAMPED || taken_at(b, v, b->time) == b->samples || is_frozen(b, v)) return;
    for (size_t i = 0; i < LANES; i++)
        out[model_outputs[i]] = change[model_inputs[i]] + change[model_initials[i]] +
                                change[model_states[i]] * (b->time - b->start);
}

size_t behaviour_size(const Behaviour *b) {
    (void)b;
    return SAVED;
}

void behaviour_save(const Behaviour *b, double *to) {
    to[0] = b->start;
    to[1] = b->time;
    to[2] = b->samples;
    memcpy(to + 3, b->kept, sizeof(double) * LANES);
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    (void)v;
    int fits = count == SAVED;
    for (size_t i = 0; fits && i < count; i++) fits = isfinite(from[i]);
    if (!fits || from[1] < from[0] || from[2] < 0.0 || from[2] > MOST_SAMPLES ||
        from[2] != floor(from[2]))
        return say(why, "the saved sampling clock does not fit this component");
    b->start = from[0];
    b->time = from[1];
    b->samples = from[2];
    memcpy(b->kept, from + 3, sizeof(double) * LANES);
    return 1;
}
