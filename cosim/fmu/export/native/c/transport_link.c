/* A continuous signal, delayed: y(t) = u(t - delay), linear between the communication points
   at which u was given; before the start of the run its initial value. As
   cosim/network/transport.py. What is not known yet at the end of a step, u within it, is held:
   a delay shorter than the step acts as the step. */

#include <stdlib.h>
#include <string.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "clock.h"
#include "model.h"
#include "no_feedthrough.h"
#include "variable.h"

#define LANES ((size_t)MODEL_INPUTS)

typedef struct {
    int64_t time; /* ns */
    double value[MOST_INPUTS];
} Row;

struct Behaviour {
    Clock clock;
    int64_t delay;
    Row *row; /* in order of time; the first is at or before what is read next */
    size_t count, room;
};

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Behaviour)); }

void behaviour_free(Behaviour *b) {
    if (b) free(b->row);
    free(b);
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    (void)why;
    b->clock = clock_at(start);
    b->delay = nanoseconds(v[V_delay]);
    b->count = 0;
    for (size_t i = 0; i < LANES; i++) v[model_outputs[i]] = v[model_initials[i]];
    v[V_age] = 0.0;
    return 1;
}

static int room_for_one(Behaviour *b, Message *why) {
    if (b->count < b->room) return 1;
    size_t wanted = 2 * b->room + 16;
    Row *more = realloc(b->row, wanted * sizeof *more);
    if (!more) return say(why, "there is no memory left for the delayed signal");
    b->row = more;
    b->room = wanted;
    return 1;
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    if (!room_for_one(b, why)) return 0;
    Row *last = &b->row[b->count++];
    last->time = b->clock.now;
    for (size_t i = 0; i < LANES; i++) last->value[i] = v[model_inputs[i]];
    b->clock = clock_moved(b->clock, end);
    int64_t wanted = b->clock.now - b->delay;
    if (wanted < 0) wanted = 0;
    if (wanted > last->time) wanted = last->time;
    size_t k = 0;
    while (k + 1 < b->count && b->row[k + 1].time <= wanted) k++;
    const Row *here = &b->row[k], *after = &b->row[k + 1 < b->count ? k + 1 : k];
    int64_t past = wanted - here->time, gap = after->time - here->time;
    double weight = past > 0 ? (double)past / (double)gap : 0.0;
    for (size_t i = 0; i < LANES; i++)
        v[model_outputs[i]] = weight == 0.0
                                  ? here->value[i]
                                  : (1.0 - weight) * here->value[i] + weight * after->value[i];
    v[V_age] = (double)(b->clock.now - wanted) / 1e9;
    memmove(b->row, here, (b->count - k) * sizeof *b->row);
    b->count -= k;
    return 1;
}

#define EACH (1 + LANES)

size_t behaviour_size(const Behaviour *b) { return CLOCK_NUMBERS + EACH * b->count; }

void behaviour_save(const Behaviour *b, double *to) {
    clock_save(&b->clock, to);
    to += CLOCK_NUMBERS;
    for (size_t i = 0; i < b->count; i++, to += EACH) {
        to[0] = (double)b->row[i].time;
        memcpy(to + 1, b->row[i].value, LANES * sizeof(double));
    }
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    int fits = count >= CLOCK_NUMBERS && (count - CLOCK_NUMBERS) % EACH == 0;
    for (size_t i = 0; fits && i < count; i++) fits = isfinite(from[i]);
    if (!fits || !clock_restore(&b->clock, from))
        return say(why, "the saved signal does not fit this link");
    size_t rows = (count - CLOCK_NUMBERS) / EACH;
    Row *row = realloc(b->row, (rows ? rows : 1) * sizeof *row);
    if (!row) return say(why, "there is no memory left for the delayed signal");
    b->row = row;
    b->room = rows ? rows : 1;
    b->count = rows;
    b->delay = nanoseconds(v[V_delay]);
    from += CLOCK_NUMBERS;
    for (size_t i = 0; i < rows; i++, from += EACH) {
        if (fabs(from[0]) >= 1e18 || (i > 0 && from[0] <= (double)row[i - 1].time))
            return say(why, "the saved signal does not fit this link");
        row[i].time = (int64_t)from[0];
        memcpy(row[i].value, from + 1, LANES * sizeof(double));
    }
    return 1;
}
