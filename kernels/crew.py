"""Workers: how the elements of a launch are shared out, whatever their number and the device.

On a CPU every OS thread launches one worker of the crew; on a GPU one launch holds them all. No result
depends on their number.
"""

import warp as wp

from .variant import OPTIONS

wp.set_module_options(OPTIONS)


@wp.struct
class Crew:
    """The thread `tid` of a launch is worker `first + tid` of `workers`."""

    first: wp.int32
    workers: wp.int32
    arrivals: wp.array(dtype=wp.int64)  # how often a worker has come to `meet`
    ended: wp.array(dtype=wp.int64)  # every eighth: a worker's passes and turns (turns.py)


@wp.func
def share(crew: Crew, tid: int, begin: int, end: int):
    """The part of [begin, end) that is this worker's: consecutive, and nearly equal for all workers."""
    worker = wp.int64(crew.first + tid)
    workers = wp.int64(crew.workers)
    count = wp.int64(end - begin)
    return begin + int(count * worker / workers), begin + int(count * (worker + wp.int64(1)) / workers)


@wp.func
def slot_of(crew: Crew, tid: int, slots: int) -> int:
    """Where this worker keeps its part of a maximum or a sum: CPU workers each have their own."""
    return (crew.first + tid) % slots


@wp.func_native("""
#if !defined(__CUDA_ARCH__)
    for (int look = 0; __atomic_load_n(counts.data + k, __ATOMIC_ACQUIRE) < least; look++) {
#if defined(__x86_64__)
        __builtin_ia32_pause();
#endif
#if defined(__linux__) || defined(__APPLE__)
        int yield_processor(void) __asm__("sched_yield");
        if (look > 1000)
            yield_processor();
#endif
    }
#endif
""")
def wait_until(counts: wp.array(dtype=wp.int64), k: int, least: wp.int64):
    """Wait until other CPU workers have counted that far; give the core away if it takes long."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return 0;
#else
    return __atomic_fetch_add(arrivals.data, 1LL, __ATOMIC_ACQ_REL);
#endif
""")
def arrive(arrivals: wp.array(dtype=wp.int64)) -> wp.int64:
    """Count an arrival. Returns how many there were before."""
    ...


@wp.func
def meet(crew: Crew):
    """Let every CPU worker see what the others have written; one worker alone does not wait.

    On a GPU workers meet at the end of a launch.
    """
    if crew.workers > 1:
        workers = wp.int64(crew.workers)
        all_here = (arrive(crew.arrivals) / workers + wp.int64(1)) * workers
        wait_until(crew.arrivals, 0, all_here)


@wp.kernel
def meet_here(crew: Crew):
    """Meet between two launches."""
    meet(crew)
