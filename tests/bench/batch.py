"""Times of batches: compared with the C reference in a loop, on two cores, and on a GPU.

All ways must give the same bits.
"""

import argparse
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from warpgrains import Batch, Scene, Simulation
from warpgrains.base.warp_start import find_device
from warpgrains.solver.threads import cores

from .against_c import COMPILER, CReference
from .flow import pile
from .rows import SPEEDUP, Row, Subject, in_turn, row, seconds

IN_C = 5  # about this many scenes also run in C
SETTLING_STEPS = 25
COURSES = (1, 60, 1_000, 10_000)  # scenes of a batch on a GPU
FALL, COURSE_STEPS = 80, 40  # steps of the course before the measurement, and per time
PILES = ((1_000, 100), (10_000, 100), (200, 1_000), (1_000, 1_000), (1, 1_000), (1, 10_000), (1, 100_000))
"""Batches of piles for a GPU: (number of scenes, grains per scene)."""
SETTLED, PILE_STEPS = 200, 10  # steps of piles before the measurement, and per time
ALONE = 25_000  # one thread is also measured up to this number of grains


def course(count: int, grains: int = 15, columns: int = 5) -> list[Scene]:
    """Return `count` copies of the course's scene, whose grains are moved by up to 1 % of a radius at random.

    The scene has `grains` grains in `columns` columns.
    """
    scene = Scene.load("annulus", [f"grains.count={grains}", f"grains.columns={columns}"])
    return [_moved(scene, seed, 0.01 * scene.radius[0]).replace(duration=8.0) for seed in range(count)]


def _moved(scene: Scene, seed: int, way: float) -> Scene:
    shift = np.random.default_rng(seed).uniform(-way, way, scene.position.shape)
    return scene.replace(position=scene.position + shift)


def piles(options: argparse.Namespace) -> Iterator[Row]:
    """Yield times of batches of piles, here and in C.

    The 100 grains of a pile settle from a lattice, in steps that are solved to 1e-6 m/s.
    """
    scene = pile(100)
    dt = 3.0 * scene.dt
    duration = dt * (options.steps or SETTLING_STEPS)
    scene = scene.replace(
        tolerance=1e-6, max_iterations=10_000, drag=0.05 * scene.drag, dt=dt, duration=duration
    )
    for count in options.scenes:
        scenes = [_moved(scene, seed, 1e-3 * scene.radius[0]) for seed in range(count)]
        yield _against_c("piles that settle", scenes, ">= 30", options.repeats)


def courses(options: argparse.Namespace) -> Iterator[Row]:
    """Yield times of batches of the course's scene: compared with C, on two cores, and with the set-up."""
    for count in options.scenes:
        scenes = course(count)
        yield _against_c("scenes of the course", scenes, ">= 6", options.repeats)
        yield from _on_two_cores(scenes, options.repeats)
        yield _overhead(scenes, options.repeats)


