/* A slave of FMI 3.0 in C++, without events: y is its time. It throws what nobody catches where
   its model identifier was compiled to: in the constructor of a static object (LOAD), in that of
   the instance, in a step from 1 s on, or in the destructor of the instance. */

#include <stdexcept>

#include "fmi3Functions.h"

#pragma GCC diagnostic ignored "-Wunused-parameter" /* FMI prescribes more than a slave reads */

enum Call { LOAD, INSTANTIATE, STEP, GET, FREE };

static void enter(Call call) {
    if (call == THROWS_IN)
        throw std::runtime_error("the <pump> has lost its prime");
}

static struct Static {
    Static() { enter(LOAD); }
} loaded;

struct Model {
    double time = 0.0;
    Model() { enter(INSTANTIATE); }
    ~Model() noexcept(false) { enter(FREE); }
};

extern "C" {
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference required[], size_t count, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    return new Model;
}
void fmi3FreeInstance(fmi3Instance it) { delete static_cast<Model *>(it); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance it, fmi3Boolean defined,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stops, fmi3Float64 stop) {
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance it) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance it) { return fmi3OK; }
fmi3Status fmi3DoStep(fmi3Instance it, fmi3Float64 time, fmi3Float64 step, fmi3Boolean final,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early,
                      fmi3Float64 *last) {
    Model *m = static_cast<Model *>(it);
    if (time > 1.0 - 1e-9)
        enter(STEP);
    *event = *end = *early = false;
    m->time = *last = time + step;
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance it, const fmi3ValueReference v[], size_t n,
                          fmi3Float64 x[], size_t count) {
    Model *m = static_cast<Model *>(it);
    if (m->time > 1.0 - 1e-9)
        enter(GET);
    for (size_t i = 0; i < n; i++)
        x[i] = m->time;
    return fmi3OK;
}
}
