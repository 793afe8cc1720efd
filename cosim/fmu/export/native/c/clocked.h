/* What a component keeps of its Clock in event mode (FMI 3.0). */

#ifndef CLOCKED_H
#define CLOCKED_H

#include "behaviour.h"

typedef struct {
    int used;       /* the importer uses event mode: samples are taken when the Clock ticks */
    int event_mode; /* it is in event mode */
    int ticking;    /* the Clock ticks at this super-dense instant */
    int due;        /* it has ticked since the last step */
} ClockState;

ClockState *behaviour_clock(Behaviour *b);

#endif
