/* An observer: a delay equation whose held inputs are innovations and the control that acts. The
   same operations in the same order as fmu_src/observer/behaviour.py, whose text says what is done
   and why. Beyond it, a step that fails leaves everything as it was. */

#include "behaviour.h"
#include "delay_line.c" /* whose history is looked up */
#include "watch.h"

#undef DELAYS

#define behaviour_new plant_new
#define behaviour_free plant_free
#define behaviour_initialise plant_initialise
#define behaviour_advance plant_advance
#define behaviour_size plant_size
#define behaviour_save plant_save
#define behaviour_restore plant_restore
#define delay_line_forget(line) ((void)(line)) /* the parts of a step are undone together */
#include "plant.c"
#undef behaviour_new
#undef behaviour_free
#undef behaviour_initialise
#undef behaviour_advance
#undef behaviour_size
#undef behaviour_save
#undef behaviour_restore
#undef delay_line_forget

#ifndef MODEL_IS_READ
#define MOST_MEASURED MODEL_MEASURED
#define MOST_DECIDED (2 * (MODEL_OUTPUTS + MODEL_ACTING) + 2)
#endif

/* Of each measurement: stamp, greatest age, age, packets ignored, first innovation. */
enum { STAMP, GREATEST_AGE, AGE, IGNORED, FIRST, FIELDS };

#define MEASUREMENTS ((int)MODEL_MEASURED / FIELDS)
#define FIELD(i, field) model_measured[FIELDS * (i) + (field)]
#define COMMANDS ((int)MODEL_OUTPUTS)
#define ACTING ((int)MODEL_ACTING)
#define WATCHDOG model_play[0]
#define COMMAND_DELAY model_play[1]
#define COMMAND_AGE model_play[2]
#define TRIM (model_play + 3) /* of each command, where there is one; then the safe values */
#define TRIMMED (MODEL_PLAY > 3)
#define MOST_INTEGER 2147483647.0

typedef struct {
    double seen; /* last stamp of the input */
    double used; /* stamp of the measurement in use */
    double any;  /* whether there is one */
} Packet;

typedef struct {
    Behaviour plant; /* first: a pointer to it is one to the whole */
    double start, samples, behind; /* behind: time of the estimate behind the control that acts */
    Packet packet[MOST_MEASURED / FIELDS];
    double *ahead; /* commands on their way, begin to end - 1: the time of the estimate behind each,
                      and its control */
    size_t capacity, begin, end;
    Message notice;
    int noticed;
} Observer;

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Observer)); }

void behaviour_free(Behaviour *b) {
    if (b) free(((Observer *)b)->ahead);
    plant_free(b);
}

const char *behaviour_notice(Behaviour *b) {
    Observer *it = (Observer *)b;
    int noticed = it->noticed;
    it->noticed = 0;
    return noticed ? it->notice.text : NULL;
}

/* Keep estimates as long as a measurement may still be compared with them. */
static void remember(Behaviour *b, const double *v) {
    for (int i = 0; i < MEASUREMENTS; i++)
        b->line.longest = greater(b->line.longest, v[FIELD(i, GREATEST_AGE)]);
}

