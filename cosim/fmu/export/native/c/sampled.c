/* A law taken at t = start + k sample_time and held: what is sampled at a communication point
   is seen at the next one. As fmu_src/hinf_controller/behaviour.py. */

#include <stdlib.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "model.h"
#include "no_feedthrough.h"
#include "variable.h"

struct Behaviour {
    double constants[MOST_CONSTANTS > 0 ? MOST_CONSTANTS : 1];
    double start;
    double samples; /* taken so far */
    double time; /* where the last step ended */
};

#define SAVED 3

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Behaviour)); }

void behaviour_free(Behaviour *b) { free(b); }

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    (void)why;
    model_constants(v, b->constants);
    b->start = start;
    b->samples = 0.0;
    b->time = start;
    for (size_t i = 0; i < (size_t)MODEL_OUTPUTS; i++) v[model_outputs[i]] = 0.0;
    return 1;
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    double period = v[V_sample_time], samples = b->samples;
    int due = 1;
    double elapsed = end - b->time; /* for which the sample is held */
    if (period > 0.0) {
        /* an instant that rounding alone puts before `end` belongs to the next step */
        double near = greater(1e-9 * greater(period, 1e-3), 16.0 * spacing(end));
        double taken = ceil((end - near - b->start) / period);
        if (!isfinite(taken))
            return say(why, "samples %s s apart cannot be counted up to t = %s s",
                       shortest(period).text, shortest(end).text);
        due = taken > samples;
        elapsed = (taken - samples) * period;
        samples = greater(taken, samples);
    }
    if (due) {
        double out[MOST_OUTPUTS];
        model_law(elapsed, v, b->constants, out);
        for (size_t i = 0; i < (size_t)MODEL_OUTPUTS; i++)
            if (!isfinite(out[i]))
                return say(why, "%s is not finite", model_variables[model_outputs[i]].name);
        for (size_t i = 0; i < (size_t)MODEL_OUTPUTS; i++) v[model_outputs[i]] = out[i];
    }
    b->samples = samples;
    b->time = end;
    return 1;
}

size_t behaviour_size(const Behaviour *b) {
    (void)b;
    return SAVED;
}

void behaviour_save(const Behaviour *b, double *to) {
    to[0] = b->start;
    to[1] = b->samples;
    to[2] = b->time;
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    int fits = count == SAVED;
    for (size_t i = 0; fits && i < SAVED; i++) fits = isfinite(from[i]);
    if (!fits || from[1] < 0.0)
        return say(why, "the saved sampling clock does not fit this component");
    model_constants(v, b->constants);
    b->start = from[0];
    b->samples = from[1];
    b->time = from[2];
    return 1;
}
