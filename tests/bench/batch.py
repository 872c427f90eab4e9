"""Measure how fast a batch is, beside the C reference in a loop, and how its cost is made up, as CSV.

python -m tests.bench.batch -o tests/bench/results/batch.csv
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from warpgrains import Batch, Scene

from .against_c import COMPILER, CReference
from .piles import pile
from .rows import SPEEDUP, Subject, command_line, in_turn, publish, row, seconds

SCENES = 300
IN_C = 5  # scenes that are run in C, too
PILE_STEPS = 25


def course(count: int, grains: int = 15, columns: int = 5) -> list[Scene]:
    """The course's scene, its grains moved a little at random, each time by other numbers."""
    scene = Scene.load("annulus", [f"grains.count={grains}", f"grains.columns={columns}"])
    return [_moved(scene, seed, 0.01 * scene.radius[0]).replace(duration=8.0) for seed in range(count)]


def piles(count: int) -> list[Scene]:
    """Piles of 100 grains that settle from a lattice, to the tolerance of the course's scene."""
    scene = pile(100)
    scene = scene.replace(
        tolerance=1e-6,
        max_iterations=10_000,
        drag=0.05 * scene.drag,
        dt=3.0 * scene.dt,
        duration=3.0 * scene.dt * PILE_STEPS,
    )
    return [_moved(scene, seed, 1e-3 * scene.radius[0]) for seed in range(count)]


def _moved(scene: Scene, seed: int, way: float) -> Scene:
    shift = np.random.default_rng(seed).uniform(-way, way, scene.position.shape)
    return scene.replace(position=scene.position + shift)


def against_c(name: str, scenes: list[Scene], target: str, repeats: int) -> Iterator[dict[str, str]]:
    """A batch on one core against C, where some of its scenes run one after the other, to the same bits."""
    chosen = range(0, len(scenes), max(1, len(scenes) // IN_C))
    batches: list[Batch] = []
    references: list[CReference] = []

    def ours() -> float:
        batches.append(Batch(scenes, threads=1))
        return seconds(batches[-1].run) / _steps(scenes) * 1e6

    def in_c() -> float:
        references[:] = [CReference(scenes[k]) for k in chosen]
        loop = partial(_run_all, references, [scenes[k].steps for k in chosen])
        return seconds(loop) / _steps([scenes[k] for k in chosen]) * 1e6

    Batch(scenes[:1], threads=1).step()  # once, so that the kernels are loaded
    times = in_turn(repeats, ours, in_c)
    for k, reference in zip(chosen, references, strict=True):
        assert np.array_equal(batches[-1].position(k), reference.position)
        assert np.array_equal(batches[-1].velocity(k), reference.velocity)
    subject = Subject(f"a step of {len(scenes)} {name}", scenes[0].n)
    yield row(subject, times[0], "us", f"all pairs in a loop, {COMPILER}", times[1], SPEEDUP, target)


def _run_all(references: list[CReference], steps: list[int]) -> None:
    for reference, count in zip(references, steps, strict=True):
        reference.run(count)


def _steps(scenes: list[Scene]) -> int:
    return sum(scene.steps for scene in scenes)


def cores(scenes: list[Scene], repeats: int) -> Iterator[dict[str, str]]:
    """The same batch on two threads, and on one; beside it two that share nothing, at once."""

    def run(threads: int) -> float:
        batch = Batch(scenes, threads=threads)
        return seconds(batch.run) * 1e3

    def run_halves() -> float:
        halves = [Batch(scenes[first::2], threads=1) for first in range(2)]
        with ThreadPoolExecutor(2) as pool:
            return seconds(lambda: list(pool.map(Batch.run, halves))) * 1e3

    two, one, apart = in_turn(repeats, partial(run, 2), partial(run, 1), run_halves)
    subject = f"a run of {len(scenes)} scenes of the course"
    n = scenes[0].n
    yield row(Subject(subject, n, threads="2"), two, "ms", "1 thread", one, SPEEDUP, ">= 1.85")
    halves = Subject(f"{subject}, as two batches at once", n, threads="1 + 1")
    yield row(halves, apart, "ms", "1 thread", one, SPEEDUP)


def overhead(scenes: list[Scene], repeats: int) -> Iterator[dict[str, str]]:
    """Making a batch and running it, against what the kernels take of it."""
    whole, kernels = [], []

    def measure() -> None:
        summaries = Batch(scenes, threads=1).run()
        kernels.append(sum(summary.seconds for summary in summaries) * 1e3)

    for _ in range(repeats):
        whole.append(seconds(measure) * 1e3)
    subject = Subject(f"making and running {len(scenes)} scenes of the course", scenes[0].n)
    yield row(subject, whole, "ms", "kernels alone", kernels, target="<= 1.05")


def figures(count: int, repeats: int) -> Iterator[dict[str, str]]:
    scenes = course(count)
    yield from against_c("scenes of the course", scenes, ">= 6", repeats)
    yield from against_c("piles that settle", piles(count), ">= 30", repeats)
    yield from cores(scenes, repeats)
    yield from overhead(scenes, repeats)


def main(arguments: list[str] | None = None) -> None:
    parser = command_line("batch", __doc__)
    parser.add_argument("--scenes", type=int, default=SCENES, help=f"in a batch (default: {SCENES:,})")
    chosen = parser.parse_args(arguments)
    publish(figures(chosen.scenes, chosen.repeats), chosen.output)


if __name__ == "__main__":
    main()
