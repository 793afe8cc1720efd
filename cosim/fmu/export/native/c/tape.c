#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32) /* <windows.h> has names of its own for INPUT and others */
__declspec(dllimport) int __stdcall MultiByteToWideChar(unsigned page, unsigned long flags,
                                                        const char *from, int count, wchar_t *to,
                                                        int room);
#define UTF_8 65001
#endif
#if defined(_MSC_VER)
#include <intrin.h>
#endif

#include "arithmetic.h"
#include "model.h"

Model model = {.guid = ""};

/* ---- equations */

enum { SLOTS, V, C, X, LATE, CHANGE, OTHER, POOL, ARRAYS };
enum { ADD, SUBTRACT, MULTIPLY, DIVIDE, NEGATE, POWER, LESSER, GREATER, SIN, COS, EXP, LOG, SQRT,
       ABSOLUTE, ARCSINE, ARCTANGENT, TAN, ARCCOSINE, ARCTAN, FLOOR, ROUND, HYPOTENUSE, LESS,
       LESS_EQUAL, EQUAL, OPERATIONS };

#define AT(operand) array[(uint64_t)(operand) >> 32][(uint32_t)(operand)]

/* Carry out a program; `array`: where its operands are, without slots and pool. */
static void perform(int number, const double *array[ARRAYS], double *out) {
    const Program *p = &model.program[number];
    double slot[MOST_SLOTS];
    array[SLOTS] = slot;
    array[POOL] = model.pool;
    for (size_t i = 0; i < p->operations; i++) {
        const Operation *o = &p->operation[i];
        double a = AT(o->a), b = AT(o->b), r;
        switch (o->operation) {
        case ADD: r = a + b; break;
        case SUBTRACT: r = a - b; break;
        case MULTIPLY: r = a * b; break;
        case DIVIDE: r = a / b; break;
        case NEGATE: r = -a; break;
        case POWER: r = power(a, b); break;
        case LESSER: r = lesser(a, b); break;
        case GREATER: r = greater(a, b); break;
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
        default: r = sqrt(a); break;
        }
        slot[o->to] = r;
    }
    for (size_t i = 0; i < p->results; i++) out[i] = AT(p->result[i]);
}

void model_constants(const double *v, double *c) {
    const double *array[ARRAYS] = {[V] = v};
    perform(CONSTANTS_OF_A_RUN, array, c);
}

const char *model_objection(const double *v) {
    const double *array[ARRAYS] = {[V] = v};
    double q[MOST_REFERENCES];
    perform(CONDITIONS, array, q);
    for (size_t i = 0; i < model.program[CONDITIONS].results; i++)
        if (!(q[i] > 0)) return model.objection[i];
    return NULL;
}

void model_rates(double t, const double *x, const double *late, const double *v, const double *c,
                 double *dx) {
    const double *array[ARRAYS] = {[V] = v, [C] = c, [X] = x, [LATE] = late, [OTHER] = &t};
    perform(RATES, array, dx);
}

void model_other_outputs(const double *x, const double *v, const double *c, double *out) {
    const double *array[ARRAYS] = {[V] = v, [C] = c, [X] = x};
    perform(OUTPUT_VALUES, array, out);
}

void model_outputs_change(const double *x, const double *v, const double *c,
                          const double *change, double *out) {
    const double *array[ARRAYS] = {[V] = v, [C] = c, [X] = x, [CHANGE] = change};
    perform(OUTPUT_CHANGES, array, out);
}

void model_law(double elapsed, const double *v, const double *c, double *out) {
    const double *array[ARRAYS] = {[V] = v, [C] = c, [OTHER] = &elapsed};
    perform(LAW, array, out);
}

void model_compared(const double *x, const double *v, const double *c, double *out) {
    const double *array[ARRAYS] = {[V] = v, [C] = c, [X] = x};
    perform(COMPARED, array, out);
}

void model_decided(const double *x, const double *v, const double *c, double *out) {
    const double *array[ARRAYS] = {[V] = v, [C] = c, [X] = x};
    perform(DECIDED, array, out);
}

/* ---- the file: words of 64 bits, little endian */

static int64_t *words;

/* What is left of the words while they are read. */
typedef struct {
    const int64_t *next, *end;
    int sound;
} Reader;

