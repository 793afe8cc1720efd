/* One instance of the component, apart from any FMI version: life cycle, variables, states.

   Nothing here is shared between instances. A call that must be refused is logged with its
   reason, changes no value, returns FAILURE and leaves the instance failed, as FMI has it: from
   there it can be read, reset, freed, or set to a saved state. A step that cannot be computed
   returns DISCARDED and leaves the instance as it was, ready for a shorter one. */

#ifndef INSTANCE_H
#define INSTANCE_H

#include <stddef.h>

#include "behaviour.h"
#include "model.h"
#include "variable.h"

/* A model that is compiled in is always there; see tape.h for one that is not. */
#ifndef MODEL_IS_READ
#define model_take(resources, why) ((void)(resources), (void)(why), 1)
#define model_leave() ((void)0)
#endif

/* In the order of fmi2Status and fmi3Status. */
typedef enum { FINE, UNUSUAL, DISCARDED, FAILURE, FATAL } Status;

typedef enum { INSTANTIATED, INITIALIZING, RUNNING, TERMINATED, FAILED } Phase;

/* Takes a message to the host; `owner` is the host's. */
typedef void Sink(void *owner, Status status, const char *category, const char *text);

typedef struct {
    double v[MOST_VARIABLES];
    Behaviour *behaviour;
    Phase phase;
    double time, stop; /* stop: infinite if none was set */
    int stale;         /* values were written since the outputs were computed */
    unsigned shown;    /* categories that are logged, a bit for each */
    Message failure;   /* why the instance failed */
    Sink *sink;
    void *owner;
} Instance;

/* A whole instance, to return to. */
typedef struct {
    unsigned mark; /* tells a state from any other memory */
    size_t count;
    double numbers[];
} Saved;

/* NULL without memory. */
Instance *instance_new(Sink *sink, void *owner, int logging);
void instance_free(Instance *it);

Status instance_show(Instance *it, int on, size_t count, const char *const categories[]);
void instance_log(Instance *it, Status status, const char *text);
/* Log, fail, and return FAILURE. */
Status instance_refuse(Instance *it, const char *format, ...);
/* Log and return `status`: the call has no effect. */
Status instance_decline(Instance *it, Status status, const char *format, ...);

/* `stop` is infinite without a stop time. */
Status instance_set_experiment(Instance *it, double start, double stop);
Status instance_enter_initialization(Instance *it);
Status instance_exit_initialization(Instance *it);
Status instance_terminate(Instance *it);
Status instance_reset(Instance *it);
Status instance_step(Instance *it, double from, double size);

Status instance_get_reals(Instance *it, const unsigned *vr, size_t count, double *values);
Status instance_get_integers(Instance *it, const unsigned *vr, size_t count, int *values);
Status instance_set_reals(Instance *it, const unsigned *vr, size_t count, const double *values);
Status instance_set_integers(Instance *it, const unsigned *vr, size_t count, const int *values);
/* Any call for variables of a type that no component has. */
Status instance_no_such_type(Instance *it, const unsigned *vr, size_t count, const char *type);

/* Change of outputs `unknown` for the change `seed` of inputs `known`. */
Status instance_direction(Instance *it, const unsigned *unknown, size_t unknowns,
                          const unsigned *known, size_t knowns, const double *seed,
                          double *change);

/* *saved is NULL or an earlier state, which is replaced. */
Status instance_save(Instance *it, Saved **saved);
Status instance_load(Instance *it, const Saved *saved);
void saved_free(Saved *saved);
Status instance_serialized_size(Instance *it, const Saved *saved, size_t *size);
Status instance_serialize(Instance *it, const Saved *saved, void *bytes, size_t size);
Status instance_deserialize(Instance *it, const void *bytes, size_t size, Saved **saved);

#endif
