/* A packet link between two communication points of whatever master steps it.

   As cosim/network with events = "grid": a message is sent at the first point at or after its
   instant and arrives at the first point at or after sending + queue + delay + jitter. What is
   sent at the beginning of a step is what the inputs are there; what arrives by its end is in
   the outputs then. A message that would arrive where it was sent is thus one step late: there
   is no output that follows an input at once. */

#include <stdlib.h>
#include <string.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "clock.h"
#include "draws.h"
#include "model.h"
#include "variable.h"

#define NONE_YET (-1)
#define SUBSTITUTE (-2)
#define MOST_MESSAGES 50000000
#define LONGEST 1e8 /* s */

typedef enum { ARRIVES, LOST, REFUSED } Fate;

typedef struct {
    int64_t arrival, sent, message;
    Fate fate;
    double value[MODEL_LANES];
} Entry;

typedef struct {
    Source source;
    Jitter jitter;
    int64_t period, offset, delay, frame;
    double longest_wait; /* ns; HUGE_VAL without a limit */
} Settings;

struct Behaviour {
    Settings is;
    Clock clock;
    int64_t next;   /* message to be sent */
    int64_t free;   /* when the sender has sent all it took [ns] */
    int64_t behind; /* under fifo, when the last one to wait for arrives [ns] */
    int64_t newest, used, origin, dropped;
    int bad; /* state of the Gilbert-Elliott chain at the last message sent */
    Entry *entry; /* on their way, as they were sent */
    size_t count, room;
};

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Behaviour)); }

void behaviour_free(Behaviour *b) {
    if (b) free(b->entry);
    free(b);
}

/* ---- parameters */

/* frame_size / data_rate rounded up [ns], digit by digit: the product may exceed 64 bits. */
static int64_t frame_time(double size, double rate) {
    if (rate == 0.0) return 0;
    uint64_t whole = (uint64_t)size / (uint64_t)rate, rest = (uint64_t)size % (uint64_t)rate;
    for (int digit = 0; digit < 9; digit++) {
        rest *= 10;
        whole = 10 * whole + rest / (uint64_t)rate;
        rest %= (uint64_t)rate;
    }
    return (int64_t)(whole + (rest > 0));
}

static int settle(Settings *is, const double *v, Message *why) {
    double rate = v[V_data_rate], size = v[V_frame_size];
    if (rate != floor(rate) || size != floor(size) || (rate == 0.0) != (size == 0.0))
        return say(why, "data_rate and frame_size must be whole numbers, both or neither zero");
    if (rate > 0.0 && size / rate > LONGEST)
        return say(why, "frame_size / data_rate must be at most %s s", shortest(LONGEST).text);
    is->source.seed = (uint64_t)v[V_seed];
    is->source.name = model_link_name;
    is->period = nanoseconds(v[V_sample_time]);
    is->offset = nanoseconds(v[V_offset]);
    is->delay = nanoseconds(v[V_delay]);
    is->frame = frame_time(size, rate);
    is->longest_wait = v[V_queue_limit] < 0.0 ? HUGE_VAL : v[V_queue_limit] * (double)is->frame;
    if (v[V_queue_limit] >= 0.0 && is->frame == 0)
        return say(why, "queue_limit must be -1 without a data_rate");
    is->jitter.kind = (int)v[V_jitter_kind];
    is->jitter.width = rint(v[V_jitter_width] * 1e9);
    is->jitter.mean = rint(v[V_jitter_mean] * 1e9);
    is->jitter.sigma = rint(v[V_jitter_sigma] * 1e9);
    double max = rint(v[V_jitter_max] * 1e9);
    is->jitter.max = max > 0.0 ? max : HUGE_VAL;
    if (is->jitter.max < is->jitter.mean + is->jitter.sigma)
        return say(why, "jitter.max must be 0 (no bound) or at least jitter.mean + jitter.sigma");
    return 1;
}