/* Command the trim, limited as any command: it is decided as the safe values are. */
static void command_trim(double *v) {
    double c[AT_LEAST_ONE(MOST_CONSTANTS)], x[MOST_STATES] = {0.0}, found[MOST_DECIDED];
    double safe[AT_LEAST_ONE(MOST_OUTPUTS)];
    for (int j = 0; j < COMMANDS; j++) {
        safe[j] = v[TRIM[COMMANDS + j]];
        v[TRIM[COMMANDS + j]] = v[TRIM[j]];
    }
    model_constants(v, c);
    model_decided(x, v, c, found);
    const double *chosen = found + COMMANDS + ACTING;
    for (int j = 0; j < COMMANDS; j++) v[TRIM[COMMANDS + j]] = safe[j];
    for (int j = 0; j < COMMANDS; j++) v[model_outputs[j]] = chosen[j];
    for (int j = 0; j < ACTING; j++) v[model_acting[j]] = chosen[COMMANDS + j];
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    Observer *it = (Observer *)b;
    for (int i = 0; i < INPUTS; i++) /* the control of an observer alone is an input */
        if (model_variables[model_inputs[i]].causality == OUTPUT) v[model_inputs[i]] = 0.0;
    for (int i = 0; i < COMMANDS; i++) v[model_outputs[i]] = 0.0;
    if (TRIMMED) command_trim(v);
    if (!plant_initialise(b, v, start, why)) return 0;
    remember(b, v);
    it->start = it->behind = start;
    it->samples = 0.0;
    it->begin = it->end = 0;
    it->noticed = 0;
    for (int i = 0; i < MEASUREMENTS; i++) {
        Packet none = {v[FIELD(i, STAMP)], start, 0.0};
        it->packet[i] = none;
        v[FIELD(i, AGE)] = v[FIELD(i, IGNORED)] = 0.0;
    }
    watch_start(v);
    if (COMMANDS) v[WATCHDOG] = 0.0;
    return 1;
}

/* ---- measurements */

static int receive(Observer *it, double *v, int i, Message *why) {
    Behaviour *b = &it->plant;
    Packet *p = &it->packet[i];
    double stamp = v[FIELD(i, STAMP)], now = b->line.time, oldest = v[FIELD(i, GREATEST_AGE)];
    if (stamp == p->seen) return 1;
    double near = 1e-9 * greater(1.0, fabs(now)); /* as the times of a step may drift */
    if (stamp > now + near)
        return say(why, "%s is %s s, in the future of t = %s s",
                   model_variables[FIELD(i, STAMP)].name, shortest(stamp).text, shortest(now).text);
    double earlier = p->any != 0.0 ? p->used : p->seen;
    p->seen = stamp;
    if (stamp <= earlier || now - stamp > oldest + near) {
        v[FIELD(i, IGNORED)] = lesser(v[FIELD(i, IGNORED)] + 1.0, MOST_INTEGER);
        return 1;
    }
    double stored[MOST_STATES], found[MOST_INPUTS];
    look_up(&b->line, 0, lesser(greater(stamp, now - oldest), now), stored);
    model_compared(stored, v, b->constants, found);
    const unsigned *innovation = model_inputs + ACTING;
    unsigned first = FIELD(i, FIRST);
    unsigned next = i + 1 < MEASUREMENTS ? FIELD(i + 1, FIRST) : (unsigned)MODEL_VARIABLES;
    for (int k = 0; k < INPUTS - ACTING; k++) {
        if (innovation[k] < first || innovation[k] >= next) continue; /* another measurement's */
        if (!isfinite(found[k]))
            return say(why, "%s is not finite", model_variables[innovation[k]].name);
        v[innovation[k]] = found[k];
    }
    p->used = stamp;
    p->any = 1.0;
    return 1;
}

/* Write ages and their use; return the first measurement that is too old, or -1. `oldest`: the
   greatest age of an estimate behind the control that acted in this step. */
static int ages(const Observer *it, double *v, double end, double oldest) {
    double greatest = 0.0;
    int first = -1;
    for (int i = 0; i < MEASUREMENTS; i++) {
        int late;
        double age = end - it->packet[i].used;
        greatest = greater(greatest, share_of_age(age, v[FIELD(i, GREATEST_AGE)], end, &late));
        if (late && first < 0) first = i;
        v[FIELD(i, AGE)] = age;
    }
    if (COMMANDS && v[COMMAND_AGE] > 0.0) {
        int late;
        greatest = greater(greatest, share_of_age(oldest, v[COMMAND_AGE], end, &late));
    }
    v[model_watched[0]] = greatest;
    return first;
}

/* ---- commands */

#define ROW (1 + (size_t)ACTING)

