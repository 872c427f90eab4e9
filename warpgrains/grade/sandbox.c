/* The sandbox: a process that executes a homework. A request asks for one call, and the answer holds its result.
 *
 *     child SOCKET UPDATE.so CONTACT.so BYTES SECONDS
 *
 * SOCKET is a descriptor (protocol.h). The process answers one request at a time. It contains no expected result: the
 * parent compares the answers.
 *
 * A homework may only compute. Time, memory and output are limited. A filter of system calls, which cannot be removed, ends
 * the process at any other call, with an answer that names the call. The filter is installed before the homework is loaded,
 * because constructors and resolvers of symbols already run then. Afterwards the kernel opens no file. Where the loader opens
 * one, the call is trapped, and the handler returns the descriptor of a file that was opened before.
 *
 * Arrays end where accessible memory ends. The first index beyond an array crashes, and the address shows the index:
 *
 *     [page without access][marks][the array][page without access] */

#define _GNU_SOURCE

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <signal.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <unistd.h>

#ifdef __linux__
#include <sys/prctl.h>
#endif
#if defined(__linux__) && (defined(__x86_64__) || defined(__aarch64__))
#define FILTERED
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <ucontext.h>
#endif

#include "grains.h"
#include "protocol.h"

#define UPDATE "femGrainsUpdate"
#define CONTACT "femGrainsContactIterate"
#define ARRAYS 8
#define CPU_SECONDS 20 /* in all */

static int parent;
static void (*update)(femGrains *, double, double, double);
static double (*iterate)(femGrains *, double, int);

static femGrains grains;
static double *state;  /* of the request */
static double *before; /* x, y, vx, vy before the first call of femGrainsContactIterate */
static Call record[RECORDED];
static int calls;

/* Memory that is not set holds bytes 0x7f, the double 1.4e306, or 0xff, NaN: the other one in each next call. */
static unsigned char poison = 0x7f;

/* Fills the stack below the caller, where the function that is called next has its variables. */
static __attribute__((noinline)) void poisonStack(void) {
    char stack[1 << 14];
    memset(stack, poison, sizeof stack);
    __asm__ volatile("" : : "r"(stack) : "memory");
}

#ifdef __GLIBC__

void *__libc_malloc(size_t), *__libc_realloc(void *, size_t);

void *malloc(size_t bytes) {
    void *memory = __libc_malloc(bytes);
    return memory ? memset(memory, poison, bytes) : NULL;
}

void *realloc(void *old, size_t bytes) {
    size_t had = malloc_usable_size(old);
    char *memory = __libc_realloc(old, bytes);
    if (memory && bytes > had) memset(memory + had, poison, bytes - had);
    return memory;
}

#endif

static void say(const void *what, size_t bytes) {
    for (const char *next = what; bytes > 0;) {
        ssize_t written = write(parent, next, bytes);
        if (written <= 0) _exit(1);
        next += written;
        bytes -= written;
    }
}

static int hear(void *what, size_t bytes) {
    for (char *next = what; bytes > 0;) {
        ssize_t got = read(parent, next, bytes);
        if (got <= 0) return 0;
        next += got;
        bytes -= got;
    }
    return 1;
}

/* Answers with the reason why the process cannot continue, and ends it. */
static void end(int kind, int what, int where) {
    Header answer = {kind, what, where, calls, 0.0};
    say(&answer, sizeof answer);
    _exit(0);
}

static const uint64_t MARK = 0x7ff8a5a5a5a5a5a5; /* a NaN that no computation yields */

static struct {
    char *memory; /* the first page without access */
    size_t inside;
    uint64_t *first;
    size_t length;
} placed[ARRAYS];