static void publish(const Behaviour *b, double *v) {
    v[V_age] = (double)(b->clock.now - b->origin) / 1e9;
    v[V_sequence] = (double)b->used;
    v[V_dropped] = (double)b->dropped;
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    if (!settle(&b->is, v, why)) return 0;
    b->clock = clock_at(start);
    b->next = b->free = b->behind = b->origin = b->dropped = 0;
    b->newest = b->used = NONE_YET;
    b->bad = 0;
    b->count = 0;
    for (size_t i = 0; i < MODEL_LANES; i++) v[model_outputs[i]] = v[model_initials[i]];
    publish(b, v);
    return 1;
}

/* ---- the sender */

static double quantized(double value, double step) {
    return step == 0.0 ? value : rint(value / step) * step;
}

static int is_lost(Behaviour *b, const double *v, uint64_t k) {
    double u = draw_uniform(&b->is.source, "loss", 0, k);
    if (v[V_loss_bursts] == 0.0) return u < v[V_loss_good];
    if (k > 0) { /* the first message is sent in the good state */
        double change = draw_uniform(&b->is.source, "loss state", 0, k);
        b->bad = b->bad ? !(change < v[V_loss_p_exit]) : change < v[V_loss_p_enter];
    }
    return u < (b->bad ? v[V_loss_bad] : v[V_loss_good]);
}

static void put(Behaviour *b, const double *v, int64_t arrival, Fate fate) {
    Entry *e = &b->entry[b->count++];
    if (v[V_order] == ORDER_FIFO && fate != REFUSED) {
        if (arrival < b->behind) arrival = b->behind;
        if (fate == ARRIVES) b->behind = arrival;
    }
    e->arrival = arrival;
    e->sent = b->clock.now;
    e->message = b->next;
    e->fate = fate;
    for (size_t i = 0; i < MODEL_LANES; i++)
        e->value[i] = quantized(v[model_inputs[i]], v[V_quantization]);
}

/* Send the next message, with its draws, which are made whatever becomes of it. */
static void send(Behaviour *b, const double *v, const int64_t jitter[2]) {
    uint64_t k = (uint64_t)b->next;
    int64_t sent = b->clock.now;
    int lost = is_lost(b, v, k);
    if ((double)(b->free - sent) > b->is.longest_wait) {
        put(b, v, sent, REFUSED);
    } else {
        b->free = (b->free > sent ? b->free : sent) + b->is.frame;
        int64_t crosses = b->free + b->is.delay;
        put(b, v, crosses + jitter[0], lost ? LOST : ARRIVES);
        if (!lost && v[V_duplicate] > 0.0 &&
            draw_uniform(&b->is.source, "duplicate", 0, k) < v[V_duplicate])
            put(b, v, crosses + jitter[1], ARRIVES);
    }
    b->next++;
}

/* Every message whose instant has come by now. */
static int send_due(Behaviour *b, const double *v, Message *why) {
    int64_t since = b->clock.now - b->is.offset;
    int64_t due = since < 0 ? 0 : since / b->is.period + 1 - b->next;
    if (b->next + due > MOST_MESSAGES)
        return say(why, "more than %d messages: sample_time is too short for this run",
                   MOST_MESSAGES);
    size_t needed = b->count + 2 * (size_t)(due > 0 ? due : 0);
    if (needed > b->room) {
        Entry *more = realloc(b->entry, 2 * needed * sizeof *more);
        if (!more) return say(why, "there is no memory left for the messages on their way");
        b->entry = more;
        b->room = 2 * needed;
    }
    for (; due > 0; due--) {
        int64_t jitter[2] = {0, 0};
        uint64_t k = (uint64_t)b->next;
        jitter[0] = draw_jitter(&b->is.source, "jitter", &b->is.jitter, k);
        if (v[V_duplicate] > 0.0)
            jitter[1] = draw_jitter(&b->is.source, "copy jitter", &b->is.jitter, k);
        if (jitter[0] < 0 || jitter[1] < 0)
            return say(why, "no jitter between 0 and jitter.max could be drawn");
        send(b, v, jitter);
    }
    return 1;
}

/* ---- the receiver, as cosim/network/receiver.py */

