/* What a homework may do: compute. Limits of time, memory and output, and a list of system calls that are let
 * through; any other ends the process with an answer that names it. A filter cannot be taken off again.
 *
 * The filter stands before a homework is loaded, since its constructors and the resolvers of its symbols run then.
 * The kernel opens no file from there on: an open that the loader asks for is trapped, and the handler returns
 * the descriptor of a file that was opened before. */

#define _GNU_SOURCE

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <unistd.h>

#include "child.h"

#ifdef __linux__
#include <sys/prctl.h>
#endif
#if defined(__linux__) && (defined(__x86_64__) || defined(__aarch64__))
#define FILTERED
#include <ucontext.h>
#endif

#define PRINTED (1 << 20) /* bytes */
#define STACK (1 << 16)
#define PREPARED 2 /* files */
#define LITTLE (1 << 24) /* bytes that can be had where it is not memory that is missing */

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
    int file; /* below 0: none, or no longer */
} prepared[PREPARED];

void prepareFile(const char *path) {
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

/* Carry out a trapped call that the loader or stdio needs, on a file that is open; 0: it is another call. */
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

void startClock(double seconds) {
    struct timeval left = {(time_t)seconds, (suseconds_t)(1e6 * (seconds - (time_t)seconds))};
    setitimer(ITIMER_PROF, &(struct itimerval){.it_value = left}, NULL);
}

#ifdef FILTERED

#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>

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
/* Argument k of a call is below `most`. */
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

int confine(size_t bytes, int seconds) {
    limit(RLIMIT_CPU, seconds);
    limit(RLIMIT_AS, bytes);
    limit(RLIMIT_FSIZE, PRINTED);
    limit(RLIMIT_CORE, 0);
    limit(RLIMIT_NOFILE, 32);
#ifdef __linux__
    prctl(PR_SET_PDEATHSIG, SIGKILL); /* so that it ends with the process that asks, however that ends */
#endif
#ifdef RLIMIT_NPROC
    limit(RLIMIT_NPROC, 0);
#endif
    catchSignals();
    return filterCalls(bytes);
}
