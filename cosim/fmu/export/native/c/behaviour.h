/* What a component does between its variables: one of plant.c, sampled.c, waves.c,
   packet_link.c, transport_link.c, table.c.

   `v` are the values of all variables by their row in the table. Functions that return int give 1,
   or 0 with the reason in `why`; then neither `v` nor the behaviour has changed. */

#ifndef BEHAVIOUR_H
#define BEHAVIOUR_H

#include <stddef.h>

#include "message.h"

typedef struct Behaviour Behaviour;

/* NULL without memory. */
Behaviour *behaviour_new(void);
void behaviour_free(Behaviour *b);

/* Take parameters and initial state from `v` at time `start`; fills the outputs. */
int behaviour_initialise(Behaviour *b, double *v, double start, Message *why);

/* Go on to `end` with the inputs in `v` held; fills the outputs. */
int behaviour_advance(Behaviour *b, double *v, double end, Message *why);

/* Outputs that depend on inputs without delay, from the inputs as they are now. */
int behaviour_refresh(Behaviour *b, double *v, Message *why);

/* Change of every output, by its row, for a change of the inputs. */
void behaviour_direction(const Behaviour *b, const double *v, const double *change, double *out);

/* Everything that determines the future beside `v`, as doubles. */
size_t behaviour_size(const Behaviour *b);
void behaviour_save(const Behaviour *b, double *to);

/* Return to what was saved by an instance with the same parameters `v`. */
int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why);

#endif
