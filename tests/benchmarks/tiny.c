/* The smallest FMI 2.0 co-simulation FMU that does something: x' = u - x, N times, one Euler
   step per communication step. What is left of a run of two of them is the master. */

#include "slave.h"

struct Model {
    double x[N], u[N];
};

static int begin(Model *m, const Log *log) {
    for (int i = 0; i < N; i++)
        m->x[i] = 1.0;
    return 1;
}
static int step(Model *m, double t, double h) {
    for (int i = 0; i < N; i++)
        m->x[i] += h * (m->u[i] - m->x[i]);
    return fmi2OK;
}
static const Behaviour behaviour = {sizeof(Model), .begin = begin, .step = step};

GETTER(fmi2, Real, fmi2OK, m->x[reference])
SETTER(fmi2, Real, fmi2OK, m->u[reference - N])
REFUSED(fmi2GetInteger) REFUSED(fmi2GetBoolean) REFUSED(fmi2GetString)
REFUSED(fmi2SetInteger) REFUSED(fmi2SetBoolean) REFUSED(fmi2SetString)
REFUSED(fmi2GetFMUstate) REFUSED(fmi2SetFMUstate) REFUSED(fmi2FreeFMUstate)
REFUSED(fmi2SerializedFMUstateSize) REFUSED(fmi2SerializeFMUstate)
REFUSED(fmi2DeSerializeFMUstate) REFUSED(fmi2GetDirectionalDerivative)
REFUSED(fmi2SetRealInputDerivatives) REFUSED(fmi2GetRealOutputDerivatives)
REFUSED(fmi2CancelStep) REFUSED(fmi2GetStatus) REFUSED(fmi2GetRealStatus)
REFUSED(fmi2GetIntegerStatus) REFUSED(fmi2GetBooleanStatus) REFUSED(fmi2GetStringStatus)

/* The bound: what a master for these two FMUs alone would be. */
int bare_loop(fmi2GetRealTYPE *get_a, fmi2SetRealTYPE *set_a, fmi2DoStepTYPE *step_a, void *a,
              fmi2GetRealTYPE *get_b, fmi2SetRealTYPE *set_b, fmi2DoStepTYPE *step_b, void *b,
              const unsigned *out, const unsigned *in, double h, long steps) {
    double ya[N], yb[N];
    for (long k = 0; k < steps; k++)
        if (get_a(a, out, N, ya) || get_b(b, out, N, yb) || set_a(a, in, N, yb) ||
            set_b(b, in, N, ya) || step_a(a, (double)k * h, h, 1) || step_b(b, (double)k * h, h, 1))
            return 1;
    return 0;
}

/* The same for `many` of them: input i of one reads row[from[i]] of the outputs of all. */
int bare_graph(fmi2GetRealTYPE *get, fmi2SetRealTYPE *set, fmi2DoStepTYPE *step, void **one,
               long many, const unsigned *out, const unsigned *in, const long *from, double *row,
               double h, long steps) {
    double u[N];
    for (long k = 0; k < steps; k++) {
        for (long j = 0; j < many; j++)
            if (get(one[j], out, N, row + j * N))
                return 1;
        for (long j = 0; j < many; j++) {
            for (long i = 0; i < N; i++)
                u[i] = row[from[j * N + i]];
            if (set(one[j], in, N, u))
                return 1;
        }
        for (long j = 0; j < many; j++)
            if (step(one[j], (double)k * h, h, 1))
                return 1;
    }
    return 0;
}
