/* A channel between the process of the master and that of an isolated slave, both sides of it.

   The master calls proxies: functions like fmi2GetReal ... fmi3DoStep, with the same arguments,
   whose component is the address of a `Channel`. A proxy writes its arguments into memory that both
   processes map, wakes the other process, and sleeps until the answer is there. Nobody spins:
   Linux has the futex for this; elsewhere each process sleeps on a pipe of its own. The process of
   the slave is in `serve`, which makes the calls. What is no call of the loop goes over a pipe of
   messages (`proxy.py`), announced here as a MESSAGE. */

#define _GNU_SOURCE
#include <fenv.h>
#include <errno.h>
#include <poll.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#if defined(__linux__)
#include <sys/syscall.h>
#endif
#if defined(__linux__) && !defined(WITHOUT_FUTEX)
#define FUTEX
enum { FUTEX_WAIT_ = 0, FUTEX_WAKE_ = 1 };
#endif

#define EXPORT __attribute__((visibility("default")))
#define GONE INT32_C(-2147483647) /* no status of FMI: the slave cannot answer, see proxy.py */
#define ERROR 3                   /* fmi2Error, fmi3Error */
#define TICK_NS INT64_C(20000000) /* between two looks at whether the other process lives */
#define DATA 256                  /* where references and values begin in the shared memory */

#define TYPES_1(X) X(Real, double) X(Integer, int32_t) X(Boolean, uint8_t)
#define TYPES_2(X) X(Real, double) X(Integer, int32_t) X(Boolean, int32_t)
#define TYPES_3(X)                                                                                 \
    X(Float64, double) X(Float32, float) X(Int8, int8_t) X(UInt8, uint8_t) X(Int16, int16_t)       \
    X(UInt16, uint16_t) X(Int32, int32_t) X(UInt32, uint32_t) X(Int64, int64_t)                    \
    X(UInt64, uint64_t) X(Boolean, uint8_t)
#define TWO_OF_1(NAME, T) GET_1_##NAME, SET_1_##NAME,
#define TWO_OF_2(NAME, T) GET_2_##NAME, SET_2_##NAME,
#define TWO_OF_3(NAME, T) GET_3_##NAME, SET_3_##NAME,
enum {
    MESSAGE, STEP_1, STEP_2, STEP_3,
    TYPES_1(TWO_OF_1) TYPES_2(TWO_OF_2) LAST_OF_2, /* of the form of FMI 2 */
    TYPES_3(TWO_OF_3) FUNCTIONS
};

/* What both processes map. `request` counts what the master asks for, `done` follows it; `answer`
   changes with everything that the master should look at, such as `lines`, the number of log lines
   in the pipe. The two that a process sleeps on are apart, each in a cache line of its own. */
typedef struct {
    uint32_t request, apart1[31];
    uint32_t answer, done, lines, apart2[13];
    int32_t function, status;
    uint64_t count, values;
    double time, size;
    int32_t final;
    uint8_t flags[4];
    double last;
} Shared;

/* `own`, `other` : pipes on which this process sleeps, and the other one; -1 with a futex. */
typedef struct {
    Shared *shared;
    uint64_t room; /* bytes from DATA on */
    int32_t own, other;
    int (*look)(int64_t waited_ns); /* takes log lines; whether the slave is given up */
    int32_t function, given_up;
    uint32_t lines;
} Channel;

static int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

static void wake(uint32_t *word, int other) {
#ifdef FUTEX
    (void)other;
    syscall(SYS_futex, word, FUTEX_WAKE_, 1, NULL, NULL, 0);
#else
    (void)word;
    while (write(other, "", 1) < 0 && errno == EINTR) {
    }
#endif
}

/* Sleep while the word is `seen`, at most so long (0: for ever). It may end early. */
static void sleep_on(uint32_t *word, uint32_t seen, int64_t most_ns, int own) {
#ifdef FUTEX
    struct timespec most = {most_ns / 1000000000, most_ns % 1000000000};
    (void)own;
    syscall(SYS_futex, word, FUTEX_WAIT_, seen, most_ns ? &most : NULL, NULL, 0);
#else
    struct pollfd one = {own, POLLIN, 0};
    char taken[64];
    if (__atomic_load_n(word, __ATOMIC_SEQ_CST) == seen)
        poll(&one, 1, most_ns ? (int)(most_ns / 1000000) : -1);
    while (read(own, taken, sizeof taken) == sizeof taken) {
    }
#endif
}

