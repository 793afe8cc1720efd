/* The random numbers of cosim/network/draws.py and single_draws.py, bit for bit: a stream for each
   seed, name, purpose and round, value k of it for message or sample k. */

#ifndef DRAWS_H
#define DRAWS_H

#include <stdint.h>

/* Which link draws: seed of the run and name of the link. */
typedef struct {
    uint64_t seed;
    const char *name;
} Source;

/* Extra delay of a message; times in ns, as in cosim/network/impairment.py. */
typedef struct {
    enum { NO_JITTER, UNIFORM_JITTER, EXPONENTIAL_JITTER, NORMAL_JITTER } kind;
    double width, mean, sigma, max; /* max: HUGE_VAL for no bound */
} Jitter;

/* Value `index` of a stream: a multiple of 2^-53 in [0, 1). */
double draw_uniform(const Source *source, const char *purpose, unsigned turn, uint64_t index);

/* Number `index` of a stream of standard normal numbers; infinite if none was accepted in a great
   many rounds. */
double draw_normal(const Source *source, const char *purpose, uint64_t index);

/* Extra delay of message `index` [ns]; -1 if none was accepted in a great many rounds. */
int64_t draw_jitter(const Source *source, const char *purpose, const Jitter *jitter,
                    uint64_t index);

#endif
