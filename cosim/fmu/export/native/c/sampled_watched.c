/* The sampled law of sampled.c, with the use of its assumptions as outputs. As
   fmu_src/hinf_controller/watched.py. */

#include "behaviour.h"
#include "watch.h"

#define behaviour_new sampled_new
#define behaviour_initialise sampled_initialise
#define behaviour_advance sampled_advance
#define behaviour_size sampled_size
#define behaviour_save sampled_save
#define behaviour_restore sampled_restore
#include "sampled.c"
#undef behaviour_new
#undef behaviour_initialise
#undef behaviour_advance
#undef behaviour_size
#undef behaviour_save
#undef behaviour_restore

enum { STAMP, GREATEST_AGE, AGE };

typedef struct {
    Behaviour sampled; /* first: a pointer to it is one to the whole */
    double now;
} Watched;

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Watched)); }

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    const char *objection = model_objection(v);
    if (objection) return say(why, "%s", objection);
    if (!sampled_initialise(b, v, start, why)) return 0;
    ((Watched *)b)->now = start;
    v[model_measured[AGE]] = 0.0;
    watch_start(v);
    return 1;
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    double stamp = v[model_measured[STAMP]], now = ((Watched *)b)->now, use[2];
    if (stamp > now + 1e-9 * greater(1.0, fabs(now)))
        return say(why, "%s is %s s, in the future of t = %s s",
                   model_variables[model_measured[STAMP]].name, shortest(stamp).text,
                   shortest(now).text);
    model_decided(NULL, v, b->constants, use);
    double before = b->samples, age = end - greater(stamp, b->start);
    double most = v[model_measured[GREATEST_AGE]], share = 0.0;
    int late;
    if (most > 0.0) share = share_of_age(age, most, end, &late);
    if (!(isfinite(share) && isfinite(use[0]) && isfinite(use[1])))
        return say(why, "the use of an assumption at %s s overflows", shortest(end).text);
    if (!sampled_advance(b, v, end, why)) return 0;
    ((Watched *)b)->now = end;
    v[model_measured[AGE]] = age;
    v[model_watched[0]] = share;
    v[model_watched[1]] = use[0];
    if (v[V_sample_time] == 0.0 || b->samples > before) v[model_watched[2]] = use[1];
    watch(v);
    return 1;
}

size_t behaviour_size(const Behaviour *b) { return sampled_size(b) + 1; }

void behaviour_save(const Behaviour *b, double *to) {
    sampled_save(b, to);
    to[sampled_size(b)] = ((const Watched *)b)->now;
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    if (count != sampled_size(b) + 1 || !isfinite(from[count - 1]))
        return say(why, "the saved sampling clock does not fit this component");
    if (!sampled_restore(b, v, from, count - 1, why)) return 0;
    ((Watched *)b)->now = from[count - 1];
    return 1;
}