static void announce(Channel *c, int32_t function) {
    c->shared->function = c->function = function;
    __atomic_add_fetch(&c->shared->request, 1, __ATOMIC_SEQ_CST);
    wake(&c->shared->request, c->other);
}

/* The log lines that came with an answer are taken before the call returns. */
static void take_lines(Channel *c) {
    uint32_t lines = __atomic_load_n(&c->shared->lines, __ATOMIC_SEQ_CST);
    if (lines != c->lines) {
        c->lines = lines;
        c->given_up |= c->look(0);
    }
}

/* Have a function called in the other process, and return its status. */
static int called(Channel *c, int32_t function) {
    Shared *s = c->shared;
    int64_t begun = 0;
    if (c->given_up)
        return GONE;
    announce(c, function);
    for (;;) {
        uint32_t seen = __atomic_load_n(&s->answer, __ATOMIC_SEQ_CST);
        int is_done = __atomic_load_n(&s->done, __ATOMIC_SEQ_CST) == s->request;
        take_lines(c);
        if (is_done)
            return c->given_up ? GONE : s->status;
        if (!begun)
            begun = now_ns();
        sleep_on(&s->answer, seen, TICK_NS, c->own);
        int64_t waited = now_ns() - begun;
        if (waited >= TICK_NS && (c->given_up |= c->look(waited)))
            return GONE;
    }
}

/* What a get leaves of its values is what they were before, as where it is called directly. */
static int exchanged(Channel *c, int32_t function, const uint32_t *references, uint64_t count,
                     void *values, uint64_t n, uint64_t bytes) {
    uint8_t *data = (uint8_t *)c->shared + DATA;
    uint64_t begin = (4 * count + 7) & ~UINT64_C(7);
    if (begin + n * bytes > c->room)
        return ERROR;
    memcpy(data, references, 4 * count);
    memcpy(data + begin, values, n * bytes);
    c->shared->count = count;
    c->shared->values = n;
    int status = called(c, function);
    if (status != GONE)
        memcpy(values, data + begin, n * bytes);
    return status;
}

#define PROXIES_OF(M, NAME, T)                                                                     \
    static int get_##M##_##NAME(Channel *c, const uint32_t *r, size_t n, T *v) {                   \
        return exchanged(c, GET_##M##_##NAME, r, n, v, n, sizeof(T));                              \
    }                                                                                              \
    static int set_##M##_##NAME(Channel *c, const uint32_t *r, size_t n, T *v) {                   \
        return exchanged(c, SET_##M##_##NAME, r, n, v, n, sizeof(T));                              \
    }
#define PROXIES_1(NAME, T) PROXIES_OF(1, NAME, T)
#define PROXIES_2(NAME, T) PROXIES_OF(2, NAME, T)
#define PROXIES_3(NAME, T)                                                                         \
    static int get_3_##NAME(Channel *c, const uint32_t *r, size_t n, T *v, size_t m) {             \
        return exchanged(c, GET_3_##NAME, r, n, v, m, sizeof(T));                                  \
    }                                                                                              \
    static int set_3_##NAME(Channel *c, const uint32_t *r, size_t n, T *v, size_t m) {             \
        return exchanged(c, SET_3_##NAME, r, n, v, m, sizeof(T));                                  \
    }
TYPES_1(PROXIES_1)
TYPES_2(PROXIES_2)
TYPES_3(PROXIES_3)

static int step_1(Channel *c, double time, double size, uint8_t new_step) {
    c->shared->time = time, c->shared->size = size, c->shared->final = new_step;
    return called(c, STEP_1);
}

static int step_2(Channel *c, double time, double size, int final) {
    c->shared->time = time, c->shared->size = size, c->shared->final = final;
    return called(c, STEP_2);
}

static int step_3(Channel *c, double time, double size, uint8_t final, uint8_t *event,
                  uint8_t *terminate, uint8_t *early, double *last) {
    Shared *s = c->shared;
    s->time = time, s->size = size, s->final = final;
    s->flags[0] = *event, s->flags[1] = *terminate, s->flags[2] = *early, s->last = *last;
    int status = called(c, STEP_3);
    if (status != GONE)
        *event = s->flags[0], *terminate = s->flags[1], *early = s->flags[2], *last = s->last;
    return status;
}

