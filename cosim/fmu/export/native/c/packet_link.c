/* A packet link between two communication points of whatever master steps it.

   What becomes of a message is decided in link_step.h. As cosim/network with events = "grid": a message is sent at the first point at or after its
   instant and arrives at the first point at or after sending + queue + delay + jitter, or, with a
   play-out buffer, comes out at the first point at or after sending + playout. What is
   sent at the beginning of a step is what the inputs are there; what arrives by its end is in
   the outputs then. A message that would arrive where it was sent is thus one step late: there
   is no output that follows an input at once. */

#include <stdlib.h>
#include <string.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "clock.h"
#include "draws.h"
#include "link_step.h"
#include "model.h"
#include "no_feedthrough.h"
#include "variable.h"

#define LANES ((size_t)MODEL_INPUTS)

#define MOST_MESSAGES 50000000
#define LONGEST 9007199.254740992 /* s: 2^53 ns, up to which doubles count them exactly */

typedef struct {
    int64_t arrival;
    LinkArrival is;
    double value[MOST_INPUTS];
} Entry;

typedef struct {
    Source source;
    Jitter jitter;
    int64_t period, offset, delay;
    LinkRules rules;
} Settings;

struct Behaviour {
    Settings is;
    Clock clock;
    int64_t next; /* message to be sent */
    LinkSender sender;
    LinkReceiver receiver;
    int state; /* of the chain of losses at the last message sent */
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
    for (int i = 0; i < (int)MODEL_STATES; i++) {
        double leave = 0.0;
        for (int j = 0; j < (int)MODEL_STATES - 1; j++)
            leave += v[model_others[i * ((int)MODEL_STATES - 1) + j]];
        if (leave > 1.0 + 1e-9)
            return say(why, "loss.move[%d,...] must add to at most 1: the rest is staying", i + 1);
    }
    if (rate != floor(rate) || size != floor(size) || (rate == 0.0) != (size == 0.0))
        return say(why, "data_rate and frame_size must be whole numbers, both or neither zero");
    if (rate > 0.0 && size / rate > LONGEST)
        return say(why, "frame_size / data_rate must be at most %s s", shortest(LONGEST).text);
    is->source.seed = (uint64_t)v[V_seed];
    is->source.name = model_text;
    is->period = nanoseconds(v[V_sample_time]);
    is->offset = nanoseconds(v[V_offset]);
    is->delay = nanoseconds(v[V_delay]);
    int64_t frame = frame_time(size, rate), limit = (int64_t)v[V_queue_limit];
    if (limit >= 0 && frame == 0) return say(why, "queue_limit must be -1 without a data_rate");
    is->rules.frame_ns = frame;
    is->rules.longest_wait_ns =
        limit < 0 || (limit > 0 && frame > LINK_NO_LIMIT / limit) ? LINK_NO_LIMIT : limit * frame;
    is->rules.playout_ns = nanoseconds(v[V_playout]);
    if (is->rules.playout_ns > 0 && is->rules.playout_ns < frame + is->delay)
        return say(why, "playout must be 0 (no buffer) or at least delay + frame_size / data_rate: "
                        "every message would be late");
    is->rules.fifo = v[V_order] == ORDER_FIFO;
    is->rules.newest_wins = v[V_order] == ORDER_NEWEST_WINS;
    is->rules.substitutes = v[V_on_loss_hold] == 0.0;
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
    v[V_age] = (double)(b->clock.now - b->receiver.origin_ns) / 1e9;
    v[V_sequence] = (double)b->receiver.sequence;
    v[V_dropped] = (double)b->receiver.dropped;
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    static const LinkSender sender = LINK_SENDER_AT_FIRST;
    static const LinkReceiver receiver = LINK_RECEIVER_AT_FIRST;
    if (!settle(&b->is, v, why)) return 0;
    b->clock = clock_at(start);
    b->next = 0;
    b->sender = sender;
    b->receiver = receiver;
    b->state = 0;
    b->count = 0;
    for (size_t i = 0; i < LANES; i++) v[model_outputs[i]] = v[model_initials[i]];
    publish(b, v);
    return 1;
}

/* ---- the sender */

static double quantized(double value, double step) {
    return step == 0.0 ? value : rint(value / step) * step;
}

/* The chain of losses: its states, and for each the probabilities of going to the others. */
typedef struct {
    int states;
    const unsigned *loss, *move;
} Chain;

static Chain chain_of(const double *v, unsigned two[4]) {
    Chain chain = {2, two, two + 2};
    two[0] = V_loss_good;
    two[1] = V_loss_bad;
    two[2] = V_loss_p_enter;
    two[3] = V_loss_p_exit;
    if (v[V_loss_bursts] == 2.0) {
        chain.states = (int)MODEL_STATES;
        chain.loss = model_states;
        chain.move = model_others;
    }
    return chain;
}

static int is_lost(Behaviour *b, const double *v, uint64_t k) {
    unsigned two[4];
    Chain chain = chain_of(v, two);
    double u = draw_uniform(&b->is.source, "loss", 0, k);
    if (v[V_loss_bursts] != 0.0 && k > 0) { /* the first message is sent in the first state */
        double change = draw_uniform(&b->is.source, "loss state", 0, k), reach = 0.0;
        const unsigned *move = chain.move + b->state * (chain.states - 1);
        for (int j = 0; j < chain.states - 1; j++) {
            reach += v[move[j]];
            if (change < reach) {
                b->state = j < b->state ? j : j + 1;
                break;
            }
        }
    }
    return u < v[chain.loss[b->state]];
}

