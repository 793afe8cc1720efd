/* FMI 3.0 for co-simulation around an instance. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "instance.h"

#define UNUSED(x) (void)(x)

/* The independent variable, after those of the table. */
#define TIME (MODEL_VARIABLES + 1)

typedef struct {
    Instance *it;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} Slave;

#define INSTANCE(c)              \
    if (!(c)) return fmi3Error;  \
    Instance *it = ((Slave *)(c))->it

static void to_log(void *owner, Status status, const char *category, const char *text) {
    Slave *slave = owner;
    if (slave->log) slave->log(slave->environment, (fmi3Status)status, category, text);
}

/* ---- life cycle */

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t count,
                               const fmi3String categories[]) {
    INSTANCE(c);
    return (fmi3Status)instance_show(it, on, count, categories);
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t intermediates,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update) {
    UNUSED(resources), UNUSED(visible), UNUSED(early_return), UNUSED(intermediate);
    UNUSED(update);
    Slave before = {NULL, log, environment};
    const char *why = NULL;
    Message told;
    if (!model_take(resources, &told)) {
        to_log(&before, FAILURE, "logStatusError", told.text);
        return NULL;
    }
    if (event_mode) why = "this FMU has no event mode";
    if (intermediates > 0) why = "this FMU has no intermediate variables";
    if (!name || !*name) why = "the instance needs a name";
    if (!token || strcmp(token, MODEL_GUID) != 0) {
        say(&told, "the instantiation token is not that of this binary, %s: model description and "
                   "binary belong to different builds", MODEL_GUID);
        why = told.text;
    }
    Slave *slave = why ? NULL : malloc(sizeof *slave);
    Instance *it = slave ? instance_new(to_log, slave, logging) : NULL;
    if (!it) {
        free(slave);
        model_leave();
        to_log(&before, FAILURE, "logStatusError", why ? why : "there is no memory left");
        return NULL;
    }
    *slave = before;
    slave->it = it;
    return slave;
}

static fmi3Instance of_another_type(fmi3InstanceEnvironment environment,
                                    fmi3LogMessageCallback log) {
    Slave nobody = {NULL, log, environment};
    to_log(&nobody, FAILURE, "logStatusError", "this FMU is for co-simulation");
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    UNUSED(name), UNUSED(token), UNUSED(resources), UNUSED(visible), UNUSED(logging);
    return of_another_type(environment, log);
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock) {
    UNUSED(name), UNUSED(token), UNUSED(resources), UNUSED(visible), UNUSED(logging);
    UNUSED(clock), UNUSED(lock), UNUSED(unlock);
    return of_another_type(environment, log);
}

void fmi3FreeInstance(fmi3Instance c) {
    Slave *slave = c;
    if (!slave) return;
    instance_free(slave->it);
    free(slave);
    model_leave();
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stop_defined, fmi3Float64 stop) {
    UNUSED(tolerance_defined), UNUSED(tolerance);
    INSTANCE(c);
    if (it->phase == INSTANTIATED) {
        Status status = instance_set_experiment(it, start, stop_defined ? stop : INFINITY);
        if (status != FINE) return (fmi3Status)status;
    }
    return (fmi3Status)instance_enter_initialization(it);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    INSTANCE(c);
    return (fmi3Status)instance_exit_initialization(it);
}

fmi3Status fmi3Terminate(fmi3Instance c) {
    INSTANCE(c);
    return (fmi3Status)instance_terminate(it);
}

fmi3Status fmi3Reset(fmi3Instance c) {
    INSTANCE(c);
    return (fmi3Status)instance_reset(it);
}

/* ---- variables */

/* As many values as references: every variable is a scalar. */
static Status fits(Instance *it, size_t references, size_t values) {
    if (references == values) return FINE;
    return instance_refuse(it, "%lu values for %lu scalar variables", (unsigned long)values,
                           (unsigned long)references);
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          fmi3Float64 values[], size_t count) {
    INSTANCE(c);
    Status status = fits(it, n, count);
    size_t done = 0;
    /* runs of variables of the table, with time between them */
    while (status == FINE && done < n) {
        size_t run = 0;
        if (vr && values && vr[done] == TIME) {
            values[done++] = it->time;
            continue;
        }
        while (done + run < n && (!vr || vr[done + run] != TIME)) run++;
        status = instance_get_reals(it, vr ? vr + done : NULL, run, values ? values + done : NULL);
        done += run;
    }
    return (fmi3Status)status;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const fmi3Float64 values[], size_t count) {
    INSTANCE(c);
    Status status = fits(it, n, count);
    for (size_t i = 0; vr && status == FINE && i < n; i++)
        if (vr[i] == TIME) status = instance_refuse(it, "time cannot be written");
    return (fmi3Status)(status == FINE ? instance_set_reals(it, vr, n, values) : status);
}

fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 values[],
                        size_t count) {
    INSTANCE(c);
    Status status = fits(it, n, count);
    return (fmi3Status)(status == FINE ? instance_get_integers(it, vr, n, values) : status);
}

fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        const fmi3Int32 values[], size_t count) {
    INSTANCE(c);
    Status status = fits(it, n, count);
    return (fmi3Status)(status == FINE ? instance_set_integers(it, vr, n, values) : status);
}

#define NO_SUCH_TYPE(type)                                                                   \
    fmi3Status fmi3Get##type(fmi3Instance c, const fmi3ValueReference vr[], size_t n,        \
                             fmi3##type values[], size_t count) {                            \
        UNUSED(values), UNUSED(count);                                                       \
        INSTANCE(c);                                                                         \
        return (fmi3Status)instance_no_such_type(it, vr, n, #type);                          \
    }                                                                                        \
    fmi3Status fmi3Set##type(fmi3Instance c, const fmi3ValueReference vr[], size_t n,        \
                             const fmi3##type values[], size_t count) {                      \
        UNUSED(values), UNUSED(count);                                                       \
        INSTANCE(c);                                                                         \
        return (fmi3Status)instance_no_such_type(it, vr, n, #type);                          \
    }

NO_SUCH_TYPE(Float32)
NO_SUCH_TYPE(Int8)
NO_SUCH_TYPE(UInt8)
NO_SUCH_TYPE(Int16)
NO_SUCH_TYPE(UInt16)
NO_SUCH_TYPE(UInt32)
NO_SUCH_TYPE(Int64)
NO_SUCH_TYPE(UInt64)
NO_SUCH_TYPE(Boolean)
NO_SUCH_TYPE(String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[],
                         fmi3Binary values[], size_t count) {
    UNUSED(sizes), UNUSED(values), UNUSED(count);
    INSTANCE(c);
    return (fmi3Status)instance_no_such_type(it, vr, n, "Binary");
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         const size_t sizes[], const fmi3Binary values[], size_t count) {
    UNUSED(sizes), UNUSED(values), UNUSED(count);
    INSTANCE(c);
    return (fmi3Status)instance_no_such_type(it, vr, n, "Binary");
}

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        fmi3Clock values[]) {
    UNUSED(values);
    INSTANCE(c);
    return (fmi3Status)instance_no_such_type(it, vr, n, "Clock");
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        const fmi3Clock values[]) {
    UNUSED(values);
    INSTANCE(c);
    return (fmi3Status)instance_no_such_type(it, vr, n, "Clock");
}