static double *row(const Observer *it, size_t number) { return it->ahead + number * ROW; }

/* Room for one more command on its way. */
static int room_ahead(Observer *it, size_t more, Message *why) {
    if (it->end + more <= it->capacity) return 1;
    if (it->begin > it->capacity / 2) { /* moved seldom */
        memmove(it->ahead, row(it, it->begin), (it->end - it->begin) * ROW * sizeof *it->ahead);
        it->end -= it->begin;
        it->begin = 0;
        if (it->end + more <= it->capacity) return 1;
    }
    size_t capacity = it->capacity ? it->capacity : 16;
    while (capacity < it->end + more) capacity *= 2;
    double *grown = realloc(it->ahead, capacity * ROW * sizeof *grown);
    if (!grown) return say(why, "there is no memory left");
    it->ahead = grown;
    it->capacity = capacity;
    return 1;
}

static void act(Observer *it, double *v) {
    const double *next = row(it, it->begin++);
    it->behind = next[0];
    for (int j = 0; j < ACTING; j++) v[model_acting[j]] = next[1 + j];
}

static void notice(Observer *it, const double *v, double end, int late) {
    it->noticed = 1;
    if (late < 0) {
        say(&it->notice,
            "watchdog at t = %.10g s: all ages are allowed again, commands follow the estimate",
            end);
        return;
    }
    const char *allowed = model_variables[FIELD(late, GREATEST_AGE)].name; /* age.NAME */
    say(&it->notice,
        "watchdog at t = %.10g s: %s is %.10g s old, %s is %.10g s: safe values are commanded",
        end, allowed + 4, v[FIELD(late, AGE)], allowed, v[FIELD(late, GREATEST_AGE)]);
}

static int command(Observer *it, double *v, double end, int late, const double *found,
                   Message *why) {
    double period = v[V_sample_time], samples = it->samples;
    int due = 1, both = COMMANDS + ACTING;
    if (period > 0.0) {
        /* an instant that rounding alone puts after `end` belongs to this point */
        double near = greater(1e-9 * greater(period, 1e-3), 16.0 * spacing(end));
        double taken = floor((end + near - it->start) / period);
        if (!isfinite(taken))
            return say(why, "samples %s s apart cannot be counted up to t = %s s",
                       shortest(period).text, shortest(end).text);
        due = taken > samples;
        samples = greater(taken, samples);
    }
    int changed = (late >= 0) != (v[WATCHDOG] != 0.0);
    if ((due || changed) && !room_ahead(it, 1, why)) return 0;
    it->samples = samples;
    if (changed) notice(it, v, end, late);
    v[WATCHDOG] = late >= 0;
    v[model_watched[1]] = found[2 * both];
    if (!due && !changed) return 1;
    if (late < 0) v[model_watched[2]] = found[2 * both + 1];
    const double *chosen = late >= 0 ? found + both : found;
    for (int j = 0; j < COMMANDS; j++) v[model_outputs[j]] = chosen[j];
    double *last = row(it, it->end++);
    last[0] = end;
    memcpy(last + 1, chosen + COMMANDS, (size_t)ACTING * sizeof *last);
    return 1;
}

/* ---- a step */

