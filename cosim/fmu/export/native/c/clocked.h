/* What a component does with its Clocks in event mode (FMI 3.0). */

#ifndef CLOCKED_H
#define CLOCKED_H

#include "behaviour.h"
#include "model.h"

typedef struct {
    int used;       /* the importer uses event mode */
    int event_mode; /* it is in event mode */
    int ticking[MODEL_CLOCKS]; /* at this super-dense instant */
    int due;        /* the step to come has a sample to take */
} ClockState;

#define FLAGS (2 + MODEL_CLOCKS)

ClockState *behaviour_clock(Behaviour *b);

/* A Clock ticks: outputs that it clocks have their new values in `v`. */
void behaviour_tick(Behaviour *b, double *v, int clock);

/* The super-dense instant ends. */
int behaviour_update(Behaviour *b, double *v, Message *why);

/* The next interval of a Clock [s]; returns fmi3IntervalQualifier. */
int behaviour_interval(Behaviour *b, const double *v, int clock, int first, double *interval);
double behaviour_shift(const double *v, int clock);

static inline double *clock_save_flags(const ClockState *clock, double *to) {
    *to++ = clock->event_mode;
    for (int i = 0; i < MODEL_CLOCKS; i++) *to++ = clock->ticking[i];
    *to++ = clock->due;
    return to;
}

static inline void clock_restore_flags(ClockState *clock, const double *from) {
    clock->event_mode = *from++ != 0.0;
    for (int i = 0; i < MODEL_CLOCKS; i++) clock->ticking[i] = *from++ != 0.0;
    clock->due = *from != 0.0;
}

#endif
