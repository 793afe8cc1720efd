/* The loop of a co-simulation: carries out a table of operations at each communication point.

   `plain_loop.py` is the specification: it carries out the same table, bit for bit. Compiled
   without contraction of floating-point operations, and called through one function, `run`. One
   library with the loop over messages, delivery.c, which stands in front. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(__SSE2__) || defined(_M_X64)
#include <xmmintrin.h>
#if defined(__GNUC__) /* the x87 unit too: C libraries take their rounding mode (strtod) from it */
static uint16_t word_of_x87(void) {
    uint16_t word;
    __asm__ volatile("fnstcw %0" : "=m"(word));
    return word;
}
static void set_word_of_x87(uint16_t word) { __asm__ volatile("fldcw %0" : : "m"(word)); }
#else
static uint16_t word_of_x87(void) { return 0; }
static void set_word_of_x87(uint16_t word) { (void)word; }
#endif
static uint64_t modes(void) { return (uint64_t)word_of_x87() << 16 | (_mm_getcsr() & 0xFFC0u); }
static void restore(uint64_t saved) {
    _mm_setcsr((unsigned)saved & 0xFFC0u);
    set_word_of_x87((uint16_t)(saved >> 16));
}
#elif defined(__aarch64__)
static uint64_t modes(void) {
    uint64_t found;
    __asm__ volatile("mrs %0, fpcr" : "=r"(found));
    return found;
}
static void restore(uint64_t saved) { __asm__ volatile("msr fpcr, %0" : : "r"(saved)); }
#else
#include <fenv.h>
static uint64_t modes(void) { return (uint64_t)fegetround(); }
static void restore(uint64_t saved) { fesetround((int)saved); }
#endif

enum { GET, SET, MOVE, STEP, COMPLETE, GUESS, SETTLE, KEEP };
enum { SELDOM, USUAL_GET, USUAL_SET, USUAL_STEP, USUAL_COMPLETE, USUAL_GATHER,
       USUAL_GATHER_AND_SET };
enum { NEIGHBOURS, SCATTERED, ALTERED }; /* what is special in a move */
enum { ALWAYS, AT_FIRST, NOT_AT_LAST };
enum { F8, F4, I1, U1, I2, U2, I4, U4, I8, U8, IN_PYTHON };
enum { NO_EVENTS, EVENTS, MAY_RETURN_EARLY }; /* of the component that a step is of */
#define TOO_LARGE (INT64_C(1) << 32) /* and the next ones: no FMU can return them, see exchange.py */
#define ENDED (TOO_LARGE + 1)
#define UNSETTLED (TOO_LARGE + 2)
#define OUT_OF_RANGE (TOO_LARGE + 3)
#define GUARDED (TOO_LARGE + 4)
#define JUMPED (TOO_LARGE + 5)
#define RETURNED (TOO_LARGE + 6)
#define ANNOUNCED (TOO_LARGE + 7)
#define RAISED (TOO_LARGE + 8)
#define AHEAD 4         /* rows that are brought to the cache before they are written: */
#define MOST_FETCHED 64 /* so many of their values; longer rows come by themselves */
#define ROW_SUM 260 /* where the word has the sum of the complete rows, see table.py */
#define EXACT 9007199254740992.0 /* 2^53 */

/* One operation; the names are explained in table.py. Every field has eight bytes; what the usual
   ones need stands in front, within two lines of the cache. */
typedef struct {
    int64_t usual, number;
    void *function, *component;
    const uint32_t *references;
    uint64_t count;
    int64_t column;
    const int64_t *row;
    int64_t source;
    uint64_t values;
    const int64_t *pairs;
    int64_t kind, special, type, fmi3, when, ahead, spare;
    const int64_t *following;
    void *scratch;
    const int64_t *after;
    const double *weight;
    double quantization, substitute;
    int64_t substituted;
    uint8_t *results;
    int64_t back, limit;
    double tolerance;
    int64_t events;
    void *save, **state; /* before the step, of a component that another one may have taken back */
} Operation;