static const int64_t *take(Reader *r, int64_t count, int64_t most) {
    const int64_t *from = r->next;
    if (count < 0 || count > most || count > r->end - from) r->sound = 0;
    if (!r->sound) return NULL;
    r->next += count;
    return from;
}

static int64_t take_one(Reader *r, int64_t least, int64_t most) {
    const int64_t *found = take(r, 1, 1);
    if (!found || *found < least || *found > most) r->sound = 0;
    return r->sound ? *found : 0;
}

static double as_double(const int64_t *word) {
    double x;
    memcpy(&x, word, sizeof x);
    return x;
}

/* Length in words, then text padded with zeros, at least one. */
static const char *take_text(Reader *r) {
    int64_t count = take_one(r, 1, INT32_MAX);
    const char *text = (const char *)take(r, count, INT32_MAX);
    if (text && text[8 * count - 1] != 0) r->sound = 0;
    return r->sound ? text : "";
}

static int in_array(int64_t operand) {
    static const size_t sizes[ARRAYS] = {
        [SLOTS] = MOST_SLOTS,      [C] = MOST_CONSTANTS,   [X] = MOST_STATES,
        [LATE] = MOST_DELAYS * MOST_STATES, [CHANGE] = MOST_INPUTS, [OTHER] = 1};
    uint64_t array = (uint64_t)operand >> 32, index = (uint32_t)operand;
    if (array >= ARRAYS) return 0;
    return index < (array == V ? model.variables : array == POOL ? model.pooled : sizes[array]);
}

static void read_program(Reader *r, Program *p, int64_t most) {
    p->operations = (size_t)take_one(r, 0, INT32_MAX);
    p->operation = (const Operation *)take(r, 4 * (int64_t)p->operations, INT64_MAX);
    p->results = (size_t)take_one(r, 0, most);
    p->result = take(r, (int64_t)p->results, most);
    for (size_t i = 0; r->sound && i < p->operations; i++) {
        const Operation *o = &p->operation[i];
        r->sound = o->operation >= 0 && o->operation < OPERATIONS && in_array(o->a) &&
                   in_array(o->b) && o->to >= 0 && o->to < MOST_SLOTS;
    }
    for (size_t i = 0; r->sound && i < p->results; i++) r->sound = in_array(p->result[i]);
}

static int read_model(Reader *r) {
    static const int64_t most[TABLES] = {MOST_INPUTS,     MOST_OUTPUTS, MOST_STATES, MOST_REFERENCES,
                                         MOST_DELAYS, MOST_OTHERS,  MOST_REFERENCES,
                                         MOST_MEASURED,  MOST_REFERENCES, MOST_REFERENCES,
                                         MOST_REFERENCES};
    static const int64_t results[PROGRAMS] = {MOST_CONSTANTS, MOST_STATES, MOST_OTHERS,
                                              MOST_OTHERS, MOST_REFERENCES, MOST_OUTPUTS,
                                              MOST_INPUTS, MOST_DECIDED};
    take_one(r, INT64_C(0x4c45444f4d565541), INT64_C(0x4c45444f4d565541)); /* AUVMODEL */
    take_one(r, 2, 2); /* its version */
    model.guid = take_text(r);
    model.text = take_text(r);
    model.variables = (size_t)take_one(r, 1, MOST_VARIABLES);
    model.variable = calloc(model.variables ? model.variables : 1, sizeof *model.variable);
    if (!model.variable) return 0;
    for (size_t i = 0; r->sound && i < model.variables; i++) {
        Variable *one = &model.variable[i];
        one->name = take_text(r);
        one->causality = (Causality)take_one(r, INPUT, PARAMETER);
        one->kind = (Kind)take_one(r, REAL, INTEGER);
        const int64_t *numbers = take(r, 3, 3);
        if (!numbers) break;
        one->start = as_double(numbers);
        one->minimum = as_double(numbers + 1);
        one->maximum = as_double(numbers + 2);
    }
    for (int i = 0; i < NUMBERS; i++) model.number[i] = take_one(r, 0, INT32_MAX);
    for (int i = 0; i < TABLES; i++) {
        model.count[i] = (size_t)take_one(r, 0, most[i]);
        for (size_t k = 0; k < model.count[i]; k++)
            model.reference[i][k] = (unsigned)take_one(r, 0, (int64_t)model.variables - 1);
    }
    model.pooled = (size_t)take_one(r, 0, INT32_MAX);
    model.pool = (const double *)take(r, (int64_t)model.pooled, INT32_MAX);
    for (int i = 0; i < PROGRAMS; i++) read_program(r, &model.program[i], results[i]);
    size_t conditions = model.program[CONDITIONS].results;
    model.objection = calloc(conditions + 1, sizeof *model.objection);
    if (!model.objection) return 0;
    for (size_t i = 0; i < conditions; i++) model.objection[i] = take_text(r);
    int64_t rows = model.number[ROWS_OF_TABLE], width = (int64_t)model.count[TO_OUTPUTS];
    model.instant = take(r, rows, INT32_MAX);
    model.table = (const double *)take(r, rows * width, INT64_MAX);
    const int64_t *n = model.number;
    return r->sound && r->next == r->end && n[RUN_CONSTANTS] <= MOST_CONSTANTS &&
           n[LATE_TO] <= (int64_t)model.count[TO_STATES];
}