static void receive(Behaviour *b, double *v, const Entry *e) {
    int hold = v[V_on_loss_hold] != 0.0;
    if (e->fate == ARRIVES && !(v[V_order] == ORDER_NEWEST_WINS && e->message <= b->newest)) {
        for (size_t i = 0; i < MODEL_LANES; i++) v[model_outputs[i]] = e->value[i];
        b->used = e->message;
        b->newest = e->message > b->newest ? e->message : b->newest;
        b->origin = e->sent;
        return;
    }
    b->dropped++;
    if (e->fate == LOST && !hold && b->newest < e->message) {
        for (size_t i = 0; i < MODEL_LANES; i++) v[model_outputs[i]] = v[V_on_loss_value];
        b->used = SUBSTITUTE;
    }
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    Clock then = clock_moved(b->clock, end);
    if (fabs((double)then.now) > 1e9 * LONGEST)
        return say(why, "a run must be no longer than %s s", shortest(LONGEST).text);
    if (!send_due(b, v, why)) return 0;
    b->clock = then;
    size_t kept = 0;
    for (size_t i = 0; i < b->count; i++) {
        if (b->entry[i].arrival <= b->clock.now)
            receive(b, v, &b->entry[i]);
        else
            b->entry[kept++] = b->entry[i];
    }
    b->count = kept;
    publish(b, v);
    return 1;
}

int behaviour_refresh(Behaviour *b, double *v, Message *why) {
    (void)b, (void)v, (void)why; /* no output depends on an input without delay */
    return 1;
}

void behaviour_direction(const Behaviour *b, const double *v, const double *change, double *out) {
    (void)b, (void)v, (void)change, (void)out;
}

/* ---- the whole state */

#define HEAD (CLOCK_NUMBERS + 8)
#define EACH (4 + MODEL_LANES)

size_t behaviour_size(const Behaviour *b) { return HEAD + EACH * b->count; }

void behaviour_save(const Behaviour *b, double *to) {
    const int64_t own[8] = {b->next, b->free,   b->behind,  b->newest,
                            b->used, b->origin, b->dropped, b->bad};
    clock_save(&b->clock, to);
    to += CLOCK_NUMBERS;
    for (size_t i = 0; i < 8; i++) *to++ = (double)own[i];
    for (size_t i = 0; i < b->count; i++) {
        const Entry *e = &b->entry[i];
        *to++ = (double)e->arrival;
        *to++ = (double)e->sent;
        *to++ = (double)e->message;
        *to++ = (double)e->fate;
        memcpy(to, e->value, sizeof e->value);
        to += MODEL_LANES;
    }
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    int fits = count >= HEAD && (count - HEAD) % EACH == 0;
    for (size_t i = 0; fits && i < count; i++) fits = fabs(from[i]) < HUGE_VAL;
    for (size_t i = CLOCK_NUMBERS; fits && i < HEAD; i++) fits = fabs(from[i]) < 1e18;
    if (!fits || !clock_restore(&b->clock, from) || from[CLOCK_NUMBERS] < 0.0)
        return say(why, "the saved messages do not fit this link");
    if (!settle(&b->is, v, why)) return 0;
    size_t entries = (count - HEAD) / EACH;
    Entry *entry = realloc(b->entry, (entries ? entries : 1) * sizeof *entry);
    if (!entry) return say(why, "there is no memory left for the messages on their way");
    b->entry = entry;
    b->room = entries ? entries : 1;
    b->count = entries;
    from += CLOCK_NUMBERS;
    b->next = (int64_t)from[0];
    b->free = (int64_t)from[1];
    b->behind = (int64_t)from[2];
    b->newest = (int64_t)from[3];
    b->used = (int64_t)from[4];
    b->origin = (int64_t)from[5];
    b->dropped = (int64_t)from[6];
    b->bad = from[7] != 0.0;
    from += 8;
    for (size_t i = 0; i < entries; i++, from += EACH) {
        if (!(fabs(from[0]) < 1e18 && fabs(from[1]) < 1e18 && fabs(from[2]) < 1e18))
            return say(why, "the saved messages do not fit this link");
        entry[i].arrival = (int64_t)from[0];
        entry[i].sent = (int64_t)from[1];
        entry[i].message = (int64_t)from[2];
        entry[i].fate = from[3] == LOST ? LOST : from[3] == REFUSED ? REFUSED : ARRIVES;
        memcpy(entry[i].value, from + 4, sizeof entry[i].value);
    }
    return 1;
}
