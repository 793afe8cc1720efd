/* The tiny FMU x' = u - x, except that u > 666 ends the process as nothing can prevent, u < -666
   fails its step, and a step takes a moment if u is between 100 and 200. */

#define fmi2DoStep harmless_step
#include "../benchmarks/tiny.c"
#undef fmi2DoStep

#include <signal.h>
#include <unistd.h>

API Status fmi2DoStep(Component c, double t, double h, int keep) {
    Model *m = c;
    if (m->u[0] > 666.0)
        kill(getpid(), SIGKILL);
    if (m->u[0] < -666.0)
        return 3;
    if (m->u[0] >= 100.0 && m->u[0] <= 200.0)
        usleep(2000);
    return harmless_step(c, t, h, keep);
}
