/* Steps that are Python code of this process: they are called by address. As
   cosim/fmu/python_code.py, which makes `Code`. */

#include <stdlib.h>
#include <string.h>

#if defined(_WIN32) /* <windows.h> has names of its own for INPUT and others */
__declspec(dllimport) int __stdcall IsBadReadPtr(const void *from, size_t size);
#else
#include <unistd.h>
#endif

#include "arithmetic.h"
#include "behaviour.h"
#include "model.h"
#include "no_feedthrough.h"
#include "variable.h"

#define INPUTS ((size_t)MODEL_INPUTS)
#define OUTPUTS ((size_t)MODEL_OUTPUTS)
#define AT_LEAST_ONE(n) ((n) > 0 ? (n) : 1)

/* Calls return a number from 0 on, or -1 with the reason in `why`. */
typedef struct {
    double mark;
    int64_t (*start)(double t, const double *u, double *y, char *why);
    int64_t (*step)(int64_t number, double t, double size, char *why);
    int64_t (*size)(int64_t number, char *why); /* of what save fills */
    int64_t (*save)(int64_t number, double *to, char *why);
    int64_t (*restore)(int64_t number, const double *from, int64_t count, char *why);
    void (*end)(int64_t number);
} Code;

struct Behaviour {
    const Code *code;
    int64_t number; /* of the instance of the code; below 0: none */
    double time;
    double u[AT_LEAST_ONE(MOST_INPUTS)], y[AT_LEAST_ONE(MOST_OUTPUTS)];
};

Behaviour *behaviour_new(void) {
    Behaviour *b = calloc(1, sizeof *b);
    if (b) b->number = -1;
    return b;
}

static void end(Behaviour *b) {
    if (b->code && b->number >= 0) b->code->end(b->number);
    b->number = -1;
}

void behaviour_free(Behaviour *b) {
    if (b) end(b);
    free(b);
}

/* Whether there is memory at an address that came from another process, perhaps. */
static int is_memory(const void *from, size_t size) {
#if defined(_WIN32)
    return !IsBadReadPtr(from, size);
#else
    int ends[2];
    if (pipe(ends)) return 0;
    int there = write(ends[1], from, size) == (ssize_t)size;
    close(ends[0]);
    close(ends[1]);
    return there;
#endif
}

static int find(Behaviour *b, const double *v, Message *why) {
    const Code *code = (const Code *)(uintptr_t)v[V_code_address];
    if (v[V_code_address] == 0.0 || !is_memory(code, sizeof *code) ||
        code->mark != v[V_code_mark])
        return say(why, "the Python code of this component is not in this process: run its "
                        "scenario in Python, and components in a child process by fork alone");
    b->code = code;
    return 1;
}

static int publish(const Behaviour *b, double *v, Message *why) {
    for (size_t i = 0; i < OUTPUTS; i++)
        if (!isfinite(b->y[i]))
            return say(why, "%s is not finite", model_variables[model_outputs[i]].name);
    for (size_t i = 0; i < OUTPUTS; i++) v[model_outputs[i]] = b->y[i];
    return 1;
}

static void take_inputs(Behaviour *b, const double *v) {
    for (size_t i = 0; i < INPUTS; i++) b->u[i] = v[model_inputs[i]];
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    end(b);
    if (!find(b, v, why)) return 0;
    take_inputs(b, v);
    why->text[0] = 0;
    b->number = b->code->start(start, b->u, b->y, why->text);
    b->time = start;
    return b->number >= 0 && publish(b, v, why);
}

int behaviour_advance(Behaviour *b, double *v, double until, Message *why) {
    take_inputs(b, v);
    why->text[0] = 0;
    if (b->code->step(b->number, b->time, until - b->time, why->text) < 0) return 0;
    if (!publish(b, v, why)) return 0;
    b->time = until;
    return 1;
}

size_t behaviour_size(const Behaviour *b) {
    char why[sizeof(Message)] = "";
    int64_t size = b->code && b->number >= 0 ? b->code->size(b->number, why) : 0;
    return 1 + OUTPUTS + (size > 0 ? (size_t)size : 0);
}

void behaviour_save(const Behaviour *b, double *to) {
    char why[sizeof(Message)] = "";
    to[0] = b->time;
    memcpy(to + 1, b->y, OUTPUTS * sizeof(double));
    if (b->code && b->number >= 0) b->code->save(b->number, to + 1 + OUTPUTS, why);
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    if (count < 1 + OUTPUTS || !isfinite(from[0]))
        return say(why, "the saved state does not fit this component");
    if (!b->code && !find(b, v, why)) return 0;
    why->text[0] = 0;
    if (b->number < 0) {
        b->number = b->code->start(from[0], b->u, b->y, why->text);
        if (b->number < 0) return 0;
    }
    int64_t numbers = (int64_t)(count - 1 - OUTPUTS);
    if (b->code->restore(b->number, from + 1 + OUTPUTS, numbers, why->text) < 0) return 0;
    b->time = from[0];
    memcpy(b->y, from + 1, OUTPUTS * sizeof(double));
    return 1;
}
