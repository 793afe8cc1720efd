/* Time in whole nanoseconds from the start of the run, as the project's own master counts it. */

#ifndef CLOCK_H
#define CLOCK_H

#include <math.h>
#include <stdint.h>

typedef struct {
    double start, time; /* as the master says them [s] */
    int64_t now;        /* [ns] */
} Clock;

static inline int64_t nanoseconds(double seconds) { return (int64_t)rint(seconds * 1e9); }

static inline Clock clock_at(double start) {
    Clock clock = {start, start, 0};
    return clock;
}

/* The clock at `end`. A master that adds up its steps drifts by rounding: its steps are counted
   in whole nanoseconds as long as that stays near what it says. */
static inline Clock clock_moved(Clock clock, double end) {
    double near = 1e-9 * (fabs(end) > 1.0 ? fabs(end) : 1.0);
    int64_t counted = clock.now + nanoseconds(end - clock.time);
    int64_t said = nanoseconds(end - clock.start);
    clock.now = fabs((double)(counted - said)) <= 1e9 * near ? counted : said;
    clock.time = end;
    return clock;
}

#define CLOCK_NUMBERS 3

static inline void clock_save(const Clock *clock, double *to) {
    to[0] = clock->start;
    to[1] = clock->time;
    to[2] = (double)clock->now;
}

/* 0 if these numbers are no clock. */
static inline int clock_restore(Clock *clock, const double *from) {
    if (!isfinite(from[0]) || !isfinite(from[1]) || !(fabs(from[2]) < 1e18)) return 0;
    clock->start = from[0];
    clock->time = from[1];
    clock->now = (int64_t)from[2];
    return 1;
}

#endif
