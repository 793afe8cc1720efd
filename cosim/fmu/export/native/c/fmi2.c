/* FMI 2.0 for co-simulation around an instance. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "instance.h"

#define UNUSED(x) (void)(x)

typedef struct {
    Instance *it;
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    char *name;
} Slave;

/* The instance behind a component, or an end of the call. */
#define INSTANCE(c)               \
    if (!(c)) return fmi2Error;   \
    Instance *it = ((Slave *)(c))->it

/* A host may take the text for a format, and # for a value reference: both are doubled. */
static void to_logger(void *owner, Status status, const char *category, const char *text) {
    Slave *slave = owner;
    char doubled[2 * sizeof((Message *)0)->text];
    char *to = doubled;
    for (; *text; text++) {
        if (*text == '%' || *text == '#') *to++ = *text;
        *to++ = *text;
    }
    *to = 0;
    if (slave->logger)
        slave->logger(slave->environment, slave->name, (fmi2Status)status, category, doubled);
}

/* ---- life cycle */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count,
                               const fmi2String categories[]) {
    INSTANCE(c);
    return (fmi2Status)instance_show(it, on != fmi2False, count, categories);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging) {
    UNUSED(resources), UNUSED(visible); /* of a model that is compiled in */
    Slave before = {NULL, functions ? functions->logger : NULL,
                    functions ? functions->componentEnvironment : NULL,
                    (char *)(name ? name : "")};
    const char *why = NULL;
    Message told;
    if (!model_take(resources, &told)) {
        to_logger(&before, FAILURE, "logStatusError", told.text);
        return NULL;
    }
    if (!functions) why = "the callback functions are missing";
    if (!name || !*name) why = "the instance needs a name";
    if (type != fmi2CoSimulation) why = "this FMU is for co-simulation";
    if (!guid || strcmp(guid, MODEL_GUID) != 0) {
        say(&told, "the GUID is not that of this binary, %s: model description and binary belong "
                   "to different builds", MODEL_GUID);
        why = told.text;
    }
    if (why) {
        to_logger(&before, FAILURE, "logStatusError", why);
        model_leave();
        return NULL;
    }
    Slave *slave = malloc(sizeof *slave);
    char *copy = malloc(strlen(name) + 1);
    Instance *it = slave && copy ? instance_new(to_logger, slave, logging != fmi2False) : NULL;
    if (!it) {
        free(slave);
        free(copy);
        model_leave();
        to_logger(&before, FAILURE, "logStatusError", "there is no memory left");
        return NULL;
    }
    *slave = before;
    slave->it = it;
    slave->name = strcpy(copy, name);
    return slave;
}

void fmi2FreeInstance(fmi2Component c) {
    Slave *slave = c;
    if (!slave) return;
    instance_free(slave->it);
    free(slave->name);
    free(slave);
    model_leave();
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop) {
    UNUSED(tolerance_defined), UNUSED(tolerance);
    INSTANCE(c);
    return (fmi2Status)instance_set_experiment(it, start, stop_defined ? stop : INFINITY);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    INSTANCE(c);
    return (fmi2Status)instance_enter_initialization(it);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    INSTANCE(c);
    return (fmi2Status)instance_exit_initialization(it);
}

fmi2Status fmi2Terminate(fmi2Component c) {
    INSTANCE(c);
    return (fmi2Status)instance_terminate(it);
}

fmi2Status fmi2Reset(fmi2Component c) {
    INSTANCE(c);
    return (fmi2Status)instance_reset(it);
}

/* ---- variables */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    INSTANCE(c);
    return (fmi2Status)instance_get_reals(it, vr, n, value);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Integer value[]) {
    INSTANCE(c);
    return (fmi2Status)instance_get_integers(it, vr, n, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[]) {
    INSTANCE(c);
    return (fmi2Status)instance_set_reals(it, vr, n, value);
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          const fmi2Integer value[]) {
    INSTANCE(c);
    return (fmi2Status)instance_set_integers(it, vr, n, value);
}

#define NO_SUCH_TYPE(function, constant, type, name)                                       \
    fmi2Status function(fmi2Component c, const fmi2ValueReference vr[], size_t n,          \
                        constant type value[]) {                                           \
        UNUSED(value);                                                                     \
        INSTANCE(c);                                                                       \
        return (fmi2Status)instance_no_such_type(it, vr, n, name);                         \
    }

NO_SUCH_TYPE(fmi2GetBoolean, , fmi2Boolean, "Boolean")
NO_SUCH_TYPE(fmi2SetBoolean, const, fmi2Boolean, "Boolean")
NO_SUCH_TYPE(fmi2GetString, , fmi2String, "String")
NO_SUCH_TYPE(fmi2SetString, const, fmi2String, "String")

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                        size_t unknowns, const fmi2ValueReference inputs[],
                                        size_t knowns, const fmi2Real seed[], fmi2Real change[]) {
    INSTANCE(c);
    return (fmi2Status)instance_direction(it, unknown, unknowns, inputs, knowns, seed, change);
}

/* ---- the whole state */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    INSTANCE(c);
    return (fmi2Status)instance_save(it, (Saved **)state);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    INSTANCE(c);
    return (fmi2Status)instance_load(it, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!c) return fmi2Error;
    if (state) {
        saved_free(*state);
        *state = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    INSTANCE(c);
    return (fmi2Status)instance_serialized_size(it, state, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size) {
    INSTANCE(c);
    return (fmi2Status)instance_serialize(it, state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state) {
    INSTANCE(c);
    return (fmi2Status)instance_deserialize(it, bytes, size, (Saved **)state);
}

/* ---- steps */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real from, fmi2Real size, fmi2Boolean no_way_back) {
    UNUSED(no_way_back);
    INSTANCE(c);
    return (fmi2Status)instance_step(it, from, size);
}

fmi2Status fmi2CancelStep(fmi2Component c) {
    INSTANCE(c);
    return (fmi2Status)instance_decline(it, FAILURE, "no step is pending: each is done at once");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    UNUSED(vr), UNUSED(n), UNUSED(order), UNUSED(value);
    INSTANCE(c);
    return (fmi2Status)instance_refuse(it, "inputs are held, their derivatives cannot be set");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    UNUSED(vr), UNUSED(n), UNUSED(order), UNUSED(value);
    INSTANCE(c);
    return (fmi2Status)instance_refuse(it, "derivatives of outputs are not provided");
}

static fmi2Status no_status(fmi2Component c) {
    INSTANCE(c);
    return (fmi2Status)instance_decline(it, DISCARDED, "this status exists only for pending steps");
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    UNUSED(kind), UNUSED(value);
    return no_status(c);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (!c || kind != fmi2LastSuccessfulTime || !value) return no_status(c);
    *value = ((Slave *)c)->it->time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    UNUSED(kind), UNUSED(value);
    return no_status(c);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (!c || kind != fmi2Terminated || !value) return no_status(c);
    *value = fmi2False; /* no component ends a run by itself */
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    UNUSED(kind), UNUSED(value);
    return no_status(c);
}
