/* Assumptions that are watched as the FMU runs, and what a step has to report beside its status. */

#ifndef WATCH_H
#define WATCH_H

#include "arithmetic.h"
#include "behaviour.h"
#include "model.h"
#include "variable.h"

/* What the last step has to report, once; NULL: nothing. */
const char *behaviour_notice(Behaviour *b);

/* Share of the greatest age that an age is; 1 where rounding alone puts it beyond. `late`: it is
   beyond. `end`: the time, which may drift by rounding. */
static inline double share_of_age(double age, double most, double end, int *late) {
    double share = age / most;
    *late = age > most + 1e-9 * greater(1.0, fabs(end));
    return *late ? share : lesser(share, 1.0);
}

/* model_watched: the present uses, their greatest so far, and whether all of these are met. */
static inline void watch(double *v) {
    int uses = ((int)MODEL_WATCHED - 1) / 2, met = 1;
    for (int i = 0; i < uses; i++) {
        double *greatest = &v[model_watched[uses + i]];
        *greatest = greater(*greatest, v[model_watched[i]]);
        met &= *greatest <= 1.0;
    }
    v[model_watched[2 * uses]] = met;
}

static inline void watch_start(double *v) {
    for (int i = 0; i < (int)MODEL_WATCHED; i++) v[model_watched[i]] = 0.0;
    watch(v);
}

#endif
