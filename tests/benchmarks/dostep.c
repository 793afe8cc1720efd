/* One fmi2DoStep of the native AuvPlant against a loop written by hand for it.

   The loop does what the FMU does, for the case at hand: the vehicle with its default
   parameters, one Runge-Kutta step per communication step, a cubic interpolant per step for the
   delayed speeds. Step and delay are given at run time, as they are to the FMU; the delay must
   be a multiple of the step, so that no image of a jump falls inside a step. No table of
   variables, no checks, no saved state, no way back from a step.

   dostep LIBRARY GUID STEP DELAY FORCES... STATES...

   FORCES and STATES are value references of 4 inputs and 8 outputs.

   Prints, for held and for moving inputs: seconds per step of the loop, of fmi2DoStep, of the
   fmi2SetReal before it (moving inputs only), and the largest relative difference of the final
   states. */

#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "fmi2FunctionTypes.h"

#define STEPS 20000
#define REPEATS 25
#define KEPT 16 /* more than the steps of a delay */

/* ---- by hand: Eqs. (2) and (3) with Table 1, coefficients worked out beforehand */

static double b11, b22, b24, b33, b42, b44;
static double l2Xvv, l2Xww, l4Xrr, l3Xvr, l3Yur, l3Ywr, l2Yuv, l2Yvw, l4Zrr, l3Zvr, l2Zuw, l2Zvv;
static double l4Nur, l4Nwr, l3Nuv, l3Nvw;
static const double m = 5454.0, a = 0.05;

static void coefficients(void) {
    const double rho = 500.0, L = 5.3;
    const double l2 = rho * L * L, l3 = l2 * L, l4 = l3 * L, l5 = l4 * L;
    const double m22 = m + l3 * 5.5e-2, m24 = -l4 * 1.2e-3, m44 = 13587.0 + l5 * 3.4e-3;
    const double det = m22 * m44 - m24 * m24;
    b11 = 1.0 / (m + l3 * 7.6e-3), b33 = 1.0 / (m + l3 * 2.4e-1);
    b22 = m44 / det, b24 = b42 = -m24 / det, b44 = m22 / det;
    l4Xrr = l4 * 4.0e-3, l3Xvr = l3 * 2.0e-2, l2Xvv = l2 * 5.3e-2, l2Xww = l2 * 1.7e-1;
    l3Yur = l3 * 3.0e-2, l3Ywr = l3 * -1.9e-2, l2Yuv = l2 * -1.0e-1, l2Yvw = l2 * 6.8e-2;
    l4Zrr = l4 * -7.4e-3, l3Zvr = l3 * 4.5e-2, l2Zuw = l2 * -3.0e-1, l2Zvv = l2 * -6.8e-2;
    l4Nur = l4 * -1.6e-2, l4Nwr = l4 * 7.4e-3, l3Nuv = l3 * -7.4e-3, l3Nvw = l3 * -2.7e-2;
}

static void rates(const double *x, const double *late, const double *tau, double *dx) {
    const double u = x[4], v = x[5], w = x[6], r = x[7], c = cos(x[3]), s = sin(x[3]);
    const double X = m * v * r + l4Xrr * r * r + l3Xvr * v * r + l2Xvv * v * v + l2Xww * w * w;
    const double Y = -m * u * r + l3Yur * u * r + l3Ywr * w * r + l2Yuv * u * v + l2Yvw * v * w;
    const double Z = l4Zrr * r * r + l3Zvr * v * r + l2Zuw * u * w + l2Zvv * v * v;
    const double N = l4Nur * u * r + l4Nwr * w * r + l3Nuv * u * v + l3Nvw * v * w;
    dx[0] = u * c - v * s;
    dx[1] = u * s + v * c;
    dx[2] = w;
    dx[3] = r;
    dx[4] = b11 * (X + tau[0]) - a * late[0];
    dx[5] = b22 * (Y + tau[1]) + b24 * (N + tau[3]) - a * late[1];
    dx[6] = b33 * (Z + tau[2]) - a * late[2];
    dx[7] = b42 * (Y + tau[1]) + b44 * (N + tau[3]) - a * late[3];
}

typedef struct {
    double t0, t1, x0[8], x1[8], m0[8], m1[8];
} Piece;

static Piece history[KEPT];
static long newest, found; /* steps done, and the one that was found last */

/* Speeds at time t; before the start they are zero. */
static void late_speeds(double t, double *out) {
    if (t <= 0.0) {
        memset(out, 0, 4 * sizeof *out);
        return;
    }
    while (found < newest - 1 && history[found % KEPT].t1 <= t) found++;
    const Piece *p = &history[found % KEPT];
    const double h = p->t1 - p->t0, s = (t - p->t0) / h, r = 1.0 - s;
    const double a0 = r * r * (1.0 + 2.0 * s), a1 = s * s * (3.0 - 2.0 * s);
    const double c0 = h * s * r * r, c1 = -h * s * s * r;
    for (int i = 0; i < 4; i++)
        out[i] = a0 * p->x0[4 + i] + a1 * p->x1[4 + i] + c0 * p->m0[4 + i] + c1 * p->m1[4 + i];
}

static void force(long k, int moving, double *tau) {
    const double wave = moving ? 0.01 * (double)(k % 100) - 0.5 : 0.5;
    tau[0] = 400.0 * wave, tau[1] = 300.0 * wave, tau[2] = -200.0 * wave, tau[3] = 100.0 * wave;
}

