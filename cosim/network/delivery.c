/* The loop of `Delivery` (delivery.py) over many messages: send, wait until due, receive. The steps
   are those of stepping.py, translated into link_step.h, which stands in front. */

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef struct {
    int64_t time, turn;
    LinkArrival what;
} Due;

typedef struct {
    LinkRules rules;
    LinkSender sender;
    LinkReceiver receiver;
    int64_t step, end; /* of the points [ns] */
    int64_t due, copies; /* how many */
} Delivery;

static int comes_before(const Due *a, const Due *b) {
    return a->time != b->time ? a->time < b->time : a->turn < b->turn;
}

/* The first point at or after an instant; one after the end stays. */
static int64_t point_after(const Delivery *d, int64_t time) {
    if (d->step == 1 || time > d->end)
        return time;
    int64_t point = (time + d->step - 1) / d->step * d->step;
    return point < d->end ? point : d->end;
}

/* `due` is a binary heap, as Python's heapq has it. */
static void expect(Delivery *d, Due *due, int64_t time, int64_t turn, LinkArrival what) {
    Due one = {point_after(d, time), turn, what};
    if (one.time > d->end)
        return;
    int64_t i = d->due++;
    for (; i > 0 && comes_before(&one, &due[(i - 1) / 2]); i = (i - 1) / 2)
        due[i] = due[(i - 1) / 2];
    due[i] = one;
}

static Due next_due(Delivery *d, Due *due) {
    Due first = due[0], last = due[--d->due];
    int64_t i = 0, child;
    while ((child = 2 * i + 1) < d->due) {
        child += child + 1 < d->due && comes_before(&due[child + 1], &due[child]);
        if (!comes_before(&due[child], &last))
            break;
        due[i] = due[child];
        i = child;
    }
    due[i] = last;
    return first;
}

/* Receive what is due before an instant into 8 columns of `room`, from place `count` on; return how
   many there are then. */
static int64_t receive_before(
    Delivery *d, Due *due, int64_t horizon, int64_t *columns, int64_t count, int64_t room) {
    for (; d->due > 0 && due[0].time < horizon; count++) {
        Due one = next_due(d, due);
        LinkReception r = link_receive(&d->rules, &d->receiver, &one.what);
        d->receiver = (LinkReceiver){r.newest, r.sequence, r.origin_ns, r.dropped, r.delivered};
        int64_t changes = r.status == LINK_DELIVERED || r.noticed;
        const int64_t row[8] = {one.time, one.what.sent_ns, one.what.message, r.status,
                                changes, r.sequence, r.origin_ns, r.delivered};
        for (int c = 0; c < 8; c++)
            columns[c * room + count] = row[c];
    }
    return count;
}

/* Send messages first to first + n - 1, and receive what is due before `horizon`, no message being
   sent between: nothing sent later arrives before that. `due` has room for all of them and their
   copies, `columns` for what is received: returns how many. */
EXPORT int64_t deliver(
    Delivery *d, Due *due, int64_t horizon, int64_t first, int64_t n, const LinkMessage *messages,
    int64_t *copies, int64_t *columns, int64_t room) {
    int64_t count = 0;
    for (int64_t i = 0; i < n; i++) {
        int64_t sent = messages[i].sent_ns, k = first + i;
        count = receive_before(d, due, sent, columns, count, room);
        LinkSending s = link_send(&d->rules, &d->sender, &messages[i]);
        d->sender = (LinkSender){s.free_ns, s.behind_ns};
        expect(d, due, s.arrival_ns, 2 * k, (LinkArrival){k, sent, s.fate});
        if (s.copies) {
            expect(d, due, s.copy_arrival_ns, 2 * k + 1, (LinkArrival){k, sent, s.copy_fate});
            copies[d->copies++] = sent;
        }
    }
    return receive_before(d, due, horizon, columns, count, room);
}