static int observe(Observer *it, double *v, double end, Message *why) {
    Behaviour *b = &it->plant;
    for (int i = 0; i < MEASUREMENTS; i++)
        if (!receive(it, v, i, why)) return 0;
    double near = 16.0 * spacing(greater(1.0, fabs(end)));
    double later = COMMANDS ? v[COMMAND_DELAY] : 0.0, oldest = 0.0;
    while (it->begin < it->end && row(it, it->begin)[0] + later < end - near) {
        double instant = row(it, it->begin)[0] + later;
        if (instant > b->line.time && !plant_advance(b, v, instant, why)) return 0;
        oldest = greater(oldest, instant - it->behind);
        act(it, v);
    }
    if (!plant_advance(b, v, end, why)) return 0;
    int late = ages(it, v, end, greater(oldest, end - it->behind));
    double found[MOST_DECIDED];
    model_decided(b->line.x, v, b->constants, found);
    int count = COMMANDS ? 2 * (COMMANDS + ACTING) + 2 : 1;
    int finite = isfinite(v[model_watched[0]]) != 0;
    for (int i = 0; i < count; i++) finite &= isfinite(found[i]) != 0;
    if (!finite)
        return say(why, "a command or the use of an assumption at %s s overflows",
                   shortest(end).text);
    if (!COMMANDS) {
        v[model_watched[1]] = found[0];
    } else {
        if (!command(it, v, end, late, found, why)) return 0;
        while (it->begin < it->end && row(it, it->begin)[0] + later <= end + near) act(it, v);
    }
    watch(v);
    return 1;
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    Observer *it = (Observer *)b;
    double before[MOST_VARIABLES], held[AT_LEAST_ONE(MOST_INPUTS)];
    Packet packet[MOST_MEASURED / FIELDS];
    size_t begin = it->begin;
    double behind = it->behind;
    int stepped = b->stepped;
    memcpy(before, v, (size_t)MODEL_VARIABLES * sizeof *v);
    memcpy(held, b->held, sizeof held);
    memcpy(packet, it->packet, sizeof packet);
    Mark mark = delay_line_mark(&b->line);
    if (observe(it, v, end, why)) {
        delay_line_forget(&b->line);
        return 1;
    }
    delay_line_return(&b->line, &mark);
    memcpy(v, before, (size_t)MODEL_VARIABLES * sizeof *v);
    memcpy(b->held, held, sizeof held);
    memcpy(it->packet, packet, sizeof packet);
    it->begin = begin;
    it->behind = behind;
    b->stepped = stepped;
    return 0;
}

/* ---- the whole state */

#define OWN (4 + 3 * (size_t)MEASUREMENTS)

size_t behaviour_size(const Behaviour *b) {
    const Observer *it = (const Observer *)b;
    return OWN + (it->end - it->begin) * ROW + plant_size(b);
}

void behaviour_save(const Behaviour *b, double *to) {
    const Observer *it = (const Observer *)b;
    size_t waiting = (it->end - it->begin) * ROW;
    *to++ = it->start;
    *to++ = it->samples;
    *to++ = (double)(it->end - it->begin);
    *to++ = it->behind;
    for (int i = 0; i < MEASUREMENTS; i++) {
        *to++ = it->packet[i].seen;
        *to++ = it->packet[i].used;
        *to++ = it->packet[i].any;
    }
    if (waiting > 0) memcpy(to, row(it, it->begin), waiting * sizeof *to);
    plant_save(b, to + waiting);
}

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    static const char *const unfit = "the saved packets and commands do not fit this component";
    Observer *it = (Observer *)b;
    if (count < OWN || !(from[2] >= 0.0 && from[2] <= (double)(count / ROW)) ||
        from[2] != floor(from[2]))
        return say(why, unfit);
    size_t waiting = (size_t)from[2], own = OWN + waiting * ROW;
    if (count < own) return say(why, unfit);
    for (size_t i = 0; i < own; i++)
        if (!isfinite(from[i])) return say(why, unfit);
    if (!plant_restore(b, v, from + own, count - own, why)) return 0;
    remember(b, v);
    if (!room_ahead(it, waiting, why)) return 0;
    it->start = from[0];
    it->samples = from[1];
    it->end = waiting;
    it->begin = 0;
    it->behind = from[3];
    for (int i = 0; i < MEASUREMENTS; i++) {
        Packet saved = {from[4 + 3 * i], from[5 + 3 * i], from[6 + 3 * i]};
        it->packet[i] = saved;
    }
    if (waiting > 0) memcpy(it->ahead, from + OWN, waiting * ROW * sizeof *it->ahead);
    return 1;
}
