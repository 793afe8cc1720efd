#include "delay_line.h"

#include <stdlib.h>
#include <string.h>

#include "arithmetic.h"

#define N ((size_t)MODEL_STATES)
#define DELAYS ((size_t)MODEL_DELAYS)
#define STEP_LIMIT 200000 /* sub-steps in one communication step before it is refused */

static Piece *piece(const DelayLine *line, size_t number) {
    return &line->ring[number & (line->capacity - 1)];
}

static void copy(double *to, const double *x) { memcpy(to, x, N * sizeof *to); }

/* ---- memory */

static int no_memory(Message *why) { return say(why, "there is no memory left"); }

static int room_for_pieces(DelayLine *line, size_t more, Message *why) {
    size_t count = line->end - line->first, capacity = line->capacity ? line->capacity : 64;
    while (capacity < count + more) capacity *= 2;
    if (capacity == line->capacity) return 1;
    Piece *ring = malloc(capacity * sizeof *ring);
    if (!ring) return no_memory(why);
    for (size_t i = line->first; i != line->end; i++) ring[i & (capacity - 1)] = *piece(line, i);
    free(line->ring);
    line->ring = ring;
    line->capacity = capacity;
    return 1;
}

static int room(double **array, size_t *capacity, size_t count, Message *why) {
    if (count <= *capacity) return 1;
    size_t wanted = *capacity ? *capacity : 16;
    while (wanted < count) wanted *= 2;
    double *grown = realloc(*array, wanted * sizeof **array);
    if (!grown) return no_memory(why);
    *array = grown;
    *capacity = wanted;
    return 1;
}

void delay_line_free(DelayLine *line) {
    free(line->ring);
    free(line->jump);
    free(line->point);
}

/* ---- set-up */

static void insert_sorted(double *sorted, size_t *count, double value) {
    size_t i = *count;
    for (size_t k = 0; k < *count; k++)
        if (sorted[k] == value) return;
    for (; i > 0 && sorted[i - 1] > value; i--) sorted[i] = sorted[i - 1];
    sorted[i] = value;
    ++*count;
}

int delay_line_start(DelayLine *line, const double *initial, const double *delay, double step,
                     double start, Message *why) {
    for (size_t k = 0; k < DELAYS; k++)
        if (!(isfinite(delay[k]) && delay[k] >= 0.0))
            return say(why, "a delay must be finite and not negative, got %s",
                       shortest(delay[k]).text);
    if (!(isfinite(step) && step > 0.0))
        return say(why, "the internal step must be finite and positive, got %s",
                   shortest(step).text);
    line->time = line->start = start;
    line->step = step;
    copy(line->x, initial);
    copy(line->before, initial);
    line->shortest = HUGE_VAL;
    line->longest = 0.0;
    line->images = 0;
    for (size_t k = 0; k < DELAYS; k++) {
        line->delay[k] = delay[k];
        line->cursor[k] = 0;
        if (!(delay[k] > 0.0)) continue;
        line->shortest = lesser(line->shortest, delay[k]);
        line->longest = greater(line->longest, delay[k]);
        insert_sorted(line->image, &line->images, delay[k]);
        for (size_t j = 0; j <= k; j++)
            if (delay[j] > 0.0) insert_sorted(line->image, &line->images, delay[j] + delay[k]);
    }
    line->settled = 0;
    line->first = line->end = 0;
    line->jumps = line->points = 0;
    memset(line->head, 0, sizeof line->head);
    return 1;
}

/* ---- history */

/* Fill `out` with x(t). True if a piece more would not change the answer. */
static int look_up(DelayLine *line, size_t k, double t, double *out) {
    if (t <= line->start || line->first == line->end) {
        copy(out, line->before);
        return t <= line->start;
    }
    size_t i = line->cursor[k];
    if (i < line->first) i = line->first;
    if (i > line->end) i = line->end;
    while (i < line->end && piece(line, i)->t1 <= t) i++;
    while (i > line->first && piece(line, i - 1)->t1 > t) i--;
    line->cursor[k] = i;
    int settled = i < line->end;
    if (!settled) i--; /* t is the present, or rounding has put it just past */
    const Piece *p = piece(line, i);
    double h = p->t1 - p->t0;
    double s = (t - p->t0) / h;
    double r = 1.0 - s;
    double a = r * r * (1.0 + 2.0 * s);
    double b = s * s * (3.0 - 2.0 * s);
    double c = h * s * r * r;
    double e = -h * s * s * r;
    for (size_t j = LATE_BEGIN; j < LATE_END; j++)
        out[j] = a * p->x0[j] + b * p->x1[j] + c * p->m0[j] + e * p->m1[j];
    return settled;
}

