/* Values taken at t = start + offset + k sample_time, with bias and noise, and the time at which
   they were taken; seen at the next communication point. As fmu_src/sensor/behaviour.py. */

#include <stdio.h>
#include <stdlib.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "draws.h"
#include "model.h"
#include "no_feedthrough.h"
#include "variable.h"

#define LANES ((size_t)MODEL_INPUTS)
#define MOST_SAMPLES 0x1p53

struct Behaviour {
    double start, time; /* of the run; where the last step ended */
    double samples;     /* instants so far */
};

#define SAVED 3

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Behaviour)); }

void behaviour_free(Behaviour *b) { free(b); }

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    (void)why;
    b->start = b->time = start;
    b->samples = 0.0;
    for (size_t i = 0; i < LANES; i++) v[model_outputs[i]] = 0.0;
    v[V_stamp] = start - 1.0;
    return 1;
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    double period = v[V_sample_time], first = b->start + v[V_offset], taken;
    /* an instant that rounding alone puts before `end` belongs to the next step */
    double near = greater(1e-9 * greater(period, 1e-3), 16.0 * spacing(end));
    if (period > 0.0)
        taken = ceil((end - near - first) / period);
    else
        taken = b->samples + (b->time + near >= first ? 1.0 : 0.0);
    if (!(taken <= MOST_SAMPLES))
        return say(why, "samples %s s apart cannot be counted up to t = %s s",
                   shortest(period).text, shortest(end).text);
    if (taken > b->samples) {
        Source source = {(uint64_t)v[V_seed], model_text};
        double out[MOST_INPUTS];
        for (size_t i = 0; i < LANES; i++) {
            double deviation = v[model_others[i]];
            out[i] = v[model_inputs[i]] + v[model_initials[i]];
            if (deviation > 0.0) {
                char purpose[32];
                snprintf(purpose, sizeof purpose, "noise %u", (unsigned)i + 1);
                out[i] += deviation * draw_normal(&source, purpose, (uint64_t)(taken - 1.0));
            }
            if (!isfinite(out[i]))
                return say(why, "%s is not finite", model_variables[model_outputs[i]].name);
        }
        for (size_t i = 0; i < LANES; i++) v[model_outputs[i]] = out[i];
        v[V_stamp] = rint(b->time * 1e9) / 1e9; /* in whole nanoseconds, as masters count */
        b->samples = taken;
    }
    b->time = end;
    return 1;
}

size_t behaviour_size(const Behaviour *b) {
    (void)b;
    return SAVED;
}

void behaviour_save(const Behaviour *b, double *to) {
    to[0] = b->start;
    to[1] = b->time;
    to[2] = b->samples;
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    (void)v;
    int fits = count == SAVED && isfinite(from[0]) && isfinite(from[1]) && from[1] >= from[0] &&
               from[2] >= 0.0 && from[2] <= MOST_SAMPLES && from[2] == floor(from[2]);
    if (!fits) return say(why, "the saved sampling clock does not fit this component");
    b->start = from[0];
    b->time = from[1];
    b->samples = from[2];
    return 1;
}