/* What the operations of a run share. */
typedef struct {
    double *rows;
    int64_t width, outputs, spare, final, no_way_back;
    const int64_t *points;
    const double *seconds, *sizes, *bounds;
    const double *factor, *offset;
    const uint8_t *active;
    const int64_t *adjustments, *copying;
    volatile int64_t *word;
    int64_t status, column, passes; /* of an early stop; of the algebraic loop that goes on */
    const struct Guards *guards;    /* NULL: none */
    int64_t announced;              /* an event, by a step of this point */
} Run;

/* The values of a name: of row index[k] of `base`, or without an index one for each point. */
typedef struct {
    const double *base;
    const int64_t *index;
    int64_t stride;
} Source;

/* An operation of the conditions on the values of those before it; the result is in its slot. */
typedef struct {
    int64_t operation, a, b;
    double value;
} Node;

/* Conditions of which each is expected to be 1 or 0, or not watched (-1); see guards.py. */
typedef struct Guards {
    const Source *sources;
    const Node *nodes;
    double *slots;
    int64_t count;
    const int64_t *results, *expected;
    int64_t conditions;
} Guards;

typedef int64_t __attribute__((may_alias)) Bits;
typedef int (*Exchange2)(void *, const uint32_t *, size_t, void *);
typedef int (*Exchange3)(void *, const uint32_t *, size_t, void *, size_t);
typedef int (*Step2)(void *, double, double, int);
typedef int (*Step3)(void *, double, double, uint8_t, uint8_t *, uint8_t *, uint8_t *, double *);
typedef int (*Save)(void *, void **);
typedef int64_t (*InPython)(int64_t);

static void adjust(const Run *r, double *row, const Operation *o) {
    for (int64_t j = o->column; j < o->column + (int64_t)o->values; j++)
        if (r->active[j])
            row[j] = r->factor[j] == 0.0 ? r->offset[j] : r->factor[j] * row[j] + r->offset[j];
}

static int exchange(const Operation *o, void *values) {
    if (o->fmi3)
        return ((Exchange3)o->function)(o->component, o->references, o->count, values, o->values);
    return ((Exchange2)o->function)(o->component, o->references, o->count, values);
}

#define EACH(T, WORK)                                                                              \
    {                                                                                              \
        T *typed = o->scratch;                                                                     \
        for (uint64_t j = 0; j < o->values; j++) {                                                 \
            WORK;                                                                                  \
        }                                                                                          \
        break;                                                                                     \
    }
#define EVERY_TYPE(WORK)                                                                           \
    switch (o->type) {                                                                             \
    case F4: EACH(float, WORK(float))                                                              \
    case I1: EACH(int8_t, WORK(int8_t))                                                            \
    case U1: EACH(uint8_t, WORK(uint8_t))                                                          \
    case I2: EACH(int16_t, WORK(int16_t))                                                          \
    case U2: EACH(uint16_t, WORK(uint16_t))                                                        \
    case I4: EACH(int32_t, WORK(int32_t))                                                          \
    case U4: EACH(uint32_t, WORK(uint32_t))                                                        \
    case I8: EACH(int64_t, WORK(int64_t))                                                          \
    case U8: EACH(uint64_t, WORK(uint64_t))                                                        \
    }
#define INTO(T) typed[j] = (T)values[j]
#define FROM(T) values[j] = (double)typed[j]

/* Values of another type than double: converted in the scratch of the operation, or by Python. */
static int64_t typed_exchange(const Run *r, const Operation *o, double *row) {
    double *values = row + o->column;
    if (o->type == IN_PYTHON)
        return ((InPython)o->function)((row - r->rows) / r->width);
    if (o->kind == SET) {
        EVERY_TYPE(INTO)
        return exchange(o, o->scratch);
    }
    int status = exchange(o, o->scratch);
    EVERY_TYPE(FROM)
    if (status == 0 || status == 1)
        for (uint64_t j = 0; j < o->values; j++) {
            const int64_t *whole = o->scratch;
            const uint64_t *natural = o->scratch;
            if (o->type == I8 && (whole[j] > (int64_t)EXACT || whole[j] < -(int64_t)EXACT))
                return TOO_LARGE;
            if (o->type == U8 && natural[j] > (uint64_t)EXACT)
                return TOO_LARGE;
        }
    return status;
}