/* Delayed states at time t, with x for delays of zero. True if a piece more changes nothing. */
static int lagged(DelayLine *line, double t, const double *x, double *late) {
    int settled = 1;
    for (size_t k = 0; k < DELAYS; k++) {
        if (line->delay[k] > 0.0)
            settled &= look_up(line, k, t - line->delay[k], late + k * N);
        else
            copy(late + k * N, x);
    }
    return settled;
}

static void lagged_present(const DelayLine *line, const double *x, double *late) {
    for (size_t k = 0; k < DELAYS; k++)
        if (!(line->delay[k] > 0.0)) copy(late + k * N, x);
}

/* ---- one step */

/* From t0 to t1, with the slope k1 at t0; the new piece holds the slope at t1. */
static int runge_kutta(DelayLine *line, double t0, double t1, const double *k1, const Held *held,
                       Message *why) {
    double late[AT_LEAST_ONE(MOST_DELAYS) * MOST_STATES];
    double k2[MOST_STATES], k3[MOST_STATES], k4[MOST_STATES], x[MOST_STATES];
    Piece *p = piece(line, line->end);
    const double *x0 = line->x;
    double h = t1 - t0;
    double tm = t0 + 0.5 * h;
    double half = 0.5 * h;
    double sixth = h / 6.0;
    for (size_t i = 0; i < N; i++) x[i] = x0[i] + half * k1[i];
    lagged(line, tm, x, late);
    model_rates(tm, x, late, held->v, held->c, k2);
    for (size_t i = 0; i < N; i++) x[i] = x0[i] + half * k2[i];
    lagged_present(line, x, late);
    model_rates(tm, x, late, held->v, held->c, k3);
    for (size_t i = 0; i < N; i++) x[i] = x0[i] + h * k3[i];
    int settled = lagged(line, t1, x, late);
    model_rates(t1, x, late, held->v, held->c, k4);
    double zero = 0.0; /* stays it as long as every x1 - x1 is, that is, every x1 is finite */
    copy(p->x0, x0);
    copy(p->m0, k1);
    for (size_t i = 0; i < N; i++)
        p->x1[i] = x0[i] + sixth * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
    for (size_t i = 0; i < N; i++) zero += p->x1[i] - p->x1[i];
    if (zero != 0.0)
        return say(why, "the state is no longer finite after t = %s s", shortest(t0).text);
    p->t0 = t0;
    p->t1 = t1;
    lagged_present(line, p->x1, late);
    model_rates(t1, p->x1, late, held->v, held->c, p->m1);
    copy(line->x, p->x1);
    line->settled = settled;
    line->end++;
    return 1;
}

/* ---- between communication points */

/* How often a step is halved: the least whole number >= log2(ratio) - 1e-9 and >= 0. The
   logarithm itself is needed only where the answer hangs on its last bits. */
static int halvings(double ratio) {
    int exponent;
    if (ratio < 1.0 + 5e-10) return 0;
    double mantissa = 2.0 * frexp(ratio, &exponent); /* ratio = mantissa 2^(exponent - 1) */
    if (mantissa > 1.0 + 1e-8) return exponent;
    return mantissa < 1.0 + 5e-10 ? exponent - 1 : (int)ceil(log2(ratio) - 1e-9);
}

static double image_of(const DelayLine *line, size_t i) {
    return line->jump[line->head[i]] + line->image[i];
}

