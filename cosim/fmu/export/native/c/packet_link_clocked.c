/* The packet link of packet_link.c, which sends and delivers when its Clocks tick if event mode is
   used: `send` at the instants of sending, `arrive` when the next message that is on its way is
   there. So every arrival is an event, wherever the communication points are. */

#include "clocked.h"

#define behaviour_new link_new
#define behaviour_initialise link_initialise
#define behaviour_advance link_advance
#define behaviour_size link_size
#define behaviour_save link_save
#define behaviour_restore link_restore
#include "packet_link.c"
#undef behaviour_new
#undef behaviour_initialise
#undef behaviour_advance
#undef behaviour_size
#undef behaviour_save
#undef behaviour_restore

enum { SEND, ARRIVE };

typedef struct {
    Behaviour link; /* first: a pointer to it is one to the whole */
    ClockState clock;
    int64_t announced; /* the arrival that the importer knows of; -1: none */
} Clocked;

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Clocked)); }

ClockState *behaviour_clock(Behaviour *b) { return &((Clocked *)b)->clock; }

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    ((Clocked *)b)->announced = -1;
    return link_initialise(b, v, start, why);
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    if (!behaviour_clock(b)->used) return link_advance(b, v, end, why);
    b->clock = clock_moved(b->clock, end);
    if (fabs((double)b->clock.now) > 1e9 * LONGEST)
        return say(why, "a run must be no longer than %s s", shortest(LONGEST).text);
    publish(b, v);
    return 1;
}

void behaviour_tick(Behaviour *b, double *v, int clock) {
    if (clock != ARRIVE) return;
    receive_due(b, v);
    ((Clocked *)b)->announced = -1;
    publish(b, v);
}

int behaviour_update(Behaviour *b, double *v, Message *why) {
    return !behaviour_clock(b)->ticking[SEND] || send_due(b, v, why);
}

int behaviour_interval(Behaviour *b, const double *v, int clock, int first, double *interval) {
    if (clock == SEND) {
        *interval = v[V_sample_time];
        return first ? 2 : 1; /* changed, unchanged */
    }
    int64_t next = -1, *announced = &((Clocked *)b)->announced;
    for (size_t i = 0; i < b->count; i++)
        if (next < 0 || b->entry[i].arrival < next) next = b->entry[i].arrival;
    *interval = next < 0 ? 0.0 : (double)(next > b->clock.now ? next - b->clock.now : 0) / 1e9;
    int qualifier = next < 0 ? 0 : next == *announced ? 1 : 2; /* not yet known */
    *announced = next;
    return qualifier;
}

double behaviour_shift(const double *v, int clock) { return clock == SEND ? v[V_offset] : 0.0; }

size_t behaviour_size(const Behaviour *b) { return link_size(b) + FLAGS + 1; }

void behaviour_save(const Behaviour *b, double *to) {
    link_save(b, to);
    to = clock_save_flags(&((const Clocked *)b)->clock, to + link_size(b));
    *to = (double)((const Clocked *)b)->announced;
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    if (count < FLAGS + 1) return say(why, "the saved messages do not fit this link");
    size_t own = count - FLAGS - 1;
    if (!(fabs(from[count - 1]) < 1e18) || !link_restore(b, v, from, own, why)) return 0;
    clock_restore_flags(behaviour_clock(b), from + own);
    ((Clocked *)b)->announced = (int64_t)from[count - 1];
    return 1;
}
