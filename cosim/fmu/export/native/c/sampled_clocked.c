/* The sampled law of sampled.c, which samples when its Clock ticks if event mode is used: what is
   sampled at a tick is seen at the next communication point, as without a Clock. */

#include "clocked.h"

#define behaviour_new sampled_new
#define behaviour_advance sampled_advance
#define behaviour_size sampled_size
#define behaviour_save sampled_save
#define behaviour_restore sampled_restore
#include "sampled.c"
#undef behaviour_new
#undef behaviour_advance
#undef behaviour_size
#undef behaviour_save
#undef behaviour_restore

typedef struct {
    Behaviour sampled; /* first: a pointer to it is one to the whole */
    ClockState clock;
} Clocked;

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Clocked)); }

ClockState *behaviour_clock(Behaviour *b) { return &((Clocked *)b)->clock; }

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    ClockState *clock = behaviour_clock(b);
    double period = v[V_sample_time];
    if (clock->used) { /* count as many samples as there are, but for one if the Clock has ticked */
        double near = greater(1e-9 * greater(period, 1e-3), 16.0 * spacing(end));
        b->samples = ceil((end - near - b->start) / period) - (clock->due ? 1.0 : 0.0);
        clock->due = 0;
    }
    return sampled_advance(b, v, end, why);
}

size_t behaviour_size(const Behaviour *b) { return sampled_size(b) + FLAGS; }

void behaviour_save(const Behaviour *b, double *to) {
    sampled_save(b, to);
    clock_save_flags(&((const Clocked *)b)->clock, to + sampled_size(b));
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    if (count != sampled_size(b) + FLAGS)
        return say(why, "the saved sampling clock does not fit this component");
    if (!sampled_restore(b, v, from, count - FLAGS, why)) return 0;
    clock_restore_flags(behaviour_clock(b), from + count - FLAGS);
    return 1;
}

void behaviour_tick(Behaviour *b, double *v, int clock) { (void)b, (void)v, (void)clock; }

int behaviour_update(Behaviour *b, double *v, Message *why) {
    (void)v, (void)why;
    behaviour_clock(b)->due |= behaviour_clock(b)->ticking[0];
    return 1;
}

int behaviour_interval(Behaviour *b, const double *v, int clock, int first, double *interval) {
    (void)b, (void)clock;
    *interval = v[V_sample_time];
    return first ? 2 : 1; /* changed, unchanged */
}

double behaviour_shift(const double *v, int clock) { return (void)v, (void)clock, 0.0; }
