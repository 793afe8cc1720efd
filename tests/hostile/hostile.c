/* A slave of FMI 2.0 and 3.0 that misbehaves where, when and how its parameters say.

   x' = u - decay x from x0 by Euler steps.

   The parameters `fault` and `call` count along the lists below; the fault happens in that call
   from the time `at` on, from the `nth` call of that function on, and only while |u| > beyond.
   resources/hostile.txt has the values before any is set, for calls before that, and the path of
   a file of Counts, which outlives the process. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <fenv.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "fmi2Functions.h"
#include "fmi3Functions.h"

enum { /* calls */
    LOAD, INSTANTIATE, SETUP, ENTER, EXIT, SET, GET, STEP, TERMINATE, FREE, RESET, STATE
};
enum { /* faults */
    NOTHING,
    /* the process ends */
    SEGFAULT, ABORT, KILL, EXIT_0, EXIT_3, STACK_OVERFLOW, DOUBLE_FREE,
    /* the call does not end, or late */
    HANG, HANG_DEAF, SLEEP,
    /* memory and output */
    LEAK, LEAK_SLOWLY, FLOOD_STDOUT, FLOOD_STDERR, PRINT,
    /* numbers */
    NOT_A_NUMBER, INFINITE, GROW, HUGE_CONSTANT,
    /* statuses */
    NEGATIVE, WARNING, DISCARD, ERROR, FATAL, PENDING, UNKNOWN, RETURN_EARLY, END,
    /* what belongs to the process */
    ROUNDING, FLUSH_TO_ZERO, SIGNALS, THREAD, CLOSE_OUTPUT, CHILD, CHANGE_FOLDER, DELETE_RESOURCES
};

typedef struct { /* steps begun and done, gets and sets after the initialisation, and faults */
    int64_t begun, done, got, set, faults;
} Counts;
typedef struct {
    const fmi2CallbackFunctions *two;
    fmi3LogMessageCallback three;
    void *environment;
    char name[200];
    double u, x, time, reached;
    double reals[6]; /* from AT on */
    int32_t integers[3]; /* from FAULT on */
    int64_t calls[STATE + 1];
    int number, stepping, ended;
} Model;
enum { U, X, AT, BEYOND, SECONDS, MEGABYTES, DECAY, X0, FAULT_, CALL_, NTH };
#define REAL(m, reference) (m)->reals[(reference) - AT]
#define INTEGER(m, reference) (m)->integers[(reference) - FAULT_]

static Counts *counts; /* of all instances */
static volatile int freed;

static int say(Model *m, int status, const char *text) {
    if (m->three)
        m->three(m->environment, (fmi3Status)status, "logAll", text);
    else if (m->two)
        m->two->logger(m->two->componentEnvironment, m->name, (fmi2Status)status, "logAll", "%s",
                       text);
    return status;
}

/* --- the faults */

static volatile int deep;
__attribute__((noinline)) static int overflow(int depth) {
    volatile char frame[4096];
    frame[0] = (char)depth;
    return deep == 0 ? overflow(depth + 1) + frame[0] : 0;
}

static void leak(double megabytes) {
    static double leaked;
    for (char *block; leaked < megabytes && (block = malloc(1 << 20)); leaked++)
        memset(block, 1, 1 << 20);
}

static void flood(int output, double megabytes) {
    char line[1024];
    memset(line, '~', sizeof line);
    line[sizeof line - 1] = '\n';
    for (int i = 0; i < 1024 * megabytes; i++)
        if (write(output, line, sizeof line) < 0)
            return;
}

static void wait_for(double seconds) {
    struct timespec left = {(time_t)seconds, (long)(1e9 * (seconds - floor(seconds)))};
    while (nanosleep(&left, &left)) {
    }
}

static void *write_after_the_end(void *memory) {
    for (;; usleep(100))
        if (freed)
            ((Model *)memory)->x += 1.0;
    return NULL;
}

static void flush_to_zero(void) {
#if defined(__x86_64__)
    __builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() | 0x8040);
#elif defined(__aarch64__)
    uint64_t mode;
    __asm__ volatile("mrs %0, fpcr" : "=r"(mode));
    __asm__ volatile("msr fpcr, %0" : : "r"(mode | 1 << 24));