/* ---- the whole state */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
    INSTANCE(c);
    return (fmi3Status)instance_save(it, (Saved **)state);
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
    INSTANCE(c);
    return (fmi3Status)instance_load(it, state);
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    if (!c) return fmi3Error;
    if (state) {
        saved_free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    INSTANCE(c);
    return (fmi3Status)instance_serialized_size(it, state, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size) {
    INSTANCE(c);
    return (fmi3Status)instance_serialize(it, state, bytes, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state) {
    INSTANCE(c);
    return (fmi3Status)instance_deserialize(it, bytes, size, (Saved **)state);
}

/* ---- derivatives */

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknown[],
                                        size_t unknowns, const fmi3ValueReference inputs[],
                                        size_t knowns, const fmi3Float64 seed[], size_t seeds,
                                        fmi3Float64 change[], size_t changes) {
    INSTANCE(c);
    Status status = fits(it, knowns, seeds);
    if (status == FINE) status = fits(it, unknowns, changes);
    if (status == FINE)
        status = instance_direction(it, unknown, unknowns, inputs, knowns, seed, change);
    return (fmi3Status)status;
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknown[],
                                    size_t unknowns, const fmi3ValueReference inputs[],
                                    size_t knowns, const fmi3Float64 seed[], size_t seeds,
                                    fmi3Float64 sensitivity[], size_t sensitivities) {
    INSTANCE(c);
    double column[MOST_VARIABLES], one = 1.0;
    Status status = fits(it, unknowns, seeds);
    if (status == FINE) status = fits(it, knowns, sensitivities);
    if (status == FINE && ((unknowns > 0 && !seed) || (knowns > 0 && (!inputs || !sensitivity))))
        status = instance_refuse(it, "the value references or values are missing");
    for (size_t k = 0; status == FINE && k < knowns; k++) {
        sensitivity[k] = 0.0;
        for (size_t i = 0; status == FINE && i < unknowns; i++) {
            status = instance_direction(it, unknown + i, 1, inputs + k, 1, &one, column);
            sensitivity[k] += seed[i] * column[0];
        }
    }
    return (fmi3Status)status;
}

/* ---- steps */

fmi3Status fmi3EnterStepMode(fmi3Instance c) {
    INSTANCE(c);
    return (fmi3Status)instance_refuse(it, "there is no event mode to come from");
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 from, fmi3Float64 size, fmi3Boolean no_way_back,
                      fmi3Boolean *events, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *last_time) {
    UNUSED(no_way_back);
    INSTANCE(c);
    Status status = instance_step(it, from, size);
    if (events) *events = fmi3False;
    if (terminate) *terminate = fmi3False;
    if (early) *early = fmi3False;
    if (last_time) *last_time = it->time;
    return (fmi3Status)status;
}

/* ---- what FMI 3.0 has and these components do not */

static fmi3Status no_such_thing(fmi3Instance c, const char *what) {
    INSTANCE(c);
    return (fmi3Status)instance_refuse(it, "this FMU has no %s", what);
}

fmi3Status fmi3EnterEventMode(fmi3Instance c) { return no_such_thing(c, "event mode"); }

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) {
    return no_such_thing(c, "structural parameters");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) {
    return no_such_thing(c, "structural parameters");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference vr,
                                               size_t *count) {
    UNUSED(vr), UNUSED(count);
    return no_such_thing(c, "dependencies per element");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent,
                                       size_t elements[], fmi3ValueReference independents[],
                                       size_t of[], fmi3DependencyKind kinds[], size_t count) {
    UNUSED(dependent), UNUSED(elements), UNUSED(independents), UNUSED(of), UNUSED(kinds);
    UNUSED(count);
    return no_such_thing(c, "dependencies per element");
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                    const fmi3Int32 orders[], fmi3Float64 values[], size_t count) {
    UNUSED(vr), UNUSED(n), UNUSED(orders), UNUSED(values), UNUSED(count);
    return no_such_thing(c, "derivatives of outputs");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    UNUSED(vr), UNUSED(n), UNUSED(intervals), UNUSED(qualifiers);
    return no_such_thing(c, "clocks");
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[]) {
    UNUSED(vr), UNUSED(n), UNUSED(counters), UNUSED(resolutions), UNUSED(qualifiers);
    return no_such_thing(c, "clocks");
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                               fmi3Float64 shifts[]) {
    UNUSED(vr), UNUSED(n), UNUSED(shifts);
    return no_such_thing(c, "clocks");
}

fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                fmi3UInt64 counters[], fmi3UInt64 resolutions[]) {
    UNUSED(vr), UNUSED(n), UNUSED(counters), UNUSED(resolutions);
    return no_such_thing(c, "clocks");
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                  const fmi3Float64 intervals[]) {
    UNUSED(vr), UNUSED(n), UNUSED(intervals);
    return no_such_thing(c, "clocks");
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                   const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    UNUSED(vr), UNUSED(n), UNUSED(counters), UNUSED(resolutions);
    return no_such_thing(c, "clocks");
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                               const fmi3Float64 shifts[]) {
    UNUSED(vr), UNUSED(n), UNUSED(shifts);
    return no_such_thing(c, "clocks");
}

fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    UNUSED(vr), UNUSED(n), UNUSED(counters), UNUSED(resolutions);
    return no_such_thing(c, "clocks");
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) { return no_such_thing(c, "event mode"); }

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *next_defined, fmi3Float64 *next) {
    UNUSED(again), UNUSED(terminate), UNUSED(nominals), UNUSED(values), UNUSED(next_defined);
    UNUSED(next);
    return no_such_thing(c, "event mode");
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) {
    return no_such_thing(c, "model exchange");
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_way_back,
                                       fmi3Boolean *event_mode, fmi3Boolean *terminate) {
    UNUSED(no_way_back), UNUSED(event_mode), UNUSED(terminate);
    return no_such_thing(c, "model exchange");
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time) {
    UNUSED(time);
    return no_such_thing(c, "model exchange");
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 states[], size_t count) {
    UNUSED(states), UNUSED(count);
    return no_such_thing(c, "model exchange");
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 derivatives[],
                                             size_t count) {
    UNUSED(derivatives), UNUSED(count);
    return no_such_thing(c, "model exchange");
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 indicators[], size_t count) {
    UNUSED(indicators), UNUSED(count);
    return no_such_thing(c, "model exchange");
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 states[], size_t count) {
    UNUSED(states), UNUSED(count);
    return no_such_thing(c, "model exchange");
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[],
                                             size_t count) {
    UNUSED(nominals), UNUSED(count);
    return no_such_thing(c, "model exchange");
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *count) {
    UNUSED(count);
    return no_such_thing(c, "model exchange");
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *count) {
    UNUSED(count);
    return no_such_thing(c, "model exchange");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock,
                                      fmi3Float64 time) {
    UNUSED(clock), UNUSED(time);
    return no_such_thing(c, "model partitions");
}
