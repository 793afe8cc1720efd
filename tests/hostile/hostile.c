/* A slave of FMI 2.0 and 3.0 that misbehaves where, when and how its parameters say.

   x' = u - decay x from x0 by Euler steps.

   The parameters `fault` and `call` count along the lists below; the fault happens in that call
   from the time `at` on, from the `nth` call of that function on, and only while |u| > beyond;
   else that call is an error where another instance has changed what belongs to the process.
   resources/hostile.txt has the values before any is set, for calls before that, and the path of
   a file of Counts, which outlives the process. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <fenv.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define BOTH_VERSIONS
#include "slave.h"

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
    ROUNDING, FLUSH_TO_ZERO, SIGNALS, THREAD, CLOSE_OUTPUT, CHILD, CHANGE_FOLDER, DELETE_RESOURCES,
    DELETE_FOLDER, SURROUNDINGS,
    /* what belongs to the program that runs it */
    DAEMON, TRACE_ME, TRUNCATE, GARBAGE, CLOSE_ALL, INTRUDE, KILL_WORKER
};

typedef struct { /* steps begun and done, gets and sets after the initialisation, and faults */
    int64_t begun, done, got, set, faults;
} Counts;
struct Model {
    Log log;
    double u, x, time, reached;
    double reals[6]; /* from AT on */
    int32_t integers[3]; /* from FAULT on */
    int64_t calls[STATE + 1];
    int number, stepping, ended;
};
enum { U, X, AT, BEYOND, SECONDS, MEGABYTES, DECAY, X0, FAULT_, CALL_, NTH };
#define REAL(m, reference) (m)->reals[(reference) - AT]
#define INTEGER(m, reference) (m)->integers[(reference) - FAULT_]

static Counts *counts; /* of all instances */
static volatile int freed;

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

/* Long lines with their numbers, and one line on the other stream. */
static void flood(int output, double megabytes) {
    char line[1024];
    dprintf(STDOUT_FILENO + STDERR_FILENO - output, "a flood begins\n");
    memset(line, '~', sizeof line);
    line[sizeof line - 1] = '\n';
    for (int i = 0; i < 1024 * megabytes; i++) {
        line[snprintf(line, sizeof line, "line %d ", i)] = '~';
        if (write(output, line, sizeof line) < 0)
            return;
    }
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
    static int done; /* a shell at every step makes a minute of a run */
    if (done++)
        return;
    Dl_info here;
    char command[4200];
    if (!dladdr((void *)delete_resources, &here) || strchr(here.dli_fname, '\''))
        return;
    snprintf(command, sizeof command, "rm -rf '%.*s/../../resources'",
             (int)(strrchr(here.dli_fname, '/') - here.dli_fname), here.dli_fname);
    if (system(command))
        return;
}

/* A process that has left everything: session, group and parent. */
static void begin_daemon(void) {
    if (fork() == 0) {
        setsid();
        if (fork() == 0) {
            alarm(120);
            for (;;) pause();
        }
        _exit(0);
    }
}

/* Do something with every descriptor but the standard streams and the file of counts. */
static void with_descriptors(int fault) {
    char garbage[4096];
    memset(garbage, 'x', sizeof garbage);
    for (int number = 3; number < 1024; number++) {
        if (fault == TRUNCATE && ftruncate(number, 0))
            continue;
        if (fault == GARBAGE && write(number, garbage, sizeof garbage) < 0)
            continue;
        if (fault == CLOSE_ALL)
            close(number);
    }
}

/* Write a number over all memory without a name that this process maps, but for its first page. */
static void intrude(void) {
    char line[4300];
    unsigned long first, last;
    FILE *maps = fopen("/proc/self/maps", "r");
    while (maps && fgets(line, sizeof line, maps))
        if (strstr(line, "memfd:") && strstr(line, "rw-s") &&
            sscanf(line, "%lx-%lx", &first, &last) == 2)
            for (double *x = (double *)(first + 4096); x < (double *)last; x++)
                *x = 123.456;
    if (maps)
        fclose(maps);
}

/* Kill the worker of a study whose run this is, but never the process that started the study. */
static void kill_worker(void) {
    char path[64], line[512] = "";
    const char *spared = getenv("SPARED");
    int worker = 0; /* between it and this process stands the keeper of this process */
    snprintf(path, sizeof path, "/proc/%d/stat", (int)getppid());
    FILE *keeper = fopen(path, "r");
    if (keeper && fgets(line, sizeof line, keeper) && strrchr(line, ')'))
        sscanf(strrchr(line, ')'), ") %*c %d", &worker);
    if (keeper)
        fclose(keeper);
    if (spared && worker > 1 && worker != atoi(spared))
        kill(worker, SIGKILL);
}

static void delete_folder(void) {
    char folder[4200];
    if (!getcwd(folder, sizeof folder) || rmdir(folder))
        return;
}

enum { FEW_FILES = 200, AN_HOUR = 3600 };

static void change_surroundings(void) {
    sigset_t blocked;
    struct rlimit files;
    struct itimerval timer = {{0, 0}, {AN_HOUR, 0}};
    sigemptyset(&blocked);
    sigaddset(&blocked, SIGUSR2);
    sigprocmask(SIG_BLOCK, &blocked, NULL);
    getrlimit(RLIMIT_NOFILE, &files);
    files.rlim_cur = FEW_FILES;
    setrlimit(RLIMIT_NOFILE, &files);
    setitimer(ITIMER_REAL, &timer, NULL);
    setenv("LEFT_BY_A_HOSTILE_FMU", "1", 1);
    umask(0777);
}