static void put(Behaviour *b, const double *v, int64_t arrival, int64_t fate) {
    Entry *e = &b->entry[b->count++];
    e->arrival = arrival;
    e->is.message = b->next;
    e->is.sent_ns = b->clock.now;
    e->is.fate = fate;
    for (size_t i = 0; i < LANES; i++)
        e->value[i] = quantized(v[model_inputs[i]], v[V_quantization]);
}

/* Send the next message, with its draws, which are made whatever becomes of it. */
static void send(Behaviour *b, const double *v, const int64_t jitter[2]) {
    uint64_t k = (uint64_t)b->next;
    LinkMessage message = {b->clock.now, b->is.delay, jitter[0], is_lost(b, v, k), 0, jitter[1]};
    if (v[V_duplicate] > 0.0)
        message.copied = draw_uniform(&b->is.source, "duplicate", 0, k) < v[V_duplicate];
    LinkSending found = link_send(&b->is.rules, &b->sender, &message);
    b->sender.free_ns = found.free_ns;
    b->sender.behind_ns = found.behind_ns;
    put(b, v, found.arrival_ns, found.fate);
    if (found.copies) put(b, v, found.copy_arrival_ns, found.copy_fate);
    b->next++;
}

/* Every message whose instant has come by now. */
static int send_due(Behaviour *b, const double *v, Message *why) {
    int64_t since = b->clock.now - b->is.offset;
    int64_t due = since < 0 ? 0 : since / b->is.period + 1 - b->next;
    if (b->next + due > MOST_MESSAGES)
        return say(why, "more than %d messages: sample_time is too short for this run",
                   MOST_MESSAGES);
    if (b->is.rules.frame_ns > 0 && b->next + due > LINK_NO_LIMIT / b->is.rules.frame_ns)
        return say(why, "the messages take too long to send: data_rate is too small");
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

/* ---- the receiver */

static void receive(Behaviour *b, double *v, const Entry *e) {
    LinkReception found = link_receive(&b->is.rules, &b->receiver, &e->is);
    b->receiver.newest = found.newest;
    b->receiver.sequence = found.sequence;
    b->receiver.origin_ns = found.origin_ns;
    b->receiver.dropped = found.dropped;
    b->receiver.delivered = found.delivered;
    for (size_t i = 0; i < LANES; i++) {
        if (found.status == LINK_DELIVERED) v[model_outputs[i]] = e->value[i];
        if (found.noticed) v[model_outputs[i]] = v[V_on_loss_value];
    }
}

/* Receive what has arrived by now, and forget it. */
static void receive_due(Behaviour *b, double *v) {
    size_t kept = 0;
    for (size_t i = 0; i < b->count; i++) {
        if (b->entry[i].arrival <= b->clock.now)
            receive(b, v, &b->entry[i]);
        else
            b->entry[kept++] = b->entry[i];
    }
    b->count = kept;
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    Clock then = clock_moved(b->clock, end);
    if (fabs((double)then.now) > 1e9 * LONGEST)
        return say(why, "a run must be no longer than %s s", shortest(LONGEST).text);
    if (!send_due(b, v, why)) return 0;
    b->clock = then;
    receive_due(b, v);
    publish(b, v);
    return 1;
}

/* ---- the whole state */

#define OWN 9
#define HEAD (CLOCK_NUMBERS + OWN)
#define EACH (4 + LANES)

size_t behaviour_size(const Behaviour *b) { return HEAD + EACH * b->count; }

void behaviour_save(const Behaviour *b, double *to) {
    const LinkReceiver *r = &b->receiver;
    const int64_t own[OWN] = {b->next,       b->sender.free_ns, b->sender.behind_ns,
                              r->newest,     r->sequence,       r->origin_ns,
                              r->dropped,    r->delivered,      b->state};
    clock_save(&b->clock, to);
    to += CLOCK_NUMBERS;
    for (size_t i = 0; i < OWN; i++) *to++ = (double)own[i];
    for (size_t i = 0; i < b->count; i++) {
        const Entry *e = &b->entry[i];
        *to++ = (double)e->arrival;
        *to++ = (double)e->is.message;
        *to++ = (double)e->is.sent_ns;
        *to++ = (double)e->is.fate;
        memcpy(to, e->value, LANES * sizeof(double));
        to += LANES;
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
    unsigned two[4];
    if (!(from[CLOCK_NUMBERS + 8] >= 0.0 && from[CLOCK_NUMBERS + 8] < chain_of(v, two).states))
        return say(why, "the saved messages do not fit this link");
    size_t entries = (count - HEAD) / EACH;
    Entry *entry = realloc(b->entry, (entries ? entries : 1) * sizeof *entry);
    if (!entry) return say(why, "there is no memory left for the messages on their way");
    b->entry = entry;
    b->room = entries ? entries : 1;
    b->count = entries;
    from += CLOCK_NUMBERS;
    LinkSender sender = {(int64_t)from[1], (int64_t)from[2]};
    LinkReceiver receiver = {(int64_t)from[3], (int64_t)from[4], (int64_t)from[5],
                             (int64_t)from[6], (int64_t)from[7]};
    b->next = (int64_t)from[0];
    b->sender = sender;
    b->receiver = receiver;
    b->state = (int)from[8];
    from += OWN;
    for (size_t i = 0; i < entries; i++, from += EACH) {
        for (size_t j = 0; j < 4; j++)
            if (!(fabs(from[j]) < 1e18))
                return say(why, "the saved messages do not fit this link");
        LinkArrival is = {(int64_t)from[1], (int64_t)from[2], (int64_t)from[3]};
        entry[i].arrival = (int64_t)from[0];
        entry[i].is = is;
        memcpy(entry[i].value, from + 4, LANES * sizeof(double));
    }
    return 1;
}