#define NAMED(M, NAME, T)                                                                          \
    [GET_##M##_##NAME] = {"fmi" #M "Get" #NAME, (void *)get_##M##_##NAME, sizeof(T)},              \
    [SET_##M##_##NAME] = {"fmi" #M "Set" #NAME, (void *)set_##M##_##NAME, sizeof(T)},
#define NAMED_1(NAME, T) NAMED(1, NAME, T)
#define NAMED_2(NAME, T) NAMED(2, NAME, T)
#define NAMED_3(NAME, T) NAMED(3, NAME, T)
static const struct {
    const char *name;
    void *proxy;
    uint64_t bytes;
} named[FUNCTIONS] = {[MESSAGE] = {"", NULL, 0},
                      [STEP_1] = {"fmi1DoStep", (void *)step_1, 0},
                      [STEP_2] = {"fmi2DoStep", (void *)step_2, 0},
                      [STEP_3] = {"fmi3DoStep", (void *)step_3, 0},
                      TYPES_1(NAMED_1) TYPES_2(NAMED_2)[LAST_OF_2] = {"", NULL, 0},
                      TYPES_3(NAMED_3)};

/* The number of a function, by which it is called here; 0: there is none of this name. */
EXPORT int32_t function_number(const char *name) {
    for (int32_t i = 1; i < FUNCTIONS; i++)
        if (!strcmp(named[i].name, name))
            return i;
    return 0;
}

EXPORT void *proxy_of(int32_t function) { return named[function].proxy; }
EXPORT const char *function_name(int32_t function) { return named[function].name; }

/* Tell the process of the slave that a message is in the pipe. */
EXPORT void announce_message(Channel *c) { announce(c, MESSAGE); }

/* --- the process of the slave */

typedef struct {
    Shared *shared;
    void *component;
    void *functions[64];
    uint32_t taken; /* the last request */
    int32_t own, other;
} Server;

typedef int (*Exchange2)(void *, const uint32_t *, size_t, void *);
typedef int (*Exchange3)(void *, const uint32_t *, size_t, void *, size_t);
typedef int (*Step1)(void *, double, double, uint8_t);
typedef int (*Step2)(void *, double, double, int);
typedef int (*Step3)(void *, double, double, uint8_t, uint8_t *, uint8_t *, uint8_t *, double *);

static int status_of(Server *v, int32_t function) {
    Shared *s = v->shared;
    uint8_t *data = (uint8_t *)s + DATA;
    uint32_t *references = (uint32_t *)data;
    void *f = v->functions[function], *values = data + ((4 * s->count + 7) & ~UINT64_C(7));
    if (function == STEP_1)
        return ((Step1)f)(v->component, s->time, s->size, (uint8_t)s->final);
    if (function == STEP_2)
        return ((Step2)f)(v->component, s->time, s->size, s->final);
    if (function == STEP_3)
        return ((Step3)f)(v->component, s->time, s->size, (uint8_t)s->final, s->flags,
                          s->flags + 1, s->flags + 2, &s->last);
    if (function < LAST_OF_2)
        return ((Exchange2)f)(v->component, references, s->count, values);
    return ((Exchange3)f)(v->component, references, s->count, values, s->values);
}

static void answer(Server *v) {
    __atomic_add_fetch(&v->shared->answer, 1, __ATOMIC_SEQ_CST);
    wake(&v->shared->answer, v->other);
}

/* Make the calls that are asked for, until a message is in the pipe. Rounding and what becomes of
   tiny numbers are before each call what they were before the first one. */
EXPORT void serve(Server *v) {
    Shared *s = v->shared;
    fenv_t saved;
    fegetenv(&saved);
    for (;;) {
        while (__atomic_load_n(&s->request, __ATOMIC_SEQ_CST) == v->taken)
            sleep_on(&s->request, v->taken, 0, v->own);
        v->taken++;
        if (s->function == MESSAGE)
            return;
        s->status = status_of(v, s->function);
        fesetenv(&saved);
        __atomic_store_n(&s->done, v->taken, __ATOMIC_SEQ_CST);
        answer(v);
    }
}

/* Tell the master that a log line is in the pipe. */
EXPORT void announce_line(Server *v) {
    __atomic_add_fetch(&v->shared->lines, 1, __ATOMIC_SEQ_CST);
    answer(v);
}