#endif
}

static void ignore_signals(void) {
    const int numbers[] = {SIGINT, SIGTERM, SIGHUP, SIGALRM, SIGCHLD, SIGUSR1, SIGUSR2, SIGSEGV};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        signal(numbers[i], SIG_IGN);
}

static void delete_resources(void) {
    Dl_info here;
    char command[4200];
    if (!dladdr((void *)delete_resources, &here) || strchr(here.dli_fname, '\''))
        return;
    snprintf(command, sizeof command, "rm -rf '%.*s/../../resources'",
             (int)(strrchr(here.dli_fname, '/') - here.dli_fname), here.dli_fname);
    if (system(command))
        return;
}

static void die(int signal_number) {
    signal(signal_number, SIG_DFL);
    raise(signal_number);
}

/* Does what is asked for; the status that the call returns. */
static int misbehave(Model *m, int fault) {
    static volatile int *nowhere;
    static char *volatile twice;
    pthread_t thread;
    if (counts)
        counts->faults++;
    switch (fault) {
    case SEGFAULT: signal(SIGSEGV, SIG_DFL); *nowhere = 1; break;
    case ABORT: die(SIGABRT); break;
    case KILL: raise(SIGKILL); break;
    case EXIT_0: exit(0);
    case EXIT_3: exit(3);
    case STACK_OVERFLOW: overflow(0); break;
    case DOUBLE_FREE: twice = malloc(5000), free(twice), free(twice); break;
    case HANG_DEAF: ignore_signals(); /* fall through */
    case HANG: for (volatile int on = 1; on;) {} break;
    case SLEEP: wait_for(REAL(m, SECONDS)); break;
    case LEAK: leak(REAL(m, MEGABYTES)); break;
    case LEAK_SLOWLY: leak(fmin(16.0 * (double)m->calls[INTEGER(m, CALL_)], REAL(m, MEGABYTES)));
        break;
    case FLOOD_STDOUT: flood(STDOUT_FILENO, 1.0); break;
    case FLOOD_STDERR: flood(STDERR_FILENO, 1.0); break;
    case PRINT: if (m->number != PRINT) printf("a line that the FMU prints\n"); /* fall through */
    case NOT_A_NUMBER: case INFINITE: case GROW: case HUGE_CONSTANT: m->number = fault; break;
    case NEGATIVE: return -1;
    case WARNING: return say(m, fmi2Warning, "the <pump> is hot");
    case DISCARD: case RETURN_EARLY:
        return say(m, fmi2Discard, "the <pump> has lost its prime");
    case ERROR: return say(m, fmi2Error, "the <pump> has lost its prime");
    case FATAL: return say(m, fmi2Fatal, "the <pump> has lost its prime");
    case PENDING: return m->two ? fmi2Pending : 5;
    case UNKNOWN: return 77;
    case END: m->ended = 1; return m->two ? fmi2Discard : fmi3OK;
    case ROUNDING: fesetround(FE_UPWARD); break;
    case FLUSH_TO_ZERO: flush_to_zero(); break;
    case SIGNALS: ignore_signals(); break;
    case THREAD: if (m->number != THREAD) pthread_create(&thread, NULL, write_after_the_end, m);
        m->number = THREAD; break;
    case CLOSE_OUTPUT: close(STDOUT_FILENO), close(STDERR_FILENO); break;
    case CHILD:
        if (m->number != CHILD && fork() == 0) {
            alarm(120);
            for (;;) pause();
        }
        m->number = CHILD; break;
    case CHANGE_FOLDER: if (chdir("/")) return fmi2Error; break;
    case DELETE_RESOURCES: delete_resources(); break;
    }
    return fmi2OK;
}

/* Every function of FMI begins with this; the status that it is to return. */
static int call(Model *m, int which) {
    m->calls[which]++;
    if (INTEGER(m, FAULT_) == NOTHING || INTEGER(m, CALL_) != which ||
        m->time < REAL(m, AT) - 1e-9 || m->calls[which] < INTEGER(m, NTH) ||
        fabs(m->u) <= REAL(m, BEYOND))
        return fmi2OK;
    return misbehave(m, INTEGER(m, FAULT_));
}

/* --- the model */

