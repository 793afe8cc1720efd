/* A component alone, over the points and inputs of a run: sets and steps; or sets alone. */

#include <stddef.h>
#include <stdint.h>

typedef int (*Set)(void *, const uint32_t *, size_t, const double *);
typedef int (*Step)(void *, double, double, int);

/* Return whether anything was refused. */
__attribute__((visibility("default"))) int alone(Set set, Step step, void *component,
                                                 const uint32_t *references, size_t count,
                                                 const double *inputs, const double *seconds,
                                                 const double *sizes, size_t steps, int stepping) {
    int refused = 0;
    for (size_t k = 0; k < steps; k++) {
        if (count)
            refused |= set(component, references, count, inputs + k * count) > 1;
        if (stepping)
            refused |= step(component, seconds[k], sizes[k], 1) > 1;
    }
    return refused;
}
