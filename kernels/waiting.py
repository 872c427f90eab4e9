"""Waiting of CPU threads for each other: they spin for a short while, and then sleep until they are woken.

Spinning lasts about as long as it takes to put a thread to sleep and to wake it, so that a wait costs at most
twice what it has to. A sleeping thread leaves its core to others, also to the thread that it waits for.
"""

import warp as wp

LINE = 8  # words between two that different threads write
ARRIVED, MEETINGS, SIZE, GATE, SLEEPERS, EVENT = (wp.constant(LINE * k) for k in range(6))
"""Words of a team: threads at the barrier, barriers passed, threads after the last one, threads that have
joined (pace.py), threads that sleep or are about to, and a count that changes when they are to wake."""
WORDS = 6 * LINE
CLOSED = 1 << 32  # is added to the gate
SPINS = 1000  # looks before a thread sleeps: some 50 microseconds


@wp.func_native("""
    double time = 0.0;
#if defined(__linux__) && !defined(__CUDA_ARCH__)
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


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return 0;
#else
    return __atomic_load_n(words.data + k, __ATOMIC_ACQUIRE);
#endif
""")
def word_at(words: wp.array(dtype=wp.int64), k: int) -> wp.int64:
    """Read a word (acquire): all that its writer wrote before is visible then."""
    ...


FUTEX = """
#if defined(__linux__) && defined(__x86_64__)
    const long futex = 202;
#elif defined(__linux__) && defined(__aarch64__)
    const long futex = 98;
#endif
#if defined(__linux__) && (defined(__x86_64__) || defined(__aarch64__))
    long call_system(long, ...) __asm__("syscall");
#endif
"""


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    if (look >= {SPINS}) {{
        __atomic_fetch_add(words.data + {int(SLEEPERS)}, 1LL, __ATOMIC_SEQ_CST);
        return __atomic_load_n((int *)(words.data + {int(EVENT)}), __ATOMIC_SEQ_CST);
    }}
#endif
    return 0;
""")
def begin_look(words: wp.array(dtype=wp.int64), look: int) -> int:
    """Begin poll number `look`. Returns the count of wake-ups so far, once the thread may sleep."""
    ...


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    {FUTEX}
    if (look >= {SPINS}) {{
#if defined(__linux__) && (defined(__x86_64__) || defined(__aarch64__))
        const long most[2] = {{0, 2000000}};  // nanoseconds
        if (!found)
            call_system(futex, words.data + {int(EVENT)}, 128 /* FUTEX_WAIT_PRIVATE */, event, most);
#elif defined(__APPLE__)
        int yield_processor(void) __asm__("sched_yield");
        yield_processor();
#endif
        __atomic_fetch_sub(words.data + {int(SLEEPERS)}, 1LL, __ATOMIC_SEQ_CST);
    }} else if (!found) {{
#if defined(__x86_64__)
        __builtin_ia32_pause();
#elif defined(__aarch64__)
        __asm__ volatile("yield");
#endif
    }}
#endif
""")
def end_look(words: wp.array(dtype=wp.int64), look: int, event: int, found: bool):
    """Spin or, after many polls, sleep until another thread wakes this one, unless the poll succeeded."""
    ...


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    {FUTEX}
    __atomic_thread_fence(__ATOMIC_SEQ_CST);
    if (__atomic_load_n(words.data + {int(SLEEPERS)}, __ATOMIC_SEQ_CST) > 0) {{
        __atomic_fetch_add((int *)(words.data + {int(EVENT)}), 1, __ATOMIC_SEQ_CST);
#if defined(__linux__) && (defined(__x86_64__) || defined(__aarch64__))
        call_system(futex, words.data + {int(EVENT)}, 129 /* FUTEX_WAKE_PRIVATE */, 0x7fffffff);
#endif
    }}
#endif
""")
def wake(words: wp.array(dtype=wp.int64)):
    """Wake the sleeping threads, after a change that any of them may wait for."""
    ...


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    return true;
#else
    return __atomic_fetch_add(words.data + {int(ARRIVED)}, 1LL, __ATOMIC_ACQ_REL) + 1 == size;
#endif
""")
def arrive(words: wp.array(dtype=wp.int64), size: int) -> bool:
    """Arrive at the barrier. Returns whether all others are there."""
    ...


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    words.data[{int(ARRIVED)}] = 0;
    words.data[{int(SIZE)}] = size;
    __atomic_fetch_add(words.data + {int(MEETINGS)}, 1LL, __ATOMIC_SEQ_CST);
#endif
""")
def let_go(words: wp.array(dtype=wp.int64), size: int):
    """Release all threads from the barrier, as a team of this size."""
    ...


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    return 0;
#else
    const long long before = __atomic_fetch_add(words.data + {int(GATE)}, 1LL, __ATOMIC_ACQ_REL);
    return before < {CLOSED}LL ? (int)before + 1 : 0;
#endif
""")
def enter_gate(words: wp.array(dtype=wp.int64)) -> int:
    """Join the team. Returns the rank, or 0 if the gate is closed."""
    ...


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    return 0;
#else
    return (int)__atomic_fetch_add(words.data + {int(GATE)}, {CLOSED}LL, __ATOMIC_ACQ_REL);
#endif
""")
def close_gate(words: wp.array(dtype=wp.int64)) -> int:
    """Let nobody else join the team. Returns how many have."""
    ...