def _against_c(name: str, scenes: list[Scene], target: str, repeats: int) -> Row:
    """Return the time of a step of one scene, in a batch on one core, and in C.

    In C, some scenes of the batch are simulated one after the other. Both results must have the same bits.
    """
    chosen = range(0, len(scenes), max(1, len(scenes) // IN_C))
    steps_in_c = sum(scenes[k].steps for k in chosen)
    batches: list[Batch] = []
    references: list[CReference] = []

    def ours() -> float:
        batches.append(Batch(scenes, threads=1))
        return seconds(batches[-1].run) / sum(scene.steps for scene in scenes) * 1e6

    def run_all() -> None:
        for k, reference in zip(chosen, references, strict=True):
            reference.run(scenes[k].steps)

    def in_c() -> float:
        references[:] = [CReference(scenes[k]) for k in chosen]
        return seconds(run_all) / steps_in_c * 1e6

    Batch(scenes[:1], threads=1).step()  # loads the kernels
    times = in_turn(repeats, ours, in_c)
    for k, reference in zip(chosen, references, strict=True):
        assert np.array_equal(batches[-1].position(k), reference.position)
        assert np.array_equal(batches[-1].velocity(k), reference.velocity)
    subject = Subject(f"a step of {len(scenes)} {name}", scenes[0].n)
    return row(subject, times[0], "us", f"all pairs in a loop, {COMPILER}", times[1], SPEEDUP, target)


def _on_two_cores(scenes: list[Scene], repeats: int) -> Iterator[Row]:
    """Yield the time of a batch on two threads, and that of its halves as two batches at the same time.

    Both are compared with the batch on one thread.
    """

    def run(threads: int) -> float:
        batch = Batch(scenes, threads=threads)
        return seconds(batch.run) * 1e3

    def run_halves() -> float:
        halves = [Batch(scenes[first::2], threads=1) for first in range(2)]
        with ThreadPoolExecutor(2) as pool:
            return seconds(lambda: list(pool.map(Batch.run, halves))) * 1e3

    two, one, apart = in_turn(repeats, partial(run, 2), partial(run, 1), run_halves)
    subject = Subject(f"a run of {len(scenes)} scenes of the course", scenes[0].n, threads="2")
    yield row(subject, two, "ms", "1 thread", one, SPEEDUP, ">= 1.85")
    halves = Subject(f"{subject.name}, as two batches at once", subject.n, threads="1 + 1")
    yield row(halves, apart, "ms", "1 thread", one, SPEEDUP)


def _overhead(scenes: list[Scene], repeats: int) -> Row:
    """Return the time to create and run a batch, compared with the time of its kernels alone."""
    whole, kernels = [], []

    def measure() -> None:
        summaries = Batch(scenes, threads=1).run()
        kernels.append(sum(summary.seconds for summary in summaries) * 1e3)

    for _ in range(repeats):
        whole.append(seconds(measure) * 1e3)
    subject = Subject(f"making and running {len(scenes)} scenes of the course", scenes[0].n)
    return row(subject, whole, "ms", "kernels alone", kernels, target="<= 1.05")


def on_gpu(options: argparse.Namespace) -> Iterator[Row]:
    """Yield times on a GPU: of batches of the course's scene and of piles, and of single piles.

    The times are measured after some steps.
    """
    for count in options.scenes or COURSES:
        yield from _on_gpu("course", course(count, 24, 6), FALL, COURSE_STEPS, options)
    for count, n in PILES:
        if n in (options.grains or [n]):
            simulation = Simulation(pile(n), order="color")
            simulation.advance(SETTLED)
            scenes = [simulation.present_scene] * count
            yield from _on_gpu("pile", scenes, PILE_STEPS, PILE_STEPS, options)


def _on_gpu(
    what: str, scenes: Sequence[Scene], before: int, steps: int, options: argparse.Namespace
) -> Iterator[Row]:
    """Yield the time of a step of all scenes on the GPU, compared with all CPU threads.

    For few grains, also compare it with one thread. `before` steps are done first, and `steps` are timed.
    """
    n, count = scenes[0].n, len(scenes)
    threads = [cores(), *([1] if count * n <= ALONE or count == 1 else [])]
    own = Batch(scenes, device=options.device)
    others = [Batch(scenes, threads=k) for k in threads]
    for batch in (own, *others):
        batch.run(before)
    ways = [lambda batch=batch: 1e3 * seconds(partial(batch.run, steps)) / steps for batch in (own, *others)]
    times, *its = in_turn(options.repeats, *ways)
    assert all(np.array_equal(own.position(k), batch.position(k)) for batch in others for k in range(count))
    many = f"{count:,} {what}s" if count > 1 else f"one {what}"
    name = getattr(find_device(options.device), "name", options.device)
    for k, values in zip(threads, its, strict=True):
        subject = Subject(f"a step of {many}, {name}", n, scenes[0].order, "GPU")
        yield row(subject, times, "ms", f"{k} CPU threads" if k > 1 else "one CPU thread", values, SPEEDUP)
