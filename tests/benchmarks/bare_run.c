/* Many runs of a plant and its controller, FMI 2.0: reset, parameters, steps; no more. */

#include <stddef.h>
#include <stdint.h>

typedef struct {
    void *component;
    int (*reset)(void *);
    int (*setup)(void *, int, double, double, int, double);
    int (*enter)(void *);
    int (*leave)(void *);
    int (*get)(void *, const uint32_t *, size_t, double *);
    int (*set)(void *, const uint32_t *, size_t, const double *);
    int (*step)(void *, double, double, int);
    const uint32_t *outputs, *inputs, *parameters;
    double *values; /* of the parameters */
    int64_t out, in, given;
} Slave;

/* Return whether anything was refused.
   `starts` : value of the plant's first parameter, one per run; `last` : its first output there. */
__attribute__((visibility("default"))) int bare_runs(const Slave *plant, const Slave *controller,
                                                     const double *starts, double *last,
                                                     size_t runs, size_t steps, double size) {
    const Slave *both[2] = {plant, controller};
    double x[64], u[64];
    int refused = 0;
    for (size_t r = 0; r < runs; r++) {
        plant->values[0] = starts[r];
        for (int i = 0; i < 2; i++) {
            const Slave *s = both[i];
            refused |= s->reset(s->component) > 1;
            refused |= s->set(s->component, s->parameters, (size_t)s->given, s->values) > 1;
            refused |= s->setup(s->component, 0, 0, 0, 1, (double)steps * size) > 1;
            refused |= s->enter(s->component) > 1;
            refused |= s->leave(s->component) > 1;
        }
        for (size_t k = 0; k < steps; k++) {
            refused |= plant->get(plant->component, plant->outputs, (size_t)plant->out, x) > 1;
            refused |= controller->set(controller->component, controller->inputs,
                                       (size_t)controller->in, x) > 1;
            refused |= controller->get(controller->component, controller->outputs,
                                       (size_t)controller->out, u) > 1;
            refused |= plant->set(plant->component, plant->inputs, (size_t)plant->in, u) > 1;
            for (int i = 0; i < 2; i++)
                refused |= both[i]->step(both[i]->component, (double)k * size, size, 1) > 1;
        }
        refused |= plant->get(plant->component, plant->outputs, 1, last + r) > 1;
    }
    return refused;
}