/* Values from anywhere in a row, unaltered. */
static inline void gather(const Run *r, const Operation *o, int64_t k, double *target) {
    int64_t used = o->row[k];
    if (used < 0)
        return;
    const double *from = r->rows + used * r->width;
    for (uint64_t j = 0; j < o->values; j++)
        target[o->pairs[2 * j + 1]] = from[o->pairs[2 * j]];
}

static void move_specially(const Run *r, const Operation *o, int64_t k, double *target) {
    int64_t used = o->row[k];
    if (used >= 0) {
        const double *from = r->rows + used * r->width;
        double share = o->weight ? o->weight[k] : 0.0;
        const double *then = share > 0.0 ? r->rows + o->after[k] * r->width : from;
        for (uint64_t j = 0; j < o->values; j++) {
            double value = from[o->pairs[2 * j]];
            if (share > 0.0)
                value = (1.0 - share) * value + share * then[o->pairs[2 * j]];
            if (o->quantization != 0.0)
                value = rint(value / o->quantization) * o->quantization;
            target[o->pairs[2 * j + 1]] = value;
        }
    } else if (used == -2 && o->substituted) {
        for (uint64_t j = 0; j < o->values; j++)
            target[o->pairs[2 * j + 1]] = o->substitute;
    }
}

/* Neighbouring values, unaltered. */
static inline void move(const Run *r, const Operation *o, int64_t k, double *target) {
    int64_t used = o->row[k];
    if (used < 0)
        return;
    const double *from = r->rows + used * r->width + o->source;
    target += o->column;
    for (uint64_t j = 0; j < o->values; j++)
        target[j] = from[j];
}

/* The values that a set takes directly: in the row of the sender, or gathered from there. */
static inline double *taken(double *rows, const Operation *o, int64_t used, int64_t width) {
    double *from = rows + used * width, *values = o->scratch;
    if (!o->pairs)
        return from + o->source;
    for (uint64_t j = 0; j < o->values; j++)
        values[j] = from[o->pairs[2 * j]];
    return values;
}

/* Set inputs from the row of the sender, or from their own row if values are altered there. */
static inline int64_t set_directly(const Run *r, const Operation *o, int64_t k, double *row) {
    int64_t used = o->row[k];
    double *values = row + o->column;
    if (used >= 0 && !*r->copying)
        values = taken(r->rows, o, used, r->width);
    else if (used >= 0 && o->pairs)
        gather(r, o, k, row);
    else if (used >= 0)
        move(r, o, k, row);
    if (*r->copying)
        adjust(r, row, o);
    return exchange(o, values);
}

static inline int64_t step(Run *r, const Operation *o, int64_t k, int64_t following) {
    double now = r->seconds[k], size = r->sizes[k];
    if (o->following)
        size = (double)(r->points[following] - r->points[k]) / 1e9;
    int final = o->special || r->no_way_back; /* FMI 1.0 asks whether the step is a new one */
    if (!o->fmi3)
        return ((Step2)o->function)(o->component, now, size, final);
    if (o->save) {
        int saved = ((Save)o->save)(o->component, o->state);
        if (saved != 0 && saved != 1)
            return saved;
    }
    uint8_t *out = o->results;
    out[0] = out[1] = out[2] = 0;
    int status = ((Step3)o->function)(o->component, now, size, (uint8_t)final, out, out + 1,
                                      out + 2, (double *)(out + 8));
    if (status != 0 && status != 1)
        return status;
    if (o->events && out[0])
        r->announced = 1;
    if (out[2] && !out[1] && o->events == MAY_RETURN_EARLY)
        return RETURNED;
    return out[1] || out[2] ? ENDED : status;
}

