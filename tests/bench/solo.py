"""A scene alone: against a batch of one, and its first run of all, with empty caches."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from tempfile import TemporaryDirectory

import numpy as np

from warpgrains import Batch, Scene, Simulation
from warpgrains.scene.state import first_state

from .flow import ACCELERATED, flowing
from .options import Options
from .rows import Subject, row
from .timing import in_turn, seconds

FLOWING = 100  # grains
FIRST_RUNS = 3
CALLS = 200  # of one step each
SCENES = 16  # of a batch that is called step by step


def solo(options: Options) -> Iterator[dict[str, str]]:
    """Whole runs of a simulation and of a batch of one, to the same bits."""
    course, flow = Scene.load("annulus"), flowing(min(FLOWING, options.largest), **ACCELERATED)
    alone, in_a_batch = _us_a_step(course, options.repeats)
    name = "a step in a run of the course's scene"
    yield row(Subject(name, course.n), alone, "us", "a batch of one", in_a_batch, target="<= 1.2")
    yield row(Subject(f"{name}, its time", course.n), alone, "us", target="<= 7")
    alone, in_a_batch = _us_a_step(flow, options.repeats)
    subject = Subject("a step in a run of the flowing scene, accelerated", flow.n, flow.order)
    target = "<= 1.1" if flow.n == FLOWING else ""
    yield row(subject, alone, "us", "a batch of one", in_a_batch, target=target)
    simulation = Simulation(course, threads=1)
    single = _us_a_call(simulation.step, simulation.advance, options.repeats)
    yield row(Subject("Simulation.step() above its kernel", course.n), single, "us", target="<= 10")
    for threads in (1, 2):
        batch = Batch([course] * SCENES, threads=threads)
        single = _us_a_call(partial(batch.run, 1), batch.run, options.repeats)
        subject = Subject(f"Batch.run(1) above its kernels, {SCENES} scenes", course.n, threads=str(threads))
        yield row(subject, single, "us", target="<= 80")


def _us_a_call(call: Callable[[], object], run: Callable[[int], object], repeats: int) -> list[float]:
    """Return by how much calls of one step each take longer than one call of as many."""
    run(CALLS)  # once, so that the kernels are loaded

    def calls() -> None:
        for _ in range(CALLS):
            call()

    one_by_one, at_once = in_turn(repeats, partial(seconds, calls), partial(seconds, partial(run, CALLS)))
    return [(many - one) / CALLS * 1e6 for many, one in zip(one_by_one, at_once, strict=True)]


def _us_a_step(scene: Scene, repeats: int) -> list[list[float]]:
    """Return the times of a simulation, and of a batch of one."""
    simulation, batch = Simulation(scene, threads=1), Batch([scene], threads=1)
    start = first_state(scene)

    def alone() -> float:
        simulation.restore(start)
        return seconds(partial(simulation.run, scene.steps)) / scene.steps * 1e6

    def in_a_batch() -> float:
        batch.restore(0, start)
        return seconds(partial(batch.run, scene.steps)) / scene.steps * 1e6

    alone(), in_a_batch()  # once, so that the kernels are loaded
    times = in_turn(repeats, alone, in_a_batch)
    assert np.array_equal(simulation.position, batch.position(0))
    return times


def compiling(options: Options) -> Iterator[dict[str, str]]:
    """The course's scene by command, in a process that finds no kernel compiled before."""
    taken = [_seconds_of_a_first_run() for _ in range(min(FIRST_RUNS, options.repeats))]
    subject = Subject("first run of a new kind of scene, kernels compiled in it", Scene.load("annulus").n)
    yield row(subject, taken, "s", target="<= 4")


def _seconds_of_a_first_run() -> float:
    command = [sys.executable, "-m", "warpgrains", "run", "annulus"]
    with TemporaryDirectory() as cache:
        environment = {**os.environ, "WARP_CACHE_PATH": cache}
        run = partial(subprocess.run, command, env=environment, cwd=cache, check=True, capture_output=True)
        return seconds(run)
