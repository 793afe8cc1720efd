/* The instance of instance.c, which logs what a step has to report. */

#define instance_step plain_step
#include "instance.c"
#undef instance_step

#include "watch.h"

Status instance_step(Instance *it, double from, double size);

Status instance_step(Instance *it, double from, double size) {
    Status status = plain_step(it, from, size);
    const char *notice = status == FINE ? behaviour_notice(it->behaviour) : NULL;
    if (notice) instance_log(it, UNUSUAL, notice);
    return status;
}