/* Whether one of the values whose jump is an event is another one than in the row before. */
static int jumps(const Run *r, const Operation *o, const double *row) {
    for (int64_t j = 0; j < o->limit; j++)
        if (row[o->pairs[j]] != (o->back ? 0.0 : row[o->pairs[j] - r->width]))
            return 1;
    return 0;
}

/* Values that nobody has now: those of the row before, or of a Clock that does not tick. */
static void keep(const Run *r, const Operation *o, double *row) {
    for (int64_t j = o->column; j < o->column + (int64_t)o->values; j++)
        row[j] = o->special ? 0.0 : row[j - r->width];
}

/* Whether an output of a complete row is out of range. The magnitudes of doubles are in the order
   of their bits as integers, with infinity and NaN, which are in no range, above all bounds. */
static int64_t outside(Run *r, const double *row, int64_t k) {
    /* one by one: the FMUs have just written them so, and a load of two would wait for both */
    const volatile Bits *values = (const volatile Bits *)row;
    const Bits *bounds = (const Bits *)r->bounds;
    uint64_t even = 0, odd = 0, evens = 0, odds = 0, total = 0; /* see row_sums.py */
    int64_t found = 0, j = 0, n = r->outputs;
    for (; j + 1 < n; j += 2) {
        int64_t one = values[j], other = values[j + 1];
        found |= (bounds[j] - (one & INT64_MAX)) | (bounds[j + 1] - (other & INT64_MAX));
        evens += even, odds += odd;
        even += (uint64_t)one, odd += (uint64_t)other;
    }
    if (j < n) {
        int64_t one = values[j];
        found |= bounds[j] - (one & INT64_MAX);
        total = (uint64_t)one * (uint64_t)(2 * n - 1);
    }
    total += 4 * (evens + odds) + even + 3 * odd;
    r->word[ROW_SUM] = (int64_t)((uint64_t)r->word[ROW_SUM] + total * (uint64_t)(2 * k + 1));
    if (found >= 0)
        return 0;
    for (r->column = 0; fabs(row[r->column]) <= r->bounds[r->column]; r->column++)
        ;
    return OUT_OF_RANGE;
}

/* Begin the passes of an algebraic loop with the values of the row before. */
static void guess(Run *r, const Operation *o, int64_t k, double *row) {
    r->passes = 0;
    for (uint64_t j = 0; k > 0 && j < o->values; j++)
        row[o->pairs[j]] = row[o->pairs[j] - r->width];
    for (uint64_t j = 0; j < o->values; j++)
        ((double *)o->scratch)[j] = row[o->pairs[j]];
}

/* Whether a pass of an algebraic loop changed a value. */
static int unsettled(Run *r, const Operation *o, const double *row) {
    int found = 0;
    double *kept = o->scratch;
    for (uint64_t j = 0; j < o->values; j++) {
        double value = row[o->pairs[j]], size = fabs(value);
        if (!(fabs(value - kept[j]) <= o->tolerance * (size > 1.0 ? size : 1.0))) {
            r->column = o->pairs[j];
            found = 1;
        }
        kept[j] = value;
    }
    r->passes++;
    return found;
}

enum { SYMBOL, CONSTANT, ADD, SUBTRACT, MULTIPLY, DIVIDE, NEGATE, POWER, LESSER, GREATER, SIN, COS,
       EXP, LOG, ROOT, ABSOLUTE, ARCSINE, ARCTANGENT, TAN, ARCCOSINE, ARCTAN, FLOOR, ROUND,
       HYPOTENUSE, LESS, LESS_EQUAL, EQUAL };

/* Whether every condition is in row k what is expected of it; `first` : the point of the first
   value of what has no index. What has no value is NaN, and 0 to a negative power infinite: as
   in functions.py. */