/* Allocate arrays of these lengths. */
static void placeArrays(const size_t lengths[ARRAYS], double *arrays[ARRAYS]) {
    size_t page = sysconf(_SC_PAGESIZE);
    for (int k = 0; k < ARRAYS; k++) {
        if (!placed[k].memory || placed[k].length != lengths[k]) {
            size_t inside = (lengths[k] * sizeof(double) / page + 1) * page;
            if (placed[k].memory) munmap(placed[k].memory, placed[k].inside + 2 * page);
            char *memory =
                mmap(NULL, inside + 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
            if (memory == MAP_FAILED) end(CALLED, MEMORY, 0);
            mprotect(memory, page, PROT_NONE);
            mprotect(memory + page + inside, page, PROT_NONE);
            placed[k].memory = memory;
            placed[k].inside = inside;
            placed[k].first = (uint64_t *)(memory + page + inside) - lengths[k];
            placed[k].length = lengths[k];
        }
        for (uint64_t *mark = (uint64_t *)(placed[k].memory + page); mark < placed[k].first; mark++)
            *mark = MARK;
        arrays[k] = (double *)placed[k].first;
    }
}

/* Finds the array next to an address, and the index there. Returns -1 if there is none. */
static int findArray(const void *address, int *index) {
    size_t page = sysconf(_SC_PAGESIZE);
    for (int k = 0; k < ARRAYS; k++) {
        const char *memory = placed[k].memory, *at = address;
        if (memory && at >= memory && at < memory + placed[k].inside + 2 * page) {
            ptrdiff_t bytes = at - (const char *)placed[k].first;
            *index = (int)((bytes < 0 ? bytes - 7 : bytes) / 8);
            return k;
        }
    }
    return -1;
}

/* Finds the first array with a write before its start. Returns -1 if there is none. */
static int findWritten(int *index) {
    size_t page = sysconf(_SC_PAGESIZE);
    for (int k = 0; k < ARRAYS; k++) {
        const uint64_t *mark = (uint64_t *)(placed[k].memory + page);
        for (; mark < placed[k].first; mark++)
            if (*mark != MARK) {
                *index = (int)(mark - placed[k].first);
                return k;
            }
    }
    return -1;
}

#define PRINTED (8 << 20) /* bytes */
#define STACK (1 << 16)
#define PREPARED 2 /* files */
#define LITTLE (1 << 24) /* if so many bytes can still be allocated, memory is not what is missing */

static void limit(int what, rlim_t most) {
    struct rlimit old;
    getrlimit(what, &old);
    if (old.rlim_max < most) most = old.rlim_max;
    setrlimit(what, &(struct rlimit){most, most});
}

static int kindOfCall(long number) {
    switch (number) {
#ifdef SYS_open
        case SYS_open: case SYS_creat: case SYS_mkdir: case SYS_unlink: case SYS_rename: case SYS_rmdir:
        case SYS_chmod: case SYS_chown: case SYS_link: case SYS_symlink: case SYS_stat: case SYS_lstat:
        case SYS_access: case SYS_readlink:
#endif
        case SYS_openat: case SYS_mkdirat: case SYS_unlinkat: case SYS_renameat2: case SYS_fchmodat:
        case SYS_truncate: case SYS_linkat: case SYS_symlinkat: case SYS_newfstatat: case SYS_faccessat:
        case SYS_readlinkat: case SYS_statx:
            return FILES;
#ifdef SYS_fork
        case SYS_fork: case SYS_vfork:
#endif
        case SYS_clone: case SYS_clone3: case SYS_execve: case SYS_execveat:
            return PROCESSES;
        case SYS_socket: case SYS_socketpair: case SYS_connect: case SYS_bind:
            return NETWORK;
        case SYS_mmap: case SYS_mremap: case SYS_brk:
            return MEMORY;
        case SYS_tgkill:
            return ABORT;
        case SYS_ioctl:
            return TERMINAL;
        case SYS_nanosleep: case SYS_clock_nanosleep:
            return WAITING;
        case SYS_kill:
            return SIGNALS;
        default:
            return OTHER;
    }
}

static struct {
    const char *path;
    int file; /* < 0: none, or used already */
} prepared[PREPARED];

/* Open a file that the process may still open by this name, once, after `confine`. */
static void prepareFile(const char *path) {
    static int count;
    prepared[count].file = open(path, O_RDONLY | O_CLOEXEC);
    prepared[count++].path = path;
}

#ifdef FILTERED

#ifdef __x86_64__
#define ARGUMENT(context, k) ((context)->uc_mcontext.gregs[(const int[]){REG_RDI, REG_RSI, REG_RDX, REG_R10}[k]])
#define RESULT(context) ((context)->uc_mcontext.gregs[REG_RAX])
#else
#define ARGUMENT(context, k) ((context)->uc_mcontext.regs[k])
#define RESULT(context) ((context)->uc_mcontext.regs[0])
#endif

/* Does a trapped call that the loader or stdio needs, with a file that is open. Returns 0 for any other call. */
static int standIn(long number, ucontext_t *context) {
    const char *path = NULL;
#ifdef SYS_open
    if (number == SYS_open) path = (const char *)ARGUMENT(context, 0);
#endif
    if (number == SYS_openat) path = (const char *)ARGUMENT(context, 1);
    for (int k = 0; path && k < PREPARED; k++)
        if (prepared[k].path && prepared[k].file >= 0 && strcmp(path, prepared[k].path) == 0) {
            RESULT(context) = prepared[k].file;
            prepared[k].file = -1;
            return 1;
        }
    if (number == SYS_newfstatat && (ARGUMENT(context, 3) & AT_EMPTY_PATH) && !*(const char *)ARGUMENT(context, 1)) {
        long done = syscall(SYS_fstat, (int)ARGUMENT(context, 0), (void *)ARGUMENT(context, 2));
        RESULT(context) = done < 0 ? -errno : 0;
        return 1;
    }
    return 0;
}

#endif

static void onSignal(int number, siginfo_t *about, void *context) {
    int index;
    (void)context;
    if (number == SIGPROF) end(TOO_LONG, 0, 0);
#ifdef FILTERED
    if (number == SIGSYS && standIn(about->si_syscall, context)) return;
    if (number == SIGSYS) end(CALLED, kindOfCall(about->si_syscall), about->si_syscall);
#endif
    int array = number == SIGSEGV || number == SIGBUS ? findArray(about->si_addr, &index) : -1;
    if (array >= 0) end(OUTSIDE, array, index);
    int access = PROT_READ | PROT_WRITE;
    if (mmap(NULL, LITTLE, access, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) == MAP_FAILED) end(CALLED, MEMORY, 0);
    end(CRASHED, number, 0);
}

static void catchSignals(void) {
    static char stack[STACK];
    sigaltstack(&(stack_t){.ss_sp = stack, .ss_size = sizeof stack}, NULL);
    struct sigaction action = {.sa_sigaction = onSignal, .sa_flags = SA_SIGINFO | SA_ONSTACK};
    const int caught[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGSYS, SIGPROF};
    for (unsigned k = 0; k < sizeof caught / sizeof *caught; k++) sigaction(caught[k], &action, NULL);
}

/* Starts the CPU time of a call. */
static void startClock(double seconds) {
    struct timeval left = {(time_t)seconds, (suseconds_t)(1e6 * (seconds - (time_t)seconds))};
    setitimer(ITIMER_PROF, &(struct itimerval){.it_value = left}, NULL);
}

#ifdef FILTERED

#ifdef __x86_64__
#define MACHINE AUDIT_ARCH_X86_64
#else
#define MACHINE AUDIT_ARCH_AARCH64
#endif

#define COUNT(list) (sizeof(list) / sizeof *(list))
#define LOAD(field) BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, field))
#define LOW(k) (offsetof(struct seccomp_data, args) + 8 * (k))
#define LOAD_AT(place) BPF_STMT(BPF_LD | BPF_W | BPF_ABS, (place))
#define UNLESS(test, value, skipped) BPF_JUMP(BPF_JMP | (test) | BPF_K, (value), 0, (skipped))
#define RETURN(what) BPF_STMT(BPF_RET | BPF_K, (what))
#define ALLOW(name) UNLESS(BPF_JEQ, SYS_##name, 1), RETURN(SECCOMP_RET_ALLOW)
/* Condition of the filter: argument k of a call is less than `most`. */
#define ALLOW_BELOW(name, k, most)                                                                            \
    UNLESS(BPF_JEQ, SYS_##name, 6), LOAD_AT(LOW(k) + 4), UNLESS(BPF_JEQ, 0, 3), LOAD_AT(LOW(k)),              \
        BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, (most), 1, 0), RETURN(SECCOMP_RET_ALLOW), RETURN(SECCOMP_RET_TRAP)

static int filterCalls(size_t bytes) {
    struct sock_filter filter[] = {
        LOAD(arch),
        UNLESS(BPF_JEQ, MACHINE, 1),
        BPF_JUMP(BPF_JMP | BPF_JA, 1, 0, 0),
        RETURN(SECCOMP_RET_KILL_PROCESS),
        LOAD(nr),
        ALLOW(read), ALLOW(write), ALLOW(writev), ALLOW(close), ALLOW(lseek), ALLOW(pread64), ALLOW(fstat),
        ALLOW(exit), ALLOW(exit_group), ALLOW(rt_sigreturn), ALLOW(rt_sigprocmask),
        ALLOW(futex), ALLOW(getrandom), ALLOW(clock_gettime), ALLOW(gettimeofday), ALLOW(times),
        ALLOW(getpid), ALLOW(gettid), ALLOW(brk), ALLOW(munmap), ALLOW(mprotect), ALLOW(madvise),
        ALLOW(setitimer), ALLOW_BELOW(mmap, 1, (unsigned)bytes), ALLOW_BELOW(mremap, 2, (unsigned)bytes),
        UNLESS(BPF_JEQ, SYS_rt_sigaction, 1), RETURN(SECCOMP_RET_ERRNO | EPERM),
        RETURN(SECCOMP_RET_TRAP),
    };
    struct sock_fprog program = {COUNT(filter), filter};
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

#else

static int filterCalls(size_t bytes) {
    (void)bytes;
    return 0;
}

#endif

/* Limits time, memory and system calls from now on. Returns 0 if this system has no filter of system calls. */
static int confine(size_t bytes, int seconds) {
    limit(RLIMIT_CPU, seconds);
    limit(RLIMIT_AS, bytes);
    limit(RLIMIT_FSIZE, PRINTED);
    limit(RLIMIT_CORE, 0);
    limit(RLIMIT_NOFILE, 32);
#ifdef __linux__
    prctl(PR_SET_PDEATHSIG, SIGKILL); /* so that it ends when its parent ends */
#endif
#ifdef RLIMIT_NPROC
    limit(RLIMIT_NPROC, 0);
#endif
    catchSignals();
    return filterCalls(bytes);
}

/* The function that femGrainsUpdate calls by this name: it calls that of CONTACT.so, and records the call. */
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter) {
    if (calls == 0) {
        double *arrays[] = {grains.x, grains.y, grains.vx, grains.vy};
        for (int k = 0; k < 4; k++) memcpy(before + k * grains.n, arrays[k], grains.n * sizeof(double));
    }
    int call = calls++;
    poisonStack();
    double zeta = iterate(myGrains, dt, iter);
    if (call < RECORDED) record[call] = (Call){iter, dt, zeta};
    return zeta;
}

static void *load(const char *path) {
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) fprintf(stderr, "%s\n", dlerror());
    return library;
}

