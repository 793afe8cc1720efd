/* A delay equation between communication points, inputs held. */

#include <stdlib.h>
#include <string.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "delay_line.h"
#include "model.h"
#include "variable.h"

/* Signed: a plant may have none, and an unsigned number below 0 is a warning. */
#define OTHERS ((int)MODEL_OTHERS)
#define INPUTS ((int)MODEL_INPUTS)
#define DELAYS ((int)MODEL_DELAYS)
#define CONSTANTS ((int)MODEL_CONSTANTS)
#define STATES ((int)MODEL_STATES)

struct Behaviour {
    DelayLine line;
    double constants[AT_LEAST_ONE(MOST_CONSTANTS)];
    double held[AT_LEAST_ONE(MOST_INPUTS)]; /* inputs of the last step */
    int stepped;                             /* there was one */
};

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Behaviour)); }

void behaviour_free(Behaviour *b) {
    if (b) delay_line_free(&b->line);
    free(b);
}

/* Parameters to constants and an empty history. */
static int prepare(Behaviour *b, const double *v, double start, Message *why) {
    const char *objection = model_objection(v);
    if (objection) return say(why, "%s", objection);
    model_constants(v, b->constants);
    for (int i = 0; i < CONSTANTS; i++)
        if (!isfinite(b->constants[i]))
            return say(why, "the parameters give a coefficient that is not finite");
    double initial[MOST_STATES], delay[AT_LEAST_ONE(MOST_DELAYS)];
    for (int i = 0; i < STATES; i++) initial[i] = v[model_initials[i]];
    for (int k = 0; k < DELAYS; k++) delay[k] = v[model_delays[k]];
    b->stepped = 0;
    return delay_line_start(&b->line, initial, delay, v[V_solver_step], start, why);
}

static int others(const Behaviour *b, double *v, Message *why) {
    double out[AT_LEAST_ONE(MOST_OTHERS)];
    model_other_outputs(b->line.x, v, b->constants, out);
    for (int i = 0; i < OTHERS; i++)
        if (!isfinite(out[i]))
            return say(why, "%s is not finite", model_variables[model_others[i]].name);
    for (int i = 0; i < OTHERS; i++) v[model_others[i]] = out[i];
    return 1;
}

static int publish(const Behaviour *b, double *v, Message *why) {
    if (!others(b, v, why)) return 0;
    for (int i = 0; i < STATES; i++) v[model_states[i]] = b->line.x[i];
    return 1;
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    return prepare(b, v, start, why) && publish(b, v, why);
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    double inputs[AT_LEAST_ONE(MOST_INPUTS)];
    int jump = !b->stepped;
    for (int i = 0; i < INPUTS; i++) {
        inputs[i] = v[model_inputs[i]];
        jump |= inputs[i] != b->held[i];
    }
    int same = b->stepped && memcmp(inputs, b->held, (size_t)INPUTS * sizeof *inputs) == 0;
    Mark mark = delay_line_mark(&b->line);
    Held held = {v, b->constants};
    if (!delay_line_advance(&b->line, end, &held, jump, same, why) || !publish(b, v, why)) {
        delay_line_return(&b->line, &mark);
        return 0;
    }
    delay_line_forget(&b->line);
    memcpy(b->held, inputs, (size_t)INPUTS * sizeof *inputs);
    b->stepped = 1;
    return 1;
}

int behaviour_refresh(Behaviour *b, double *v, Message *why) { return others(b, v, why); }

void behaviour_direction(const Behaviour *b, const double *v, const double *change, double *out) {
    double inputs[AT_LEAST_ONE(MOST_INPUTS)], changed[AT_LEAST_ONE(MOST_OTHERS)];
    for (int i = 0; i < INPUTS; i++) inputs[i] = change[model_inputs[i]];
    model_outputs_change(b->line.x, v, b->constants, inputs, changed);
    for (int i = 0; i < OTHERS; i++) out[model_others[i]] = changed[i];
}

size_t behaviour_size(const Behaviour *b) {
    return 1 + (size_t)INPUTS + delay_line_size(&b->line);
}

void behaviour_save(const Behaviour *b, double *to) {
    *to++ = b->stepped;
    for (int i = 0; i < INPUTS; i++) *to++ = b->stepped ? b->held[i] : 0.0;
    delay_line_save(&b->line, to);
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    if (count < 1 + (size_t)INPUTS) return say(why, "the saved inputs are missing");
    if (!prepare(b, v, 0.0, why)) return 0;
    size_t before = 1 + (size_t)INPUTS;
    if (!delay_line_restore(&b->line, from + before, count - before, why)) return 0;
    b->stepped = from[0] != 0.0;
    memcpy(b->held, from + 1, (size_t)INPUTS * sizeof *b->held);
    return 1;
}