static double by_hand(int moving, double h, double d, double *x) {
    double k1[8], k2[8], k3[8], k4[8], y[8], late[4], tau[4];
    memset(x, 0, 8 * sizeof *x);
    newest = found = 0;
    const clock_t begin = clock();
    for (long k = 0; k < STEPS; k++) {
        Piece *p = &history[k % KEPT];
        const double t0 = (double)k * h, t1 = t0 + h, tm = t0 + 0.5 * h;
        force(k, moving, tau);
        if (moving || k == 0) { /* held inputs: the slope is that of the last step's end */
            late_speeds(t0 - d, late);
            rates(x, late, tau, k1);
        }
        for (int i = 0; i < 8; i++) y[i] = x[i] + 0.5 * h * k1[i];
        late_speeds(tm - d, late);
        rates(y, late, tau, k2);
        for (int i = 0; i < 8; i++) y[i] = x[i] + 0.5 * h * k2[i];
        rates(y, late, tau, k3);
        for (int i = 0; i < 8; i++) y[i] = x[i] + h * k3[i];
        late_speeds(t1 - d, late);
        rates(y, late, tau, k4);
        p->t0 = t0;
        p->t1 = t1;
        for (int i = 0; i < 8; i++) {
            p->x0[i] = x[i];
            p->m0[i] = k1[i];
            x[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
            p->x1[i] = x[i];
        }
        rates(x, late, tau, k1);
        memcpy(p->m1, k1, sizeof k1);
        newest++;
    }
    return (double)(clock() - begin) / CLOCKS_PER_SEC / STEPS;
}

/* ---- the FMU */

static void *opened;
static fmi2Component c;
static fmi2SetRealTYPE *set_real;
static fmi2GetRealTYPE *get_real;
static fmi2DoStepTYPE *do_step;
static fmi2ResetTYPE *reset;
static unsigned forces[4], states[8];

/* Seconds of fmi2SetReal alone. */
static double setting(void) {
    double tau[4];
    const clock_t begin = clock();
    for (long k = 0; k < STEPS; k++) {
        force(k, 1, tau);
        set_real(c, forces, 4, tau);
    }
    return (double)(clock() - begin) / CLOCKS_PER_SEC / STEPS;
}

static double by_fmu(int moving, double h, double *x) {
    fmi2SetupExperimentTYPE *set_up;
    fmi2EnterInitializationModeTYPE *enter, *leave;
    double tau[4];
    *(void **)&set_up = dlsym(opened, "fmi2SetupExperiment");
    *(void **)&enter = dlsym(opened, "fmi2EnterInitializationMode");
    *(void **)&leave = dlsym(opened, "fmi2ExitInitializationMode");
    reset(c);
    set_up(c, 0, 0.0, 0.0, 0, 0.0);
    enter(c);
    leave(c);
    force(0, moving, tau);
    set_real(c, forces, 4, tau);
    const clock_t begin = clock();
    for (long k = 0; k < STEPS; k++) {
        if (moving) {
            force(k, moving, tau);
            set_real(c, forces, 4, tau);
        }
        if (do_step(c, (double)k * h, h, 1) != fmi2OK) exit(1);
    }
    const double used = (double)(clock() - begin) / CLOCKS_PER_SEC / STEPS;
    if (get_real(c, states, 8, x) != fmi2OK) exit(1);
    return used;
}

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                   fmi2String category, fmi2String message, ...) {
    (void)environment, (void)name, (void)status, (void)category;
    fprintf(stderr, "%s\n", message);
}

int main(int count, char *arguments[]) {
    static const fmi2CallbackFunctions functions = {logger, calloc, free, NULL, NULL};
    fmi2InstantiateTYPE *instantiate;
    if (count != 17 || !(opened = dlopen(arguments[1], RTLD_NOW))) return 2;
    *(void **)&instantiate = dlsym(opened, "fmi2Instantiate");
    *(void **)&set_real = dlsym(opened, "fmi2SetReal");
    *(void **)&get_real = dlsym(opened, "fmi2GetReal");
    *(void **)&do_step = dlsym(opened, "fmi2DoStep");
    *(void **)&reset = dlsym(opened, "fmi2Reset");
    for (int i = 0; i < 4; i++) forces[i] = (unsigned)atoi(arguments[5 + i]);
    for (int i = 0; i < 8; i++) states[i] = (unsigned)atoi(arguments[9 + i]);
    c = instantiate("it", fmi2CoSimulation, arguments[2], "", &functions, 0, 0);
    if (!c) return 3;
    const double h = atof(arguments[3]), d = atof(arguments[4]);
    coefficients();
    for (int moving = 0; moving < 2; moving++) {
        double hand = HUGE_VAL, fmu = HUGE_VAL, set = HUGE_VAL, x[8], y[8], apart = 0.0;
        for (int i = 0; i < REPEATS; i++) { /* in turn, so that both see the same machine */
            hand = fmin(hand, by_hand(moving, h, d, x));
            fmu = fmin(fmu, by_fmu(moving, h, y));
            set = moving ? fmin(set, setting()) : 0.0;
        }
        for (int i = 0; i < 8; i++) apart = fmax(apart, fabs(x[i] - y[i]) / (1e-3 + fabs(x[i])));
        printf("%.9g %.9g %.9g %.3g\n", hand, fmu - set, set, apart);
    }
    return 0;
}
