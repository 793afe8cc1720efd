/* A slave that counts its steps, and speaks all the time: from `count` threads of its own, which
   log as fast as they can from the end of the initialisation, which waits for the first line of
   each, until it is freed, and in each step
   `lines` lines to stderr and to stdout. In step `last` it aborts.

   integers: 0 steps, 1 count, 2 lines, 3 last, 4 heard, an input. */

#include <pthread.h>
#include <unistd.h>

#include "slave.h"

enum { STEPS, COUNT, LINES, LAST, HEARD, VARIABLES };
enum { MOST = 8 };
struct Model {
    Log log;
    int v[VARIABLES], started;
    volatile int over, spoken;
    pthread_t threads[MOST];
};

static void *speak(void *memory) {
    Model *m = memory;
    for (int first = 1; !m->over; usleep(50), first = 0) {
        say(&m->log, fmi2Warning, "from a thread");
        if (first)
            __sync_fetch_and_add(&m->spoken, 1);
    }
    return NULL;
}

static int begin(Model *m, const Log *log) {
    m->log = *log;
    return 1;
}
static int leave(Model *m) {
    while (m->started < m->v[COUNT] && m->started < MOST)
        pthread_create(&m->threads[m->started++], NULL, speak, m);
    while (m->spoken < m->started) /* a short run may be over before a thread begins */
        usleep(50);
    return fmi2OK;
}
static int step(Model *m, double t, double h) {
    for (int i = 0; i < m->v[LINES]; i++) {
        dprintf(STDERR_FILENO, "line %d of step %d\n", i, m->v[STEPS]);
        dprintf(STDOUT_FILENO, "line %d of step %d\n", i, m->v[STEPS]);
    }
    say(&m->log, fmi2OK, "a step");
    if (++m->v[STEPS] == m->v[LAST])
        abort();
    return fmi2OK;
}
static void end(Model *m) {
    m->over = 1;
    while (m->started)
        pthread_join(m->threads[--m->started], NULL);
}
static const Behaviour behaviour = {
    sizeof(Model), .begin = begin, .leave = leave, .step = step, .reset = refuse, .end = end};

GETTER(fmi2, Integer, fmi2OK, m->v[reference])
SETTER(fmi2, Integer, fmi2OK, m->v[reference])
REFUSED(fmi2GetReal)
REFUSED(fmi2SetReal)
