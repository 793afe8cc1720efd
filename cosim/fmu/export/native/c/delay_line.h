/* Method of steps for x'(t) = f(t, x(t), x(t-d_1), ..., x(t-d_m)) with held inputs.

   The same operations in the same order as cosim/models/delay_line.py, whose text says what
   is done and why: Runge-Kutta of order four, one cubic interpolant with its own one-sided
   slopes per step, steps that end on every jump of the inputs and on its images through one
   and two delays. Beyond it, a step that fails leaves everything as it was. */

#ifndef DELAY_LINE_H
#define DELAY_LINE_H

#include <stddef.h>

#include "message.h"
#include "model.h"
#include "variable.h"

#define MOST_IMAGES (MOST_DELAYS * (MOST_DELAYS + 3) / 2)
#define AT_LEAST_ONE(n) ((n) > 0 ? (n) : 1)

/* One step: its ends, x and x' there. */
typedef struct {
    double t0, t1;
    double x0[MOST_STATES], x1[MOST_STATES], m0[MOST_STATES], m1[MOST_STATES];
} Piece;

typedef struct {
    double time, start, step, shortest, longest;
    double delay[AT_LEAST_ONE(MOST_DELAYS)];
    double image[AT_LEAST_ONE(MOST_IMAGES)]; /* sums of one and two delays, ascending */
    size_t images;
    double x[MOST_STATES], before[MOST_STATES];
    int settled; /* the slope that the last step ended with is what the history by now gives */

    Piece *ring; /* pieces first to end - 1, at their number modulo the capacity */
    size_t capacity, first, end;
    size_t cursor[AT_LEAST_ONE(MOST_DELAYS)]; /* piece that the last look-up found */

    double *jump; /* times when inputs jumped and whose images lie ahead */
    size_t jump_capacity, jumps;
    size_t head[AT_LEAST_ONE(MOST_IMAGES)]; /* first jump whose image is still ahead */

    double *point; /* ends of the segments of the present communication step */
    size_t point_capacity, points;
} DelayLine;

/* What `f` needs beside its arguments. */
typedef struct {
    const double *v, *c;
} Held;

/* Set up for the constant history `initial`; memory that the line holds is kept. */
int delay_line_start(DelayLine *line, const double *initial, const double *delay, double step,
                     double start, Message *why);
void delay_line_free(DelayLine *line);

/* The line before an advance, which may fail half-way. */
typedef struct {
    double time;
    size_t end, jumps, head[AT_LEAST_ONE(MOST_IMAGES)];
    int settled;
} Mark;

Mark delay_line_mark(const DelayLine *line);

/* Integrate to `end`. `jump`: the inputs changed at the present time. `same`: not a bit of
   them did, so that the slope there may be known. */
int delay_line_advance(DelayLine *line, double end, const Held *held, int jump, int same,
                       Message *why);

/* Go back to a mark, if nothing was forgotten since. */
void delay_line_return(DelayLine *line, const Mark *mark);

/* Cut what no delay reaches any more. */
void delay_line_forget(DelayLine *line);

/* The whole line as doubles; restored into one that was started with the same parameters. */
size_t delay_line_size(const DelayLine *line);
void delay_line_save(const DelayLine *line, double *to);
int delay_line_restore(DelayLine *line, const double *from, size_t count, Message *why);

#endif