/* Ends of the aligned segments in (begin, end], none longer than the shortest delay. */
static int segment_ends(DelayLine *line, double begin, double end, Message *why) {
    /* images that rounding alone keeps apart from each other or from the ends are one */
    double near = 16.0 * spacing(greater(1.0, fabs(end)));
    double previous = begin;
    line->points = 0;
    for (;;) {
        size_t next = line->images;
        for (size_t i = 0; i < line->images; i++)
            if (line->head[i] < line->jumps &&
                (next == line->images || image_of(line, i) < image_of(line, next)))
                next = i;
        double point = end;
        int last = next == line->images || image_of(line, next) > end + near;
        if (!last) {
            point = image_of(line, next);
            line->head[next]++;
        }
        if (!(point - previous <= near || (end - point <= near && point != end))) {
            double parts = (point - previous) / line->shortest; /* infinite for a denormal delay */
            if (parts > STEP_LIMIT)
                return say(why,
                           "a delay of %s s divides a communication step of %s s into %.3g parts; "
                           "at most %d are taken: use a shorter communication step, or no delay "
                           "at all",
                           shortest(line->shortest).text, shortest(end - begin).text, parts,
                           STEP_LIMIT);
            double count = parts <= 1.0 && parts > 1e-9 ? 1.0 : ceil(parts - 1e-9);
            if (!room(&line->point, &line->point_capacity, line->points + (size_t)count + 1, why))
                return 0;
            for (double i = 1.0; i < count; i++)
                line->point[line->points++] = previous + (point - previous) * i / count;
            line->point[line->points++] = point;
            previous = point;
        }
        if (last) return 1;
    }
}

int delay_line_advance(DelayLine *line, double end, const Held *held, int jump, int same,
                       Message *why) {
    double begin = line->time;
    if (!(end > begin))
        return say(why, "a step must end after %s s, got %s s", shortest(begin).text,
                   shortest(end).text);
    if ((jump || begin == line->start) && line->images > 0) {
        if (!room(&line->jump, &line->jump_capacity, line->jumps + 1, why)) return 0;
        line->jump[line->jumps++] = begin;
    }
    if (!segment_ends(line, begin, end, why)) return 0;
    double longest = lesser(end - begin, line->shortest);
    int halved = halvings(longest / line->step);
    double parts = halved < 63 ? (double)(INT64_C(1) << halved) : HUGE_VAL;
    double total = parts * (double)line->points;
    if (total > STEP_LIMIT)
        return say(why,
                   "%.15g sub-steps in one communication step of %s s (delay %s s, internal step "
                   "%s s); at most %d are taken: use a longer step, or no delay at all",
                   total, shortest(end - begin).text, shortest(line->shortest).text,
                   shortest(line->step).text, STEP_LIMIT);
    if (!room_for_pieces(line, (size_t)total, why)) return 0;
    double first[MOST_STATES];
    const double *slope = first;
    if (same && line->settled) {
        slope = piece(line, line->end - 1)->m1;
    } else {
        double late[AT_LEAST_ONE(MOST_DELAYS) * MOST_STATES];
        lagged(line, begin, line->x, late);
        model_rates(begin, line->x, late, held->v, held->c, first);
    }
    double left = begin;
    for (size_t s = 0; s < line->points; s++) {
        double right = line->point[s];
        for (double i = 0.0; i < parts; i++) {
            double t0 = i == 0.0 ? left : left + (right - left) * i / parts;
            double t1 = i == parts - 1.0 ? right : left + (right - left) * (i + 1.0) / parts;
            if (!runge_kutta(line, t0, t1, slope, held, why)) return 0;
            slope = piece(line, line->end - 1)->m1;
        }
        left = right;
    }
    line->time = end;
    return 1;
}

/* ---- what was */

Mark delay_line_mark(const DelayLine *line) {
    Mark mark;
    mark.time = line->time;
    mark.end = line->end;
    mark.jumps = line->jumps;
    mark.settled = line->settled;
    memcpy(mark.head, line->head, sizeof mark.head);
    return mark;
}

void delay_line_return(DelayLine *line, const Mark *mark) {
    if (line->end > mark->end) copy(line->x, piece(line, mark->end)->x0);
    line->time = mark->time;
    line->end = mark->end;
    line->jumps = mark->jumps;
    line->settled = mark->settled;
    memcpy(line->head, mark->head, sizeof line->head);
}