/* Returns a function that a library itself defines, or NULL. */
static void *find(void *library, const char *path, const char *name) {
    if (!library) return NULL;
    Dl_info where;
    void *function = dlsym(library, name);
    return function && dladdr(function, &where) && strcmp(where.dli_fname, path) == 0 ? function : NULL;
}

static int answerRequest(double seconds) {
    Request request;
    if (!hear(&request, sizeof request)) return 0;
    size_t n = request.n, bytes = n * sizeof(double);
    const size_t lengths[ARRAYS] = {n, n, n, n, n, n, n, n * (n - 1) / 2};
    double *arrays[ARRAYS];
    placeArrays(lengths, arrays);
    size_t all = 7 * n + lengths[ARRAYS - 1];
    state = realloc(state, all * sizeof(double));
    if (!hear(state, all * sizeof(double))) return 0;
    before = realloc(before, 4 * bytes);
    memset(before, 0, 4 * bytes);
    memset(&grains, 0, sizeof grains);
    grains.n = request.n;
    grains.radiusIn = request.radiusIn;
    grains.radiusOut = request.radiusOut;
    memcpy(grains.gravity, request.gravity, sizeof grains.gravity);
    grains.gamma = request.gamma;
    double **fields[ARRAYS] = {&grains.x, &grains.y, &grains.vx,         &grains.vy,
                               &grains.r, &grains.m, &grains.dvBoundary, &grains.dvContacts};
    for (int k = 0; k < ARRAYS; k++) *fields[k] = arrays[k];
    femGrains given;
    memcpy(&given, &grains, sizeof grains);
    Header answer = {ANSWERED, 0, 0, 0, 0.0};
    startClock(seconds);
    for (int time = 0; time < request.times; time++) {
        const double *next = state;
        for (int k = 0; k < ARRAYS; next += lengths[k++]) memcpy(arrays[k], next, lengths[k] * sizeof(double));
        calls = 0;
        poison ^= 0x80;
        poisonStack();
        if (request.iter < 0)
            update(&grains, request.dt, request.tol, request.iterMax);
        else
            answer.zeta = iterate(&grains, request.dt, request.iter);
    }
    startClock(0.0);
    fflush(stdout);
    int index, array = findWritten(&index);
    if (array >= 0) end(OUTSIDE, array, index);
    if (memcmp(&given, &grains, sizeof given) != 0) end(CHANGED, 0, 0);
    answer.calls = calls;
    say(&answer, sizeof answer);
    for (int k = 0; k < ARRAYS; k++) say(arrays[k], lengths[k] * sizeof(double));
    say(before, 4 * bytes);
    say(record, (calls < RECORDED ? calls : RECORDED) * sizeof(Call));
    return 1;
}

int main(int count, char **words) {
    if (count != 6) return 1;
    parent = atoi(words[1]);
    double seconds = atof(words[5]);
    const char *updates = words[2], *iterates = words[3];
    prepareFile(updates);
    prepareFile(iterates);
    int has = confine(strtoull(words[4], NULL, 10), CPU_SECONDS) << CONFINED;
    startClock(seconds);
    void *ofUpdate = load(updates), *ofContact = load(iterates);
    startClock(0.0);
    update = (void (*)(femGrains *, double, double, double))find(ofUpdate, updates, UPDATE);
    iterate = (double (*)(femGrains *, double, int))find(ofContact, iterates, CONTACT);
    has |= (update != NULL) << UPDATES | (iterate != NULL) << ITERATES;
    has |= (find(ofUpdate, updates, "main") || find(ofContact, iterates, "main")) << MAIN;
    has |= (strcmp(updates, iterates) != 0 && (find(ofUpdate, updates, CONTACT) || find(ofContact, iterates, UPDATE)))
           << UNGUARDED;
    Header hello = {ANSWERED, has, 0, 0, 0.0};
    say(&hello, sizeof hello);
    while (answerRequest(seconds)) {
    }
    return 0;
}
