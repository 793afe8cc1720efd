/* The sea at the present time: harmonics drawn once, evaluated in closed form. The loops of
   cosim/models/waves.py around its formulas, which are in model.c. */

#include <stdint.h>
#include <stdlib.h>

#include "arithmetic.h"
#include "behaviour.h"
#include "model.h"
#include "variable.h"

struct Behaviour {
    Harmonic harmonic[MODEL_MOST_HARMONICS];
    size_t count;
    double gain[4];
};

Behaviour *behaviour_new(void) { return calloc(1, sizeof(Behaviour)); }

void behaviour_free(Behaviour *b) { free(b); }

/* splitmix64 (Steele, Lea, Flood 2014), the upper 53 bits as a number in [0, 1). */
static double uniform(uint64_t *state) {
    uint64_t z = *state += UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    z ^= z >> 31;
    return (double)(z >> 11) * 0x1p-53;
}

static void explicit_components(Behaviour *b, const double *v) {
    b->count = 0;
    for (size_t k = 0; k < MODEL_SLOTS; k++) {
        Harmonic h = {v[model_omega[k]], v[model_amplitude[k]], v[model_phase[k]]};
        if (h.amplitude != 0.0) b->harmonic[b->count++] = h;
    }
    model_explicit_gains(v, b->gain);
}

static void draw_sea(Behaviour *b, const double *v, double peak) {
    double omega[MODEL_MOST_HARMONICS], own[MODEL_MOST_HARMONICS], phase[MODEL_MOST_HARMONICS];
    size_t count = (size_t)v[V_components], below = model_bins_below_peak[count];
    uint64_t state = (uint64_t)v[V_seed];
    double energy = 0.0;
    for (size_t k = 0; k < count; k++) {
        double bin[2], place = uniform(&state);
        phase[k] = uniform(&state);
        (k < below ? model_lower_bin : model_upper_bin)(v, (double)k, (double)below,
                                                        (double)count, place, peak, bin);
        omega[k] = bin[0];
        own[k] = bin[1];
        energy = k == 0 ? own[k] : energy + own[k];
    }
    for (size_t k = 0; k < count; k++)
        model_harmonic(v, omega[k], own[k], energy, phase[k], &b->harmonic[k]);
    b->count = count;
    model_sea_gains(v, b->gain);
}

static void prepare(Behaviour *b, const double *v) {
    if (v[V_spectrum] == SPECTRUM_JONSWAP)
        draw_sea(b, v, v[V_peak_factor]);
    else if (v[V_spectrum] == SPECTRUM_PIERSON_MOSKOWITZ)
        draw_sea(b, v, PIERSON_MOSKOWITZ_PEAK);
    else
        explicit_components(b, v);
}

static int publish(const Behaviour *b, double *v, double t, Message *why) {
    double sum[2] = {0.0, 0.0}, out[MODEL_OUTPUTS];
    for (size_t k = 0; k < b->count; k++) model_add_harmonic(t, &b->harmonic[k], sum);
    model_shares(sum, b->gain, out);
    for (size_t i = 0; i < MODEL_OUTPUTS; i++)
        if (!isfinite(out[i]))
            return say(why, "%s is not finite", model_variables[model_outputs[i]].name);
    for (size_t i = 0; i < MODEL_OUTPUTS; i++) v[model_outputs[i]] = out[i];
    return 1;
}

int behaviour_initialise(Behaviour *b, double *v, double start, Message *why) {
    prepare(b, v);
    return publish(b, v, start, why);
}

int behaviour_advance(Behaviour *b, double *v, double end, Message *why) {
    return publish(b, v, end, why);
}

int behaviour_refresh(Behaviour *b, double *v, Message *why) {
    (void)b, (void)v, (void)why; /* there are no inputs */
    return 1;
}

void behaviour_direction(const Behaviour *b, const double *v, const double *change, double *out) {
    (void)b, (void)v, (void)change, (void)out;
}

/* Everything follows from parameters and time. */

size_t behaviour_size(const Behaviour *b) {
    (void)b;
    return 0;
}

void behaviour_save(const Behaviour *b, double *to) { (void)b, (void)to; }

int behaviour_restore(Behaviour *b, const double *v, const double *from, size_t count,
                      Message *why) {
    (void)from;
    if (count != 0) return say(why, "the saved state does not fit this component");
    prepare(b, v);
    return 1;
}
