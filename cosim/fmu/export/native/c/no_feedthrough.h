/* Of a behaviour in which no output depends on an input without delay: nothing is to be computed
   when inputs change, and no output changes with them. */

#ifndef NO_FEEDTHROUGH_H
#define NO_FEEDTHROUGH_H

#include "behaviour.h"

int behaviour_refresh(Behaviour *b, double *v, Message *why) {
    (void)b, (void)v, (void)why;
    return 1;
}

void behaviour_direction(const Behaviour *b, const double *v, const double *change, double *out) {
    (void)b, (void)v, (void)change, (void)out;
}

#endif