static void forget(void) {
    static const Model nothing = {.guid = ""};
    free(model.variable);
    free((void *)model.objection);
    free(words);
    words = NULL;
    model = nothing;
}

/* ---- where it lies */

static int digit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    c = (char)(c | 32);
    return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

/* A path of a file URI, file:///a%20b or file:/a or file://host/a, or of a path. */
static int path_of(const char *resources, char *path, size_t size) {
    const char *from = resources;
    int uri = strncmp(from, "file:", 5) == 0;
    if (uri) {
        from += 5;
        if (from[0] == '/' && from[1] == '/') {
            from = strchr(from + 2, '/');
            if (!from) return 0;
        }
#if defined(_WIN32)
        if (from[0] == '/' && from[1] && from[2] == ':') from++;
#endif
    }
    size_t length = 0;
    for (; *from && length + 16 < size; from++) {
        int high = uri && *from == '%' ? digit(from[1]) : -1;
        int low = high >= 0 ? digit(from[2]) : -1;
        path[length++] = low >= 0 ? (char)(16 * high + low) : *from;
        if (low >= 0) from += 2;
    }
    if (*from || length == 0) return 0;
    strcpy(path + length, "/model.bin");
    return 1;
}

static FILE *opened(const char *path) {
#if defined(_WIN32)
    wchar_t wide[4096];
    if (!MultiByteToWideChar(UTF_8, 0, path, -1, wide, 4096)) return NULL;
    return _wfopen(wide, L"rb");
#else
    return fopen(path, "rb");
#endif
}

static int load(const char *resources, Message *why) {
    char path[4096];
    long size = -1;
    if (!resources || !path_of(resources, path, sizeof path))
        return say(why, "this FMU needs the location of its resources, a path or a file URI");
    FILE *file = opened(path);
    if (file && fseek(file, 0, SEEK_END) == 0) size = ftell(file);
    if (file) rewind(file);
    words = size > 0 ? malloc((size_t)size) : NULL;
    int whole = words && fread(words, 1, (size_t)size, file) == (size_t)size;
    if (file) fclose(file);
    Reader reader = {words, words ? words + size / 8 : NULL, whole && size % 8 == 0};
    if (reader.sound && read_model(&reader)) return 1;
    forget();
    return say(why, "the file with the model of this FMU is %s: %.400s",
               whole ? "none of this binary's" : "missing or cannot be read", path);
}

/* ---- shared by the instances of this process */

static size_t taken;
static volatile long held;

static void hold(void) {
#if defined(_MSC_VER)
    while (_InterlockedExchange(&held, 1)) {}
#else
    while (__atomic_exchange_n(&held, 1, __ATOMIC_ACQUIRE)) {}
#endif
}

static void release(void) {
#if defined(_MSC_VER)
    _InterlockedExchange(&held, 0);
#else
    __atomic_store_n(&held, 0, __ATOMIC_RELEASE);
#endif
}

int model_take(const char *resources, Message *why) {
    hold();
    int there = taken > 0 || load(resources, why);
    taken += there != 0;
    release();
    return there;
}

void model_leave(void) {
    hold();
    if (taken > 0 && --taken == 0) forget();
    release();
}
