/* Values computed from signals: recorded operations on the inputs and the time, at the same
   instant. As fmu_src/computed/behaviour.py. */

#include <stdlib.h>
#include <string.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "model.h"
#include "variable.h"

#define OUTPUTS ((size_t)MODEL_OUTPUTS)

/* In whole nanoseconds, as masters count: not what rounding made of a sum of steps. */
static double whole(double t) { return rint(t * 1e9) / 1e9; }

struct Behaviour {
    double constants[MOST_CONSTANTS > 0 ? MOST_CONSTANTS : 1];
    double time;
};

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Behaviour)); }

void behaviour_free(Behaviour *b) { free(b); }

static int all_finite(const double *out, double t, Message *why) {
    const char *text = model_text; /* of the expressions, a line for each output */
    for (size_t i = 0; i < OUTPUTS; i++) {
        size_t length = strcspn(text, "\n");
        if (!isfinite(out[i]))
            return say(why, "%s has no finite value at t = %s s: %.*s",
                       model_variables[model_outputs[i]].name, shortest(t).text,
                       length < 200 ? (int)length : 200, text);
        text += length + (text[length] != 0);
    }
    return 1;
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    double out[MOST_OUTPUTS];
    (void)why;
    model_constants(v, b->constants);
    b->time = start = whole(start);
    model_law(start, v, b->constants, out);
    for (size_t i = 0; i < OUTPUTS; i++) v[model_outputs[i]] = isfinite(out[i]) ? out[i] : 0.0;
    return 1;
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    double out[MOST_OUTPUTS];
    end = whole(end);
    model_law(end, v, b->constants, out);
    if (MODEL_INPUTS == 0 && !all_finite(out, end, why)) return 0;
    b->time = end;
    /* one without a value waits for the inputs of this instant */
    for (size_t i = 0; i < OUTPUTS; i++)
        if (isfinite(out[i])) v[model_outputs[i]] = out[i];
    return 1;
}

int behaviour_refresh(Behaviour *b, double *v, Message *why) {
    double out[MOST_OUTPUTS];
    model_law(b->time, v, b->constants, out);
    if (!all_finite(out, b->time, why)) return 0;
    for (size_t i = 0; i < OUTPUTS; i++) v[model_outputs[i]] = out[i];
    return 1;
}

/* By central differences: an expression may have corners. */
void behaviour_direction(const Behaviour *b, const double *v, const double *change, double *out) {
    double moved[MOST_VARIABLES], up[MOST_OUTPUTS], down[MOST_OUTPUTS], size = 1e-6;
    memcpy(moved, v, sizeof(double) * (size_t)MODEL_VARIABLES);
    for (size_t i = 0; i < (size_t)MODEL_INPUTS; i++)
        moved[model_inputs[i]] = v[model_inputs[i]] + size * change[model_inputs[i]];
    model_law(b->time, moved, b->constants, up);
    for (size_t i = 0; i < (size_t)MODEL_INPUTS; i++)
        moved[model_inputs[i]] = v[model_inputs[i]] - size * change[model_inputs[i]];
    model_law(b->time, moved, b->constants, down);
    for (size_t i = 0; i < OUTPUTS; i++)
        out[model_outputs[i]] = (up[i] - down[i]) / (2.0 * size);
}

size_t behaviour_size(const Behaviour *b) {
    (void)b;
    return 1;
}

void behaviour_save(const Behaviour *b, double *to) { to[0] = b->time; }

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    if (count != 1 || !isfinite(from[0]))
        return say(why, "the saved time does not fit this component");
    model_constants(v, b->constants);
    b->time = from[0];
    return 1;
}