static int are_met(const Guards *g, int64_t k, int64_t first) {
    double *slot = g->slots;
    for (int64_t i = 0; i < g->count; i++) {
        const Node *o = g->nodes + i;
        double a, b, r;
        if (o->operation == SYMBOL) {
            const Source *s = g->sources + o->a;
            slot[i] = s->index ? s->base[s->index[k] * s->stride] : s->base[k - first];
            continue;
        }
        if (o->operation == CONSTANT) {
            slot[i] = o->value;
            continue;
        }
        a = slot[o->a], b = slot[o->b];
        switch (o->operation) {
        case ADD: r = a + b; break;
        case SUBTRACT: r = a - b; break;
        case MULTIPLY: r = a * b; break;
        case DIVIDE: r = a / b; break;
        case NEGATE: r = -a; break;
        case POWER: r = a == 0.0 && b < 0.0 ? INFINITY : power(a, b); break;
        case LESSER: r = a <= b || a != a ? a : b; break;
        case GREATER: r = a >= b || a != a ? a : b; break;
        case SIN: r = sin(a); break;
        case COS: r = cos(a); break;
        case EXP: r = exp(a); break;
        case LOG: r = log(a); break;
        case ABSOLUTE: r = fabs(a); break;
        case ARCSINE: r = asin(a); break;
        case ARCTANGENT: r = atan2(a, b); break;
        case TAN: r = tan(a); break;
        case ARCCOSINE: r = acos(a); break;
        case ARCTAN: r = atan(a); break;
        case FLOOR: r = floor(a); break;
        case ROUND: r = rint(a); break;
        case HYPOTENUSE: r = hypot(a, b); break;
        case LESS: r = a < b; break;
        case LESS_EQUAL: r = a <= b; break;
        case EQUAL: r = a == b; break;
        default: r = sqrt(a);
        }
        slot[i] = r;
    }
    for (int64_t i = 0; i < g->conditions; i++)
        if (g->expected[i] >= 0 && (slot[g->results[i]] != 0.0) != g->expected[i])
            return 0;
    return 1;
}

/* Carry out one operation of any kind at a point. */
static int64_t carry_out_any(Run *r, const Operation *table, const Operation **at, int64_t k) {
    const Operation *o = *at;
    int64_t following = k + 1;
    if (o->when != ALWAYS && (o->when == AT_FIRST ? k > 0 : k == r->final))
        return 0;
    if (o->following && (following = o->following[k]) < 0)
        return 0;
    double *row = r->rows + r->width * (o->ahead ? following : o->spare ? r->spare : k);
    int64_t status = 0;
    switch (o->kind) {
    case GET:
        status = o->special ? typed_exchange(r, o, row) : exchange(o, row + o->column);
        if (*r->adjustments)
            adjust(r, row, o);
        break;
    case SET:
        if (o->row)
            return set_directly(r, o, k, row);
        if (*r->adjustments)
            adjust(r, row, o);
        if (o->limit && jumps(r, o, row))
            return JUMPED;
        if (o->function)
            status = o->special ? typed_exchange(r, o, row) : exchange(o, row + o->column);
        break;
    case KEEP: keep(r, o, row); break;
    case MOVE:
        if (o->special == ALTERED)
            move_specially(r, o, k, row);
        else if (o->special == SCATTERED)
            gather(r, o, k, row);
        else
            move(r, o, k, row);
        break;
    case STEP: status = step(r, o, k, following); break;
    case COMPLETE: status = outside(r, row, k); break;
    case GUESS: guess(r, o, k, row); break;
    case SETTLE:
        if (!unsettled(r, o, row))
            break;
        if (r->passes < o->limit)
            *at = table + o->back;
        else
            status = UNSETTLED;
    }
    return status;
}

/* Set inputs from the row that a route names. Two kinds: to ask each which one it is costs a
   fourteenth of a step of two small FMUs. */
static inline int64_t set_from(const Operation *o, double *values) {
    return ((Exchange2)o->function)(o->component, o->references, o->count, values);
}

/* Make a call of foreign code, as the word in progress says. */
#define CALL(STATUS)                                                                               \
    *word = place | o->number;                                                                     \
    status = STATUS;                                                                               \
    if (modes() != saved)                                                                          \
        restore(saved);                                                                            \
    if ((uint64_t)status > 1)                                                                      \
        return status;
/* Neighbours of one kind follow each other without a look at what they are. */
#define EACH_OF(KIND, STATUS)                                                                      \
    do {                                                                                           \
        CALL(STATUS)                                                                               \
    } while (++o < stop && o->usual == (KIND))

