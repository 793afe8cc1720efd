/* The whole state of an instance, in memory and as bytes. */

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "arithmetic.h"
#include "instance.h"

#define VARIABLES ((size_t)MODEL_VARIABLES)

#define MARK 0x5AFEu
#define HEAD 4 /* phase, stale, time, stop time */

void saved_free(Saved *saved) {
    if (saved) saved->mark = 0;
    free(saved);
}

static int is_saved(const Saved *saved) { return saved && saved->mark == MARK; }

static Saved *saved_new(Saved *old, size_t count) {
    Saved *saved = realloc(old, sizeof *saved + count * sizeof(double));
    if (!saved) return NULL;
    saved->mark = MARK;
    saved->count = count;
    return saved;
}

Status instance_save(Instance *it, Saved **saved) {
    if (!saved) return instance_refuse(it, "there is no place for the saved state");
    if (*saved && !is_saved(*saved)) return instance_refuse(it, "this is no saved state");
    if (it->phase == FAILED) return instance_decline(it, FAILURE, "a failed instance is not saved");
    size_t own = it->phase == INSTANTIATED || it->phase == INITIALIZING
                     ? 0
                     : behaviour_size(it->behaviour);
    Saved *taken = saved_new(*saved, HEAD + VARIABLES + own);
    if (!taken) return instance_refuse(it, "there is no memory left to save the state");
    taken->numbers[0] = it->phase;
    taken->numbers[1] = it->stale;
    taken->numbers[2] = it->time;
    taken->numbers[3] = it->stop;
    memcpy(taken->numbers + HEAD, it->v, VARIABLES * sizeof *it->v);
    if (own > 0) behaviour_save(it->behaviour, taken->numbers + HEAD + VARIABLES);
    *saved = taken;
    return FINE;
}

/* Check what was saved and make a behaviour of it; NULL with the reason in `why`. */
static Behaviour *revived(const Saved *saved, Message *why) {
    const double *n = saved->numbers, *v = n + HEAD;
    if (saved->count < HEAD + VARIABLES ||
        !(n[0] == INSTANTIATED || n[0] == INITIALIZING || n[0] == RUNNING || n[0] == TERMINATED) ||
        !isfinite(n[2]) || !(n[3] >= n[2] || n[0] != INSTANTIATED)) {
        say(why, "the saved state does not fit this component");
        return NULL;
    }
    for (size_t i = 0; i < VARIABLES; i++) {
        const Variable *variable = &model_variables[i];
        int whole = variable->kind == REAL || v[i] == floor(v[i]);
        if (!isfinite(v[i]) || !whole || v[i] < variable->minimum || v[i] > variable->maximum) {
            say(why, "the saved state does not fit this component: %s is %s", variable->name,
                shortest(v[i]).text);
            return NULL;
        }
    }
    Behaviour *b = behaviour_new();
    if (!b) {
        say(why, "there is no memory left");
        return NULL;
    }
    size_t own = saved->count - HEAD - VARIABLES;
    int set_up = n[0] == RUNNING || n[0] == TERMINATED;
    if (set_up ? behaviour_restore(b, v, v + VARIABLES, own, why)
               : own == 0 || say(why, "the saved state does not fit this component"))
        return b;
    behaviour_free(b);
    return NULL;
}

Status instance_load(Instance *it, const Saved *saved) {
    Message why;
    if (!is_saved(saved)) return instance_refuse(it, "this is no saved state");
    Behaviour *b = revived(saved, &why);
    if (!b) return instance_refuse(it, "%s", why.text);
    behaviour_free(it->behaviour);
    it->behaviour = b;
    it->phase = (Phase)saved->numbers[0];
    it->time = saved->numbers[2];
    it->stop = saved->numbers[3];
    memcpy(it->v, saved->numbers + HEAD, VARIABLES * sizeof *it->v);
    /* before a run outputs are computed when they are asked for */
    it->stale = it->phase == INITIALIZING || saved->numbers[1] != 0.0;
    it->failure.text[0] = 0;
    return FINE;
}

/* ---- bytes: a header, then the numbers as this machine holds them */

typedef struct {
    char magic[8];
    uint32_t order, version;
    uint64_t count, checksum;
    char guid[40];
} Header;

static const char MAGIC[8] = {'a', 'u', 'v', 'c', 'o', 's', 'i', 'm'};
#define ORDER UINT32_C(0x01020304)
#define VERSION 2

static uint64_t checksum(const unsigned char *bytes, size_t size) {
    uint64_t hash = UINT64_C(0xcbf29ce484222325); /* FNV-1a */
    for (size_t i = 0; i < size; i++) hash = (hash ^ bytes[i]) * UINT64_C(0x100000001b3);
    return hash;
}

Status instance_serialized_size(Instance *it, const Saved *saved, size_t *size) {
    if (!is_saved(saved)) return instance_refuse(it, "this is no saved state");
    if (!size) return instance_refuse(it, "there is no place for the size");
    *size = sizeof(Header) + saved->count * sizeof(double);
    return FINE;
}

Status instance_serialize(Instance *it, const Saved *saved, void *bytes, size_t size) {
    size_t needed = 0;
    Status status = instance_serialized_size(it, saved, &needed);
    if (status != FINE) return status;
    if (!bytes || size < needed)
        return instance_refuse(it, "the state needs %lu bytes, there is room for %lu",
                               (unsigned long)needed, (unsigned long)size);
    Header header;
    memset(&header, 0, sizeof header);
    memcpy(header.magic, MAGIC, sizeof MAGIC);
    header.order = ORDER;
    header.version = VERSION;
    header.count = saved->count;
    strncpy(header.guid, MODEL_GUID, sizeof header.guid - 1);
    unsigned char *to = bytes;
    memcpy(to + sizeof header, saved->numbers, saved->count * sizeof(double));
    header.checksum = checksum(to + sizeof header, saved->count * sizeof(double));
    memcpy(to, &header, sizeof header);
    return FINE;
}

Status instance_deserialize(Instance *it, const void *bytes, size_t size, Saved **saved) {
    Header header;
    const unsigned char *from = bytes;
    if (!saved) return instance_refuse(it, "there is no place for the saved state");
    if (!bytes || size < sizeof header)
        return instance_refuse(it, "the saved state cannot be read: it is cut short");
    memcpy(&header, from, sizeof header);
    if (memcmp(header.magic, MAGIC, sizeof MAGIC) != 0)
        return instance_refuse(it, "the saved state cannot be read: it is none of these FMUs'");
    if (header.order != ORDER || header.version != VERSION)
        return instance_refuse(it, "the saved state cannot be read: another kind of machine or "
                                   "another version wrote it");
    if (strncmp(header.guid, MODEL_GUID, sizeof header.guid) != 0)
        return instance_refuse(it, "the saved state is not one of this component: its GUID differs");
    size_t payload = size - sizeof header;
    if (header.count > payload / sizeof(double) || header.count * sizeof(double) != payload)
        return instance_refuse(it, "the saved state cannot be read: its size is wrong");
    if (header.checksum != checksum(from + sizeof header, payload))
        return instance_refuse(it, "the saved state cannot be read: it was damaged");
    Saved *read = saved_new(NULL, (size_t)header.count);
    if (!read) return instance_refuse(it, "there is no memory left for the saved state");
    memcpy(read->numbers, from + sizeof header, payload);
    *saved = read;
    return FINE;
}