/* What of the process is not as it is at first; NULL: all is. */
static const char *changed(void) {
    char folder[4200];
    sigset_t blocked;
    struct rlimit files;
    struct itimerval timer;
    struct sigaction action;
    mode_t mask = umask(022);
    umask(mask);
    sigprocmask(SIG_BLOCK, NULL, &blocked);
    getrlimit(RLIMIT_NOFILE, &files);
    getitimer(ITIMER_REAL, &timer);
    sigaction(SIGUSR1, NULL, &action);
    return !getcwd(folder, sizeof folder) || !strcmp(folder, "/") ? "the folder is changed"
        : getenv("LEFT_BY_A_HOSTILE_FMU") ? "the environment is changed"
        : mask == 0777 ? "the umask is changed"
        : sigismember(&blocked, SIGUSR2) ? "a signal is blocked"
        : action.sa_handler != SIG_DFL ? "a signal is ignored"
        : files.rlim_cur == FEW_FILES ? "a limit is changed"
        : timer.it_value.tv_sec ? "a timer runs" : NULL;
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
    case WARNING: return say(&m->log, fmi2Warning, "the <pump> is hot");
    case DISCARD: case RETURN_EARLY:
        return say(&m->log, fmi2Discard, "the <pump> has lost its prime");
    case ERROR: return say(&m->log, fmi2Error, "the <pump> has lost its prime");
    case FATAL: return say(&m->log, fmi2Fatal, "the <pump> has lost its prime");
    case PENDING: return m->log.two ? fmi2Pending : 5;
    case UNKNOWN: return 77;
    case END: m->ended = 1; return m->log.two ? fmi2Discard : fmi3OK;
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
    case DAEMON: if (m->number != DAEMON) begin_daemon();
        m->number = DAEMON; break;
    case TRACE_ME: ptrace(PTRACE_TRACEME, 0, NULL, NULL); break;
    case TRUNCATE: case GARBAGE: case CLOSE_ALL: with_descriptors(fault); break;
    case INTRUDE: intrude(); break;
    case KILL_WORKER: kill_worker(); raise(SIGKILL); break;
    case DELETE_FOLDER: delete_folder(); break;
    case SURROUNDINGS: change_surroundings(); break;
    }
    return fmi2OK;
}

/* Every function of FMI begins with this; the status that it is to return. */
static int call(Model *m, int which) {
    m->calls[which]++;
    if (INTEGER(m, FAULT_) == NOTHING || INTEGER(m, CALL_) != which ||
        m->time < REAL(m, AT) - 1e-9 || m->calls[which] < INTEGER(m, NTH))
        return fmi2OK;
    if (fabs(m->u) <= REAL(m, BEYOND)) /* it suffers from what another one has left */
        return changed() ? say(&m->log, fmi2Error, changed()) : fmi2OK;
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

static void reset_settings(Model *m) {
    REAL(m, BEYOND) = -1.0;
    REAL(m, SECONDS) = 0.05;
    REAL(m, MEGABYTES) = 1024.0;
    INTEGER(m, NTH) = 1;
    read_settings(m);
}

__attribute__((constructor)) static void loaded(void) {
    Model before = {0};
    reset_settings(&before);
    call(&before, LOAD);
}

static int begin(Model *m, const Log *log) {
    m->log = *log;
    reset_settings(m);
    return call(m, INSTANTIATE) < fmi2Discard;
}

static int setup(Model *m, double time) {
    m->time = m->reached = time;
    return m->log.two ? call(m, SETUP) : fmi3OK; /* FMI 3.0 has no such function */
}

static int enter(Model *m) { return call(m, ENTER); }

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

static int get(Model *m) {
    if (counts && m->stepping)
        counts->got++;
    return call(m, GET);
}

static int set(Model *m) {
    if (counts && m->stepping)
        counts->set++;
    return call(m, SET);
}

static int terminate(Model *m) {
    say(&m->log, fmi2OK, "terminated");
    return call(m, TERMINATE);
}

static void end(Model *m) {
    call(m, FREE);
    say(&m->log, fmi2OK, "freed");
    freed = 1;
}

static int reset(Model *m) {
    int status = call(m, RESET);
    m->u = m->x = m->time = 0.0;
    m->stepping = m->number = m->ended = 0;
    reset_settings(m);
    return status;
}

static int save(Model *m) { return call(m, STATE); }

static const Behaviour behaviour = {
    sizeof(Model),
    .begin = begin, .setup = setup, .enter = enter, .leave = leave, .step = step,
    .terminate = terminate, .reset = reset, .save = save, .end = end,
};

/* --- the functions of FMI */

#define VALUES(V, Reals, Integers)                                                                 \
    GETTER(V, Reals, get(m),                                                                       \
        reference == U ? m->u : reference == X ? output(m) : REAL(m, reference))                   \
    SETTER(V, Reals, set(m), *(reference == U ? &m->u : &REAL(m, reference)))                      \
    GETTER(V, Integers, V##OK, INTEGER(m, reference))                                              \
    SETTER(V, Integers, V##OK, INTEGER(m, reference))
VALUES(fmi2, Real, Integer)
VALUES(fmi3, Float64, Int64)
STATE_FUNCTIONS(fmi2, FMUstate, DeSerialize)
STATE_FUNCTIONS(fmi3, FMUState, Deserialize)

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    *value = ((Model *)c)->ended;
    return kind == fmi2Terminated ? fmi2OK : fmi2Error;
}
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    *value = ((Model *)c)->reached;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Error;
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
/* --- what nobody needs; some importers look every function up */

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
