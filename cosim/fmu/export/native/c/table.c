/* Signals given as a table: exact at its instants, linear between them, held before the first
   and after the last. */

#include <stdlib.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "clock.h"
#include "model.h"
#include "no_feedthrough.h"
#include "variable.h"

#define OUTPUTS ((size_t)MODEL_OUTPUTS)
#define ROWS ((size_t)MODEL_ROWS)

struct Behaviour {
    Clock clock;
};

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Behaviour)); }

void behaviour_free(Behaviour *b) { free(b); }

static void publish(const Behaviour *b, double *v) {
    /* the run's own time, whatever the master calls its start */
    int64_t t = b->clock.now + nanoseconds(b->clock.start);
    size_t low = 0, high = ROWS; /* the last row at or before t, or the first */
    while (high - low > 1) {
        size_t middle = low + (high - low) / 2;
        if (model_instants[middle] <= t)
            low = middle;
        else
            high = middle;
    }
    double weight = 0.0;
    if (low + 1 < ROWS && t > model_instants[low])
        weight = (double)(t - model_instants[low]) /
                 (double)(model_instants[low + 1] - model_instants[low]);
    for (size_t i = 0; i < OUTPUTS; i++) {
        double here = model_table[low * OUTPUTS + i];
        v[model_outputs[i]] =
            weight == 0.0 ? here : here + weight * (model_table[(low + 1) * OUTPUTS + i] - here);
    }
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    (void)why;
    b->clock = clock_at(start);
    publish(b, v);
    return 1;
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    (void)why;
    b->clock = clock_moved(b->clock, end);
    publish(b, v);
    return 1;
}

size_t behaviour_size(const Behaviour *b) {
    (void)b;
    return CLOCK_NUMBERS;
}

void behaviour_save(const Behaviour *b, double *to) { clock_save(&b->clock, to); }

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    (void)v;
    if (count != CLOCK_NUMBERS || !clock_restore(&b->clock, from))
        return say(why, "the saved clock does not fit this component");
    return 1;
}
