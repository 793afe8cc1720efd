/* Philox 4x64-10 (Salmon et al., SC11) with a key from SHA-256 (FIPS 180-4) of seed, name,
   purpose and round. Everything after the 64-bit outputs is addition, multiplication, division
   and square root, which round alike everywhere; so the logarithm is written out. */

#include "draws.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "arithmetic.h"

#define MOST_TURNS 100000u

/* ---- SHA-256 */

typedef struct {
    uint32_t h[8];
    unsigned char block[64];
    size_t held;
    uint64_t bytes;
} Sha;

static const uint32_t K[64] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};

static uint32_t turned(uint32_t x, unsigned n) { return x >> n | x << (32 - n); }

static void sha_block(Sha *s) {
    uint32_t w[64], r[8];
    for (unsigned i = 0; i < 16; i++)
        w[i] = (uint32_t)s->block[4 * i] << 24 | (uint32_t)s->block[4 * i + 1] << 16 |
               (uint32_t)s->block[4 * i + 2] << 8 | s->block[4 * i + 3];
    for (unsigned i = 16; i < 64; i++)
        w[i] = w[i - 16] + (turned(w[i - 15], 7) ^ turned(w[i - 15], 18) ^ w[i - 15] >> 3) +
               w[i - 7] + (turned(w[i - 2], 17) ^ turned(w[i - 2], 19) ^ w[i - 2] >> 10);
    memcpy(r, s->h, sizeof r);
    for (unsigned i = 0; i < 64; i++) {
        uint32_t one = r[7] + (turned(r[4], 6) ^ turned(r[4], 11) ^ turned(r[4], 25)) +
                       ((r[4] & r[5]) ^ (~r[4] & r[6])) + K[i] + w[i];
        uint32_t two = (turned(r[0], 2) ^ turned(r[0], 13) ^ turned(r[0], 22)) +
                       ((r[0] & r[1]) ^ (r[0] & r[2]) ^ (r[1] & r[2]));
        memmove(r + 1, r, 7 * sizeof *r);
        r[4] += one;
        r[0] = one + two;
    }
    for (unsigned i = 0; i < 8; i++) s->h[i] += r[i];
    s->held = 0;
}

static void sha_add(Sha *s, const void *bytes, size_t count) {
    const unsigned char *from = bytes;
    for (size_t i = 0; i < count; i++) {
        s->block[s->held++] = from[i];
        if (s->held == sizeof s->block) sha_block(s);
    }
    s->bytes += count;
}

/* The first 16 bytes of the digest, as two little-endian words. */
static void sha_end(Sha *s, uint64_t key[2]) {
    static const unsigned char one = 0x80, zero = 0;
    uint64_t bits = 8 * s->bytes;
    unsigned char length[8];
    for (unsigned i = 0; i < 8; i++) length[i] = (unsigned char)(bits >> (56 - 8 * i));
    sha_add(s, &one, 1);
    while (s->held != 56) sha_add(s, &zero, 1);
    sha_add(s, length, 8);
    for (unsigned word = 0; word < 2; word++) {
        key[word] = 0;
        for (unsigned i = 0; i < 8; i++) {
            unsigned place = 8 * word + i;
            uint64_t byte = s->h[place / 4] >> (24 - 8 * (place % 4)) & 0xff;
            key[word] |= byte << 8 * i;
        }
    }
}

static void stream_key(const Source *source, const char *purpose, unsigned turn, uint64_t key[2]) {
    static const uint32_t START[8] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                      0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    char number[32];
    Sha s = {{0}, {0}, 0, 0};
    memcpy(s.h, START, sizeof START);
    /* the parts are separated by the zero that ends each string */
    sha_add(&s, "auv-cosim", sizeof "auv-cosim");
    snprintf(number, sizeof number, "%" PRIu64, source->seed);
    sha_add(&s, number, strlen(number) + 1);
    sha_add(&s, source->name, strlen(source->name) + 1);
    sha_add(&s, purpose, strlen(purpose) + 1);
    snprintf(number, sizeof number, "%u", turn);
    sha_add(&s, number, strlen(number));
    sha_end(&s, key);
}

