/* FMI 3.0 as fmi3.c, with event mode and input Clocks; see clocked.h. */

#include "fmi3Functions.h"

#include "clocked.h"

#undef fmi3InstantiateCoSimulation
#undef fmi3ExitInitializationMode
#undef fmi3Reset
#undef fmi3EnterEventMode
#undef fmi3EnterStepMode
#undef fmi3UpdateDiscreteStates
#undef fmi3DoStep
#undef fmi3GetClock
#undef fmi3SetClock
#undef fmi3GetIntervalDecimal
#undef fmi3GetShiftDecimal
#define fmi3InstantiateCoSimulation plain_instantiate
#define fmi3ExitInitializationMode plain_exit_initialization
#define fmi3Reset plain_reset
#define fmi3EnterEventMode plain_enter_event_mode
#define fmi3EnterStepMode plain_enter_step_mode
#define fmi3UpdateDiscreteStates plain_update
#define fmi3DoStep plain_step
#define fmi3GetClock plain_get_clock
#define fmi3SetClock plain_set_clock
#define fmi3GetIntervalDecimal plain_interval
#define fmi3GetShiftDecimal plain_shift
#include "fmi3.c"
#undef fmi3InstantiateCoSimulation
#undef fmi3ExitInitializationMode
#undef fmi3Reset
#undef fmi3EnterEventMode
#undef fmi3EnterStepMode
#undef fmi3UpdateDiscreteStates
#undef fmi3DoStep
#undef fmi3GetClock
#undef fmi3SetClock
#undef fmi3GetIntervalDecimal
#undef fmi3GetShiftDecimal

/* The value reference of the first Clock, after that of the independent variable. */
#define CLOCK (TIME + 1)
#define CLOCK_OF(c) (behaviour_clock(((Slave *)(c))->it->behaviour))

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t intermediates,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update) {
    fmi3Instance c = plain_instantiate(name, token, resources, visible, logging, fmi3False,
                                       early_return, intermediate, intermediates, environment,
                                       log, update);
    if (c) CLOCK_OF(c)->used = event_mode;
    return c;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    INSTANCE(c);
    ClockState *clock = CLOCK_OF(c);
    double interval;
    behaviour_interval(it->behaviour, it->v, 0, 1, &interval);
    if (clock->used && !(interval > 0.0))
        return (fmi3Status)instance_refuse(it, "a Clock needs a sample_time of more than 0 s");
    fmi3Status status = plain_exit_initialization(c);
    clock->event_mode = clock->used && status == fmi3OK;
    return status;
}

fmi3Status fmi3Reset(fmi3Instance c) {
    fmi3Status status = plain_reset(c);
    if (c) *CLOCK_OF(c) = (ClockState){.used = CLOCK_OF(c)->used};
    return status;
}

/* Refuse a call that belongs to the other mode. */
static fmi3Status in_mode(fmi3Instance c, int event_mode, const char *call) {
    INSTANCE(c);
    if (it->phase == RUNNING && CLOCK_OF(c)->event_mode == event_mode) return fmi3OK;
    return (fmi3Status)instance_refuse(it, "%s is for %s mode", call,
                                       event_mode ? "event" : "step");
}

fmi3Status fmi3EnterEventMode(fmi3Instance c) {
    fmi3Status status = in_mode(c, 0, "fmi3EnterEventMode");
    if (status != fmi3OK) return status;
    if (!CLOCK_OF(c)->used) return plain_enter_event_mode(c);
    CLOCK_OF(c)->event_mode = 1;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance c) {
    fmi3Status status = in_mode(c, 1, "fmi3EnterStepMode");
    if (status == fmi3OK) CLOCK_OF(c)->event_mode = 0;
    return status;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *next_defined, fmi3Float64 *next) {
    fmi3Status status = in_mode(c, 1, "fmi3UpdateDiscreteStates");
    if (status != fmi3OK) return status;
    INSTANCE(c);
    Message why;
    if (!behaviour_update(it->behaviour, it->v, &why))
        return (fmi3Status)instance_refuse(it, "%s", why.text);
    memset(CLOCK_OF(c)->ticking, 0, sizeof CLOCK_OF(c)->ticking);
    *again = *terminate = *nominals = *values = *next_defined = fmi3False;
    *next = 0.0;
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 from, fmi3Float64 size, fmi3Boolean no_way_back,
                      fmi3Boolean *events, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *last_time) {
    fmi3Status status = in_mode(c, 0, "fmi3DoStep");
    if (status != fmi3OK) return status;
    int sampled = CLOCK_OF(c)->due;
    status = plain_step(c, from, size, no_way_back, events, terminate, early, last_time);
    if (events) *events = sampled && status == fmi3OK; /* discrete outputs have changed */
    return status;
}

static fmi3Status of_the_clock(fmi3Instance c, const fmi3ValueReference vr[], size_t n) {
    INSTANCE(c);
    for (size_t i = 0; i < n; i++)
        if (vr[i] < CLOCK || vr[i] >= CLOCK + MODEL_CLOCKS)
            return (fmi3Status)instance_refuse(it, "value reference %u is no Clock; %u is", vr[i],
                                               CLOCK);
    return fmi3OK;
}

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        fmi3Clock values[]) {
    fmi3Status status = of_the_clock(c, vr, n);
    for (size_t i = 0; status == fmi3OK && i < n; i++)
        values[i] = CLOCK_OF(c)->ticking[vr[i] - CLOCK] != 0;
    return status;
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        const fmi3Clock values[]) {
    fmi3Status status = of_the_clock(c, vr, n);
    if (status == fmi3OK) status = in_mode(c, 1, "fmi3SetClock");
    for (size_t i = 0; status == fmi3OK && i < n; i++) {
        Instance *it = ((Slave *)c)->it;
        CLOCK_OF(c)->ticking[vr[i] - CLOCK] = values[i];
        if (values[i]) behaviour_tick(it->behaviour, it->v, (int)(vr[i] - CLOCK));
    }
    return status;
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    fmi3Status status = of_the_clock(c, vr, n);
    for (size_t i = 0; status == fmi3OK && i < n; i++) {
        Instance *it = ((Slave *)c)->it;
        qualifiers[i] = (fmi3IntervalQualifier)behaviour_interval(
            it->behaviour, it->v, (int)(vr[i] - CLOCK), it->phase != RUNNING, intervals + i);
    }
    return status;
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                               fmi3Float64 shifts[]) {
    fmi3Status status = of_the_clock(c, vr, n);
    for (size_t i = 0; status == fmi3OK && i < n; i++)
        shifts[i] = behaviour_shift(((Slave *)c)->it->v, (int)(vr[i] - CLOCK));
    return status;
}