static void read_settings(Model *m) {
    Dl_info here;
    char path[4200], shared[4200] = "";
    if (!dladdr((void *)read_settings, &here))
        return;
    snprintf(path, sizeof path, "%.*s/../../resources/hostile.txt",
             (int)(strrchr(here.dli_fname, '/') - here.dli_fname), here.dli_fname);
    FILE *file = fopen(path, "r");
    if (file == NULL)
        return;
    if (fscanf(file, "%d %d %lf %d %4100[^\n]", &INTEGER(m, FAULT_), &INTEGER(m, CALL_),
               &REAL(m, AT), &INTEGER(m, NTH), shared) == 5) {
        int opened = open(shared, O_RDWR);
        void *memory = opened < 0 ? MAP_FAILED : mmap(NULL, sizeof(Counts), PROT_READ | PROT_WRITE,
                                                      MAP_SHARED, opened, 0);
        if (memory != MAP_FAILED)
            counts = memory;
        close(opened);
    }
    fclose(file);
}

static void start(Model *m) {
    REAL(m, BEYOND) = -1.0;
    REAL(m, SECONDS) = 0.05;
    REAL(m, MEGABYTES) = 1024.0;
    INTEGER(m, NTH) = 1;
    read_settings(m);
}

__attribute__((constructor)) static void loaded(void) {
    Model before = {0};
    start(&before);
    call(&before, LOAD);
}

static Model *instantiate(const char *name, const fmi2CallbackFunctions *two,
                          fmi3LogMessageCallback three, void *environment) {
    Model *m = calloc(1, sizeof(Model));
    snprintf(m->name, sizeof m->name, "%s", name);
    m->two = two;
    m->three = three;
    m->environment = environment;
    start(m);
    if (call(m, INSTANTIATE) >= fmi2Discard) {
        free(m);
        return NULL;
    }
    return m;
}

static int enter(Model *m, double time) {
    m->time = m->reached = time;
    return call(m, ENTER);
}

static int leave(Model *m) {
    m->x = REAL(m, X0);
    m->stepping = 1;
    return call(m, EXIT);
}

static int step(Model *m, double t, double h) {
    m->time = t;
    if (counts)
        counts->begun++;
    int status = call(m, STEP);
    m->reached = status == fmi2OK || status == fmi2Warning ? t + h : t + h / 2;
    if (m->reached < t + h)
        return status;
    m->x += h * (m->u - REAL(m, DECAY) * m->x);
    if (m->number == GROW)
        m->x = 1e10 * fmax(fabs(m->x), 1.0);
    m->time = t + h;
    if (counts)
        counts->done++;
    return status;
}

static double output(const Model *m) {
    switch (m->number) {
    case NOT_A_NUMBER: return NAN;
    case INFINITE: return INFINITY;
    case HUGE_CONSTANT: return 1.5e6;
    default: return m->x;
    }
}

static int get_reals(Model *m, const unsigned v[], size_t n, double value[]) {
    if (counts && m->stepping)
        counts->got++;
    int status = call(m, GET);
    for (size_t i = 0; i < n; i++)
        value[i] = v[i] == U ? m->u : v[i] == X ? output(m) : REAL(m, v[i]);
    return status;
}

static int set_reals(Model *m, const unsigned v[], size_t n, const double value[]) {
    if (counts && m->stepping)
        counts->set++;
    for (size_t i = 0; i < n; i++)
        *(v[i] == U ? &m->u : &REAL(m, v[i])) = value[i];
    return call(m, SET);
}

static int terminate(Model *m) {
    say(m, fmi2OK, "terminated");
    return call(m, TERMINATE);
}

static void end(Model *m) {
    call(m, FREE);
    say(m, fmi2OK, "freed");
    free(m);
    freed = 1;
}

static int reset(Model *m) {
    int status = call(m, RESET);
    m->u = m->x = m->time = 0.0;
    m->stepping = m->number = m->ended = 0;
    start(m);
    return status;
}

static int save(Model *m, void **state) {
    int status = call(m, STATE);
    *state = memcpy(*state ? *state : malloc(sizeof(Model)), m, sizeof(Model));
    return status;
}