static size_t jumps_done(const DelayLine *line) {
    size_t done = line->jumps;
    for (size_t i = 0; i < line->images; i++)
        if (line->head[i] < done) done = line->head[i];
    return done;
}

void delay_line_forget(DelayLine *line) {
    /* one piece more than needed: a look-up may fall just before the oldest time by rounding */
    double oldest = line->time - line->longest;
    while (line->end - line->first > 1 && piece(line, line->first + 1)->t1 <= oldest)
        line->first++;
    size_t done = jumps_done(line);
    /* moved seldom, and never by less than half of what there is */
    if (done > 16 && 2 * done > line->jumps) {
        memmove(line->jump, line->jump + done, (line->jumps - done) * sizeof *line->jump);
        line->jumps -= done;
        for (size_t i = 0; i < line->images; i++) line->head[i] -= done;
    }
}

#define PIECE_SIZE (2 + 4 * N)

static double *put(double *to, const double *from, size_t count) {
    if (count > 0) memcpy(to, from, count * sizeof *to);
    return to + count;
}

size_t delay_line_size(const DelayLine *line) {
    return 4 + 2 * N + line->images + (line->end - line->first) * PIECE_SIZE + line->jumps -
           jumps_done(line);
}

void delay_line_save(const DelayLine *line, double *to) {
    size_t done = jumps_done(line);
    *to++ = line->time;
    *to++ = line->start;
    *to++ = (double)(line->end - line->first);
    *to++ = (double)(line->jumps - done);
    to = put(to, line->x, N);
    to = put(to, line->before, N);
    for (size_t i = 0; i < line->images; i++) *to++ = (double)(line->head[i] - done);
    for (size_t i = line->first; i != line->end; i++) {
        const Piece *p = piece(line, i);
        *to++ = p->t0;
        *to++ = p->t1;
        to = put(put(put(put(to, p->x0, N), p->x1, N), p->m0, N), p->m1, N);
    }
    put(to, line->jump + done, line->jumps - done);
}

/* Whether x is a whole number from 0 to `most`. */
static int counts(double x, double most) { return x >= 0.0 && x <= most && x == floor(x); }

int delay_line_restore(DelayLine *line, const double *from, size_t count, Message *why) {
    static const char *const unfit = "the saved history does not fit this component";
    size_t fixed = 4 + 2 * N + line->images;
    if (count < fixed || !counts(from[2], (double)count) || !counts(from[3], (double)count))
        return say(why, unfit);
    size_t pieces = (size_t)from[2], jumps = (size_t)from[3];
    if (count != fixed + pieces * PIECE_SIZE + jumps) return say(why, unfit);
    for (size_t i = 0; i < count; i++)
        if (!isfinite(from[i])) return say(why, unfit);
    const double *heads = from + 4 + 2 * N, *first = from + fixed;
    for (size_t i = 0; i < line->images; i++)
        if (!counts(heads[i], (double)jumps)) return say(why, unfit);
    double reached = from[1];
    for (size_t i = 0; i < pieces; i++) {
        const double *ends = first + i * PIECE_SIZE;
        if (!(ends[0] < ends[1] && ends[0] >= reached)) return say(why, unfit);
        reached = ends[1];
    }
    if (from[0] < reached) return say(why, unfit);
    if (!room_for_pieces(line, pieces, why)) return 0;
    if (jumps > 0 && !room(&line->jump, &line->jump_capacity, jumps, why)) return 0;
    line->time = from[0];
    line->start = from[1];
    copy(line->x, from + 4);
    copy(line->before, from + 4 + N);
    for (size_t i = 0; i < line->images; i++) line->head[i] = (size_t)heads[i];
    line->first = 0;
    line->end = pieces;
    for (size_t i = 0; i < pieces; i++) {
        const double *saved = first + i * PIECE_SIZE;
        Piece *p = piece(line, i);
        p->t0 = saved[0];
        p->t1 = saved[1];
        copy(p->x0, saved + 2);
        copy(p->x1, saved + 2 + N);
        copy(p->m0, saved + 2 + 2 * N);
        copy(p->m1, saved + 2 + 3 * N);
    }
    line->jumps = jumps;
    put(line->jump, first + pieces * PIECE_SIZE, jumps);
    line->settled = 0;
    return 1;
}
