/* A sensor on a plain connection: bias, drift, noise, steps, range, freezing; the value of an
   instant is seen at that instant. As fmu_src/plain_sensor/behaviour.py. */

#include <stdio.h>
#include <stdlib.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "draws.h"
#include "model.h"
#include "variable.h"

#define LANES ((size_t)MODEL_INPUTS)
#define MOST_SAMPLES 0x1p53

struct Behaviour {
    double start, time;
    double samples, steps; /* samples of the instants before, communication points so far */
    double kept[MOST_INPUTS]; /* the values of the instant before */
};

#define SAVED (4 + LANES)

/* In whole nanoseconds, as masters count: not what rounding made of a sum of steps. */
static double whole(double t) { return rint(t * 1e9) / 1e9; }

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Behaviour)); }

void behaviour_free(Behaviour *b) { free(b); }

/* How many samples have been taken at t. */
static double samples_at(const Behaviour *b, const double *v, double t) {
    double period = v[V_sample_time];
    if (!(period > 0.0)) return b->steps + 1.0;
    /* an instant that only rounding puts after t has come */
    double near = greater(1e-9 * greater(period, 1e-3), 16.0 * spacing(t));
    return floor((t + near - b->start) / period) + 1.0;
}

static int is_frozen(const Behaviour *b, const double *v) {
    return b->samples > 0.0 && (v[V_frozen] >= 0.5 || (v[V_freeze_from] <= b->time &&
                                                       b->time < v[V_freeze_until]));
}

static int values(const Behaviour *b, const double *v, double *out, Message *why) {
    double t = b->time, taken = samples_at(b, v, t);
    if (!(taken <= MOST_SAMPLES))
        return say(why, "samples %s s apart cannot be counted up to t = %s s",
                   shortest(v[V_sample_time]).text, shortest(t).text);
    if (taken == b->samples || is_frozen(b, v)) {
        memcpy(out, b->kept, sizeof(double) * LANES);
        return 1;
    }
    Source source = {(uint64_t)v[V_seed], model_text};
    for (size_t i = 0; i < LANES; i++) {
        double noise = v[model_others[i]], step = v[model_watched[i]];
        double x = v[model_inputs[i]] + v[model_initials[i]] + v[model_states[i]] * (t - b->start);
        if (noise > 0.0) {
            char purpose[32];
            snprintf(purpose, sizeof purpose, "noise %u", (unsigned)i + 1);
            uint64_t k = (uint64_t)(taken - 1.0);
            x += noise * (v[V_uniform] >= 0.5 ? 2.0 * draw_uniform(&source, purpose, 0, k) - 1.0
                                              : draw_normal(&source, purpose, k));
        }
        if (!isfinite(step > 0.0 ? x / step : x))
            return say(why, "%s is not finite at t = %s s",
                       model_variables[model_outputs[i]].name, shortest(t).text);
        if (step > 0.0) x = step * rint(x / step);
        out[i] = lesser(greater(x, v[model_measured[i]]), v[model_acting[i]]);
    }
    return 1;
}

static int publish(const Behaviour *b, double *v, Message *why) {
    double out[MOST_INPUTS];
    if (!values(b, v, out, why)) return 0;
    for (size_t i = 0; i < LANES; i++) v[model_outputs[i]] = out[i];
    return 1;
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    b->start = b->time = whole(start);
    b->samples = b->steps = 0.0;
    return publish(b, v, why);
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    Behaviour next = *b;
    if (!values(b, v, next.kept, why)) return 0;
    next.samples = samples_at(b, v, b->time);
    next.steps += 1.0;
    next.time = whole(end);
    if (!publish(&next, v, why)) return 0;
    *b = next;
    return 1;
}

int behaviour_refresh(Behaviour *b, double *v, Message *why) { return publish(b, v, why); }

/* Steps and range apart, a value moves as its input, its bias and its drift do. */
void behaviour_direction(const Behaviour *b, const double *v, const double *change, double *out) {
    if (samples_at(b, v, b->time) == b->samples || is_frozen(b, v)) return;
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
    to[3] = b->steps;
    memcpy(to + 4, b->kept, sizeof(double) * LANES);
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    (void)v;
    int fits = count == SAVED;
    for (size_t i = 0; fits && i < count; i++) fits = isfinite(from[i]);
    if (!fits || from[1] < from[0] || from[2] < 0.0 || from[3] < 0.0)
        return say(why, "the saved sampling clock does not fit this component");
    b->start = from[0];
    b->time = from[1];
    b->samples = from[2];
    b->steps = from[3];
    memcpy(b->kept, from + 4, sizeof(double) * LANES);
    return 1;
}