/* Carry out operations begin to end - 1 at a point; word has the number of the one in progress.
   Return the status of one that ends the run, else 0. The usual ones are written out here: doubles
   in FMI 2.0, at every point, from and into row k or the row that a route names. */
static int64_t carry_out(Run *r, const Operation *table, int64_t begin, int64_t end, int64_t k,
                         uint64_t saved, volatile int64_t *word) {
    const Operation *stop = table + end;
    double *rows = r->rows, *here = rows + r->width * k, now = r->seconds[k], size = r->sizes[k];
    int64_t width = r->width, usual = !*r->adjustments && !*r->copying, place = k << 20;
    int final = (int)r->no_way_back, last = k == r->final;
    for (int64_t j = 0; j < r->outputs && j < MOST_FETCHED; j += 8)
        __builtin_prefetch(here + AHEAD * width + j, 1);
    for (const Operation *o = table + begin; o < stop;) {
        int64_t status, kind = o->usual & -usual;
        switch (kind) {
        case USUAL_GET:
            EACH_OF(USUAL_GET, ((Exchange2)o->function)(o->component, o->references, o->count,
                                                        here + o->column));
            break;
        case USUAL_SET:
            EACH_OF(USUAL_SET, set_from(o, o->row[k] >= 0 ? rows + o->row[k] * width + o->source
                                                          : here + o->column));
            break;
        case USUAL_GATHER_AND_SET:
            EACH_OF(USUAL_GATHER_AND_SET, set_from(o, o->row[k] >= 0
                                                          ? taken(rows, o, o->row[k], width)
                                                          : here + o->column));
            break;
        case USUAL_STEP:
            if (last)
                *word = place | (o++)->number;
            else
                EACH_OF(USUAL_STEP, ((Step2)o->function)(o->component, now, size, final));
            break;
        case USUAL_GATHER: gather(r, o++, k, here); break; /* no foreign code runs */
        case USUAL_COMPLETE:
            *word = place | o->number;
            if ((status = outside(r, here, k)))
                return status;
            o++;
            break;
        default:
            CALL(carry_out_any(r, table, &o, k))
            o++;
        }
    }
    return 0;
}

/* Threads that carry out the steps of a point side by side, a group of operations each. */
#if defined(_WIN32)
typedef struct {
    const int64_t *groups;
} Team;
EXPORT Team *make_team(int64_t size, const int64_t *groups, int64_t count, int64_t *progress) {
    return (void)size, (void)groups, (void)count, (void)progress, NULL;
}
EXPORT void end_team(Team *t) { (void)t; }
static int64_t by_team(Team *t, Run *r, const Operation *table, int64_t k) {
    return (void)t, (void)r, (void)table, (void)k, 0;
}
#else
#include <pthread.h>
#include <signal.h>

typedef struct {
    pthread_mutex_t lock;
    pthread_cond_t go, done;
    pthread_t *threads;
    int64_t size, turn, closing;
    Run *run;
    const Operation *table;
    const int64_t *groups; /* begin and end of each */
    int64_t count, next, left, k;
    int64_t word; /* of the first operation of the table that ended the run */
    int64_t status;
    volatile int64_t *progress; /* the word of the thread that crashed; of each thread, or NONE */
    int64_t started;
} Team;

#define NONE INT64_C(-1)
static __thread volatile int64_t *mine, *crashed;

/* Note which word was in progress in the thread that crashes, and crash. */
static void note_crash(int number) {
    if (mine && *mine != NONE && *crashed == NONE)
        *crashed = *mine;
    signal(number, SIG_DFL);
    raise(number);
}

