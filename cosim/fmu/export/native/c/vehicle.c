/* A vehicle with Euler angles: a delay equation whose pitch must stay away from +-90 degrees,
   where they have no rates. As fmu_src/vehicle_plant/behaviour.py, at the end of every step. */

#include <math.h>

#include "delay_line.h"

#define PITCH 4 /* x, y, z, phi, theta, psi, ... */
#define LEAST_COSINE 0.05

static int sound_pitch(double theta, double t, Message *why) {
    if (cos(theta) > LEAST_COSINE) return 1;
    return say(why,
               "the pitch angle eta.theta is %s rad at t = %s s: near +-90 degrees Euler angles "
               "have no rates; set attitude = \"quaternion\" in the vehicle file",
               shortest(theta).text, shortest(t).text);
}

static int start_with_pitch(DelayLine *line, const double *initial, const double *delay,
                            double step, double start, Message *why) {
    return sound_pitch(initial[PITCH], start, why) &&
           delay_line_start(line, initial, delay, step, start, why);
}

static int advance_with_pitch(DelayLine *line, double end, const Held *held, int jump, int same,
                              Message *why) {
    size_t next = line->end;
    if (!delay_line_advance(line, end, held, jump, same, why)) return 0;
    for (; next < line->end; next++) {
        const Piece *piece = &line->ring[next & (line->capacity - 1)];
        if (!sound_pitch(piece->x1[PITCH], piece->t1, why)) return 0;
    }
    return 1;
}

#define delay_line_start start_with_pitch
#define delay_line_advance advance_with_pitch
#include "plant.c"
