"""The barrier at which the threads of a team wait for each other after every stage.

On a GPU it is the barrier of a block. On a CPU, a thread that arrives adds 1 to ARRIVED. The last thread
resets ARRIVED to 0 and adds 1 to GENERATION, for which the other threads wait. They spin for about 50
microseconds, and then sleep. The core of a sleeping thread is free for other threads, such as those that have
not arrived. If threads yielded their cores while they spin, they would lose whole time slices to a busy
program: a team of two took 70 to 90 times as long as one thread.
"""

import warp as wp

from .threads import WORDS, Team

ARRIVED, GENERATION, SLEEPERS = 0, WORDS // 3, 2 * WORDS // 3  # indices in `words`, each in its cache line
SPINS = 1_000  # number of polls of GENERATION before a thread sleeps


@wp.func_native("""
    double time = 0.0;
#if defined(__CUDA_ARCH__)
    unsigned long long now;
    asm volatile("mov.u64 %0, %globaltimer;" : "=l"(now));
    time = 1e-9 * double(now);
#elif defined(__linux__)
    long long now[2];
    int read_clock(int, long long *) __asm__("clock_gettime");
    read_clock(1, now);
    time = double(now[0]) + 1e-9 * double(now[1]);
#endif
    return time;
""")
def seconds() -> wp.float64:
    """Return the time of a monotonic clock [s]; 0 on systems without one."""
    ...


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#else
    long long *arrived = words.data + {ARRIVED}, *sleepers = words.data + {SLEEPERS};
    int *generation = (int *)(words.data + {GENERATION});
    const int before = __atomic_load_n(generation, __ATOMIC_ACQUIRE);
#if defined(__linux__) && (defined(__x86_64__) || defined(__aarch64__))
    long call_system(long, ...) __asm__("syscall");
#if defined(__x86_64__)
    const long futex = 202;
#else
    const long futex = 98;
#endif
    const auto sleep = [&] {{ call_system(futex, generation, 128 /* FUTEX_WAIT_PRIVATE */, before, 0L); }};
    const auto wake = [&] {{ call_system(futex, generation, 129 /* FUTEX_WAKE_PRIVATE */, 0x7fffffff); }};
#else
    int yield_processor(void) __asm__("sched_yield");
    const auto sleep = [&] {{ yield_processor(); }};
    const auto wake = [&] {{}};
#endif
    if (__atomic_add_fetch(arrived, 1LL, __ATOMIC_ACQ_REL) == size) {{
        *arrived = 0;
        __atomic_store_n(generation, before + 1, __ATOMIC_SEQ_CST);
        if (__atomic_load_n(sleepers, __ATOMIC_SEQ_CST) > 0)
            wake();
        return;
    }}
    for (int poll = 0; poll < {SPINS}; poll++) {{
        if (__atomic_load_n(generation, __ATOMIC_ACQUIRE) != before)
            return;
#if defined(__x86_64__)
        __builtin_ia32_pause();
#elif defined(__aarch64__)
        __asm__ volatile("yield");
#endif
    }}
    __atomic_fetch_add(sleepers, 1LL, __ATOMIC_SEQ_CST);
    while (__atomic_load_n(generation, __ATOMIC_SEQ_CST) == before)
        sleep();
    __atomic_fetch_sub(sleepers, 1LL, __ATOMIC_SEQ_CST);
#endif
""")
def meet(words: wp.array(dtype=wp.int64), size: int):
    """Wait until all `size` threads of a team have arrived.

    What each thread has written before is then visible to all of them. `words` is the state of the barrier
    that CPU threads share (`TeamRecord.words`).
    """
    ...


@wp.func
def barrier(team: Team):
    """Wait for the other threads of the team."""
    if team.size > 1:
        meet(team.words, team.size)