/* --- FMI 2.0 */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String where,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                              fmi2Boolean logging) {
    (void)type, (void)guid, (void)where, (void)visible, (void)logging;
    return instantiate(name, callbacks, NULL, NULL);
}
void fmi2FreeInstance(fmi2Component c) { end(c); }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String k[]) {
    return (void)c, (void)on, (void)n, (void)k, fmi2OK;
}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real time,
                               fmi2Boolean s, fmi2Real stop) {
    (void)t, (void)tolerance, (void)s, (void)stop;
    ((Model *)c)->time = time;
    return (fmi2Status)call(c, SETUP);
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return (fmi2Status)enter(c, ((Model *)c)->time);
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return (fmi2Status)leave(c); }
fmi2Status fmi2Terminate(fmi2Component c) { return (fmi2Status)terminate(c); }
fmi2Status fmi2Reset(fmi2Component c) { return (fmi2Status)reset(c); }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2Real x[]) {
    return (fmi2Status)get_reals(c, v, n, x);
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference v[], size_t n,
                       const fmi2Real x[]) {
    return (fmi2Status)set_reals(c, v, n, x);
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2Integer x[]) {
    for (size_t i = 0; i < n; i++) x[i] = INTEGER((Model *)c, v[i]);
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference v[], size_t n,
                          const fmi2Integer x[]) {
    for (size_t i = 0; i < n; i++) INTEGER((Model *)c, v[i]) = x[i];
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean keep) {
    return (void)keep, (fmi2Status)step(c, t, h);
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    *value = ((Model *)c)->ended;
    return kind == fmi2Terminated ? fmi2OK : fmi2Error;
}
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    *value = ((Model *)c)->reached;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Error;
}
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return (fmi2Status)save(c, state);
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    return memcpy(c, state, sizeof(Model)), fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return (void)c, free(*state), *state = NULL, fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    return (void)c, (void)state, *size = sizeof(Model), fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t n) {
    return (void)c, memcpy(bytes, state, n), fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t n,
                                   fmi2FMUstate *state) {
    return (void)c, *state = memcpy(malloc(n), bytes, n), fmi2OK;
}

/* --- FMI 3.0 */

const char *fmi3GetVersion(void) { return fmi3Version; }
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String where,
                                         fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference needed[], size_t n,
                                         fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update) {
    (void)token, (void)where, (void)visible, (void)logging, (void)events, (void)early;
    (void)needed, (void)n, (void)update;
    return instantiate(name, NULL, logger, environment);
}
void fmi3FreeInstance(fmi3Instance c) { end(c); }
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String k[]) {
    return (void)c, (void)on, (void)n, (void)k, fmi3OK;
}
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean t, fmi3Float64 tolerance,
                                       fmi3Float64 time, fmi3Boolean s, fmi3Float64 stop) {
    return (void)t, (void)tolerance, (void)s, (void)stop, (fmi3Status)enter(c, time);
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return (fmi3Status)leave(c); }
fmi3Status fmi3Terminate(fmi3Instance c) { return (fmi3Status)terminate(c); }
fmi3Status fmi3Reset(fmi3Instance c) { return (fmi3Status)reset(c); }
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference v[], size_t n, fmi3Float64 x[],
                          size_t m) {
    return (void)m, (fmi3Status)get_reals(c, v, n, x);
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference v[], size_t n,
                          const fmi3Float64 x[], size_t m) {
    return (void)m, (fmi3Status)set_reals(c, v, n, x);
}
fmi3Status fmi3GetInt64(fmi3Instance c, const fmi3ValueReference v[], size_t n, fmi3Int64 x[],
                        size_t m) {
    for (size_t i = 0; i < n; i++) x[i] = INTEGER((Model *)c, v[i]);
    return (void)m, fmi3OK;
}
fmi3Status fmi3SetInt64(fmi3Instance c, const fmi3ValueReference v[], size_t n,
                        const fmi3Int64 x[], size_t m) {
    for (size_t i = 0; i < n; i++) INTEGER((Model *)c, v[i]) = (int32_t)x[i];
    return (void)m, fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean keep,
                      fmi3Boolean *event, fmi3Boolean *ended, fmi3Boolean *early,
                      fmi3Float64 *reached) {
    Model *m = c;
    int status = step(m, t, h);
    int early_return = status == fmi3Discard && INTEGER(m, FAULT_) == RETURN_EARLY;
    (void)keep;
    *event = false;
    *ended = m->ended;
    *early = early_return;
    *reached = m->reached;
    return early_return ? fmi3OK : (fmi3Status)status;
}
fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
    return (fmi3Status)save(c, state);
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
    return memcpy(c, state, sizeof(Model)), fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    return (void)c, free(*state), *state = NULL, fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    return (void)c, (void)state, *size = sizeof(Model), fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t n) {
    return (void)c, memcpy(bytes, state, n), fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t n,
                                   fmi3FMUState *state) {
    return (void)c, *state = memcpy(malloc(n), bytes, n), fmi3OK;
}