/* ---- Philox */

static uint64_t product(uint64_t a, uint64_t b, uint64_t *high) {
    uint64_t a0 = a & 0xffffffffu, a1 = a >> 32, b0 = b & 0xffffffffu, b1 = b >> 32;
    uint64_t low = a0 * b0, middle = a1 * b0 + (low >> 32);
    uint64_t other = a0 * b1 + (middle & 0xffffffffu);
    *high = a1 * b1 + (middle >> 32) + (other >> 32);
    return a * b;
}

static uint64_t philox(const uint64_t key[2], uint64_t index) {
    uint64_t c[4] = {index / 4 + 1, 0, 0, 0}, k0 = key[0], k1 = key[1];
    for (unsigned round = 0; round < 10; round++) {
        uint64_t high0, high1;
        uint64_t low0 = product(UINT64_C(0xD2E7470EE14C6C93), c[0], &high0);
        uint64_t low1 = product(UINT64_C(0xCA5A826395121157), c[2], &high1);
        c[0] = high1 ^ c[1] ^ k0;
        c[1] = low1;
        c[2] = high0 ^ c[3] ^ k1;
        c[3] = low0;
        k0 += UINT64_C(0x9E3779B97F4A7C15);
        k1 += UINT64_C(0xBB67AE8584CAA73B);
    }
    return c[index % 4];
}

double draw_uniform(const Source *source, const char *purpose, unsigned turn, uint64_t index) {
    uint64_t key[2];
    stream_key(source, purpose, turn, key);
    return (double)(philox(key, index) >> 11) * 0x1p-53;
}

/* ---- distributions, operation by operation as in draws.py */

static double logarithm(double x) {
    int e;
    double m = frexp(x, &e), series = 0.0;
    if (m < sqrt(0.5)) {
        m = 2.0 * m;
        e--;
    }
    double s = (m - 1.0) / (m + 1.0), s2 = s * s;
    for (int k = 23; k > 0; k -= 2) series = series * s2 + 1.0 / k;
    return e * 6.93147180369123816490e-01 + (2.0 * s * series + e * 1.90821492927058770002e-10);
}

static double exponential(const Source *source, const char *purpose, const Jitter *j,
                          unsigned turn, uint64_t index) {
    return -j->mean * logarithm(1.0 - draw_uniform(source, purpose, turn, index));
}

/* Marsaglia's polar method; 0 where the pair falls outside the disc. */
static int polar(const Source *source, const char *purpose, unsigned turn, uint64_t index,
                 double *standard) {
    double a = draw_uniform(source, purpose, turn, 2 * index) * 2.0 - 1.0;
    double b = draw_uniform(source, purpose, turn, 2 * index + 1) * 2.0 - 1.0;
    double square = a * a + b * b;
    if (!(square > 0.0 && square < 1.0)) return 0;
    *standard = a * sqrt(-2.0 * logarithm(square) / square);
    return 1;
}

static double normal(const Source *source, const char *purpose, const Jitter *j, unsigned turn,
                     uint64_t index) {
    double standard;
    if (!polar(source, purpose, turn, index, &standard)) return -1.0;
    return j->mean + j->sigma * standard;
}

double draw_normal(const Source *source, const char *purpose, uint64_t index) {
    double standard;
    for (unsigned turn = 0; turn < MOST_TURNS; turn++)
        if (polar(source, purpose, turn, index, &standard)) return standard;
    return HUGE_VAL;
}

int64_t draw_jitter(const Source *source, const char *purpose, const Jitter *jitter,
                    uint64_t index) {
    if (jitter->kind == NO_JITTER) return 0;
    if (jitter->kind == UNIFORM_JITTER)
        return (int64_t)floor(draw_uniform(source, purpose, 0, index) * jitter->width);
    for (unsigned turn = 0; turn < MOST_TURNS; turn++) {
        double value = jitter->kind == EXPONENTIAL_JITTER
                           ? exponential(source, purpose, jitter, turn, index)
                           : normal(source, purpose, jitter, turn, index);
        value = rint(value);
        if (value >= 0.0 && value <= jitter->max) return (int64_t)value;
    }
    return -1;
}