/* Replace this handler of deadly signals by that one, where nobody else has set his own. */
static void exchange_handlers(void (*from)(int), void (*to)(int)) {
    static const int deadly[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
    for (size_t i = 0; i < sizeof deadly / sizeof *deadly; i++) {
        void (*before)(int) = signal(deadly[i], to);
        if (before != from && before != SIG_ERR)
            signal(deadly[i], before);
    }
}

/* Take groups while there are any; the lock is held before and after. */
static void take_groups(Team *t, int64_t thread) {
    crashed = t->progress;
    mine = t->progress + 1 + thread;
    while (t->next < t->count) {
        const int64_t *group = t->groups + 2 * t->next++;
        pthread_mutex_unlock(&t->lock);
        int64_t status = carry_out(t->run, t->table, group[0], group[1], t->k, modes(), mine);
        int64_t word = *mine;
        *mine = NONE;
        pthread_mutex_lock(&t->lock);
        if (status && (!t->status || word < t->word)) {
            t->status = status;
            t->word = word;
        }
        if (--t->left == 0)
            pthread_cond_signal(&t->done);
    }
}

static void *member(void *given) {
    Team *t = given;
    int64_t seen = 0;
    pthread_mutex_lock(&t->lock);
    int64_t thread = ++t->started;
    while (!t->closing)
        if (t->turn == seen)
            pthread_cond_wait(&t->go, &t->lock);
        else {
            seen = t->turn;
            take_groups(t, thread);
        }
    pthread_mutex_unlock(&t->lock);
    return NULL;
}

EXPORT void end_team(Team *t) {
    pthread_mutex_lock(&t->lock);
    t->closing = 1;
    pthread_cond_broadcast(&t->go);
    pthread_mutex_unlock(&t->lock);
    for (int64_t i = 0; i < t->size; i++)
        pthread_join(t->threads[i], NULL);
    exchange_handlers(note_crash, SIG_DFL);
    free(t->threads);
    free(t);
}

/* A team of the caller and of more threads; NULL if there cannot be any. */
EXPORT Team *make_team(int64_t size, const int64_t *groups, int64_t count, int64_t *progress) {
    Team *t = calloc(1, sizeof(Team));
    if (!t || !(t->threads = calloc((size_t)size, sizeof(pthread_t))))
        return free(t), NULL;
    pthread_mutex_init(&t->lock, NULL);
    pthread_cond_init(&t->go, NULL);
    pthread_cond_init(&t->done, NULL);
    t->groups = groups;
    t->progress = progress;
    t->count = t->next = count;
    exchange_handlers(SIG_DFL, note_crash);
    for (; t->size < size - 1; t->size++)
        if (pthread_create(t->threads + t->size, NULL, member, t))
            return end_team(t), NULL;
    return t;
}

static int64_t by_team(Team *t, Run *r, const Operation *table, int64_t k) {
    pthread_mutex_lock(&t->lock);
    t->run = r, t->table = table, t->k = k;
    t->status = 0, t->next = 0, t->left = t->count;
    t->turn++;
    pthread_cond_broadcast(&t->go);
    take_groups(t, 0);
    while (t->left)
        pthread_cond_wait(&t->done, &t->lock);
    if (t->status)
        *r->word = t->word;
    pthread_mutex_unlock(&t->lock);
    return t->status;
}
#endif

/* Carry out operations begin to end - 1 at points first to last - 1; those from `side_by_side` on
   by the team, if there is one. At an early stop, return 1 with its status; r->word has the point
   and the number of the operation. */
EXPORT int run(Run *r, const Operation *table, int64_t begin, int64_t end, int64_t first,
               int64_t last, Team *team, int64_t side_by_side) {
    uint64_t saved = modes();
    int64_t until = team && side_by_side < end ? side_by_side : end;
    r->announced = 0;
    for (int64_t k = first; k < last; k++) {
        r->status = carry_out(r, table, begin, until, k, saved, r->word);
        if (!r->status && until < end && k != r->final) {
            *r->word = k << 20 | end;
            r->status = by_team(team, r, table, k);
        }
        if (!r->status && r->guards && !are_met(r->guards, k, first)) {
            r->column = k;
            r->status = GUARDED;
        }
        if (!r->status && r->announced) {
            r->column = k;
            r->status = ANNOUNCED;
        }
        if (r->status)
            return 1;
    }
    return 0;
}