/* --- what nobody needs; some importers look every function up */

__attribute__((used)) static fmi2Status refused(void) { return fmi2Error; }
#define REFUSED(name) __asm__(".globl " #name "\n.set " #name ", refused");
REFUSED(fmi2CancelStep) REFUSED(fmi2GetBoolean) REFUSED(fmi2GetDirectionalDerivative)
REFUSED(fmi2GetIntegerStatus) REFUSED(fmi2GetRealOutputDerivatives) REFUSED(fmi2GetStatus)
REFUSED(fmi2GetString) REFUSED(fmi2GetStringStatus) REFUSED(fmi2SetBoolean)
REFUSED(fmi2SetRealInputDerivatives) REFUSED(fmi2SetString) REFUSED(fmi3ActivateModelPartition)
REFUSED(fmi3CompletedIntegratorStep) REFUSED(fmi3EnterConfigurationMode)
REFUSED(fmi3EnterContinuousTimeMode) REFUSED(fmi3EnterEventMode) REFUSED(fmi3EnterStepMode)
REFUSED(fmi3EvaluateDiscreteStates) REFUSED(fmi3ExitConfigurationMode)
REFUSED(fmi3GetAdjointDerivative) REFUSED(fmi3GetBinary) REFUSED(fmi3GetBoolean)
REFUSED(fmi3GetClock) REFUSED(fmi3GetContinuousStateDerivatives) REFUSED(fmi3GetContinuousStates)
REFUSED(fmi3GetDirectionalDerivative) REFUSED(fmi3GetEventIndicators) REFUSED(fmi3GetFloat32)
REFUSED(fmi3GetInt16) REFUSED(fmi3GetInt32) REFUSED(fmi3GetInt8) REFUSED(fmi3GetIntervalDecimal)
REFUSED(fmi3GetIntervalFraction) REFUSED(fmi3GetNominalsOfContinuousStates)
REFUSED(fmi3GetNumberOfContinuousStates) REFUSED(fmi3GetNumberOfEventIndicators)
REFUSED(fmi3GetNumberOfVariableDependencies) REFUSED(fmi3GetOutputDerivatives)
REFUSED(fmi3GetShiftDecimal) REFUSED(fmi3GetShiftFraction) REFUSED(fmi3GetString)
REFUSED(fmi3GetUInt16) REFUSED(fmi3GetUInt32) REFUSED(fmi3GetUInt64) REFUSED(fmi3GetUInt8)
REFUSED(fmi3GetVariableDependencies) REFUSED(fmi3InstantiateModelExchange)
REFUSED(fmi3InstantiateScheduledExecution) REFUSED(fmi3SetBinary) REFUSED(fmi3SetBoolean)
REFUSED(fmi3SetClock) REFUSED(fmi3SetContinuousStates) REFUSED(fmi3SetFloat32)
REFUSED(fmi3SetInt16) REFUSED(fmi3SetInt32) REFUSED(fmi3SetInt8) REFUSED(fmi3SetIntervalDecimal)
REFUSED(fmi3SetIntervalFraction) REFUSED(fmi3SetShiftDecimal) REFUSED(fmi3SetShiftFraction)
REFUSED(fmi3SetString) REFUSED(fmi3SetTime) REFUSED(fmi3SetUInt16) REFUSED(fmi3SetUInt32)
REFUSED(fmi3SetUInt64) REFUSED(fmi3SetUInt8) REFUSED(fmi3UpdateDiscreteStates)
