"""The common flow in this and other programs, with and without friction: CPU time and overlap.

The time is that of 10 ms of simulated time on one thread, without set-up and compilation. The overlaps are
the worst ones of the true circles, sampled every 10 ms. The measured window is 2 s; for more than 1,000
grains, it is 0.05 s in which all splash. Programs that are not installed and settings that take too long have
no row; a message names them.
"""

import argparse
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from warpgrains import Scene
from warpgrains.base.arrays import FloatArray

from .flow import flowing, splashing
from .kamino import Kamino
from .peer_programs import Box2d, Box2d3, Lammps, OfDebian, Pymunk, Warpgrains
from .rows import Row, say

Result = TypeVar("Result")
Settings = list[tuple[str, dict[str, Any]]]
FIGURES = ("ms of 10 ms", "overlap of pairs", "of the outer wall", "of the inner wall")
FRICTIONS = 0.5, 0.0
GRAINS = 1_000, 10_000, 100
FROM_REST = 1_000  # most grains of scenes measured from the start
SLOW = {"Siconos": 1_000}  # most grains by program: 10,000 did not end
WHOLE, SPLASH = 200, 5  # frames of 10 ms in a window
SHORT, PASSES = 2.0, 5  # a window of less CPU time [s] is timed again, this often
SPRINGS = [(f"stiff for {overlap:g} radii", {"overlap": overlap}) for overlap in (0.1, 0.035, 0.01, 0.001)]
SUBSTEPS = [
    (f"{k} sub-steps of 10 iterations", {"substeps": k, "iterations": 10}) for k in (1, 10, 20, 40, 80)
]
SEARCHES = [(f"{k} searches, {4 * k} sub-steps", {"steps": k, "substeps": 4}) for k in (1, 4, 10, 20, 40, 80)]


def peers(box2d3: Path | None) -> dict[str, tuple[Callable[..., Any], Settings]]:
    """Return all programs by name: each with its class, and its settings as (name, arguments of the class).

    `box2d3` is the source folder of Box2D 3.
    """
    accelerated = [
        (f"dt {dt:g}, to {tolerance:g} m/s", {"dt": dt, "tolerance": tolerance})
        for dt, tolerance in product((0.01, 0.0025), (1e-1, 3e-2, 1e-2, 1e-3, 1e-4))
    ]
    ours = partial(Warpgrains, order="color", stop="residual")
    iterations = [(f"{count} iterations", {"iterations": count}) for count in (24, 100, 400)]
    steps = [(f"dt {dt:g}", {"dt": dt, "tolerance": 1e-4}) for dt in (0.01, 0.0025)]
    return {
        "warpgrains, accelerated": (partial(ours, method="accelerated"), accelerated),
        "warpgrains, plain": (partial(ours, method="gauss-seidel"), accelerated[:5]),
        "warpgrains, exact": (partial(ours, method="exact"), accelerated[:5]),
        "Box2D 3": (partial(Box2d3, source=box2d3), SEARCHES),
        "pymunk": (Pymunk, SUBSTEPS),
        "Box2D 2.3": (Box2d, SUBSTEPS),
        "LAMMPS": (Lammps, SPRINGS),
        "LIGGGHTS": (partial(OfDebian, name="liggghts"), SPRINGS),
        "Newton Kamino": (Kamino, iterations),
        "YADE": (partial(OfDebian, name="yade"), SPRINGS),
        "Siconos": (partial(OfDebian, name="siconos"), steps),
    }


def start(n: int, friction: float, cache: Path) -> tuple[Scene, int]:
    """Return the flow of n grains at the start of the measured window, and the number of frames of this."""
    scene = flowing(n, friction=friction)
    if n <= FROM_REST:
        return scene, WHOLE
    _, state = splashing(n, cache)
    return scene.replace(position=state.position, velocity=state.velocity), SPLASH


def overlaps(scene: Scene, x: FloatArray) -> FloatArray:
    """Return the worst overlaps of pairs, of grains and the outer wall, and of grains and the inner wall.

    `x` are the centers [m], shape (n, 2). Overlaps are in radii, shape (3,).
    """
    radius = float(scene.radius[0])
    pairs = cKDTree(x).query_pairs(2.0 * radius, output_type="ndarray")
    apart = np.hypot(*(x[pairs[:, 0]] - x[pairs[:, 1]]).T)
    rho = np.hypot(*x.T)
    worst = (
        np.max(2.0 * radius - apart, initial=0.0),
        max(0.0, rho.max() + radius - scene.radius_out),
        max(0.0, scene.radius_in + radius - rho.min()),
    )
    return np.array(worst) / radius


def measure(
    scene: Scene, frames: int, longest: float, make: Callable[..., Any], **setting: Any
) -> tuple[float, FloatArray]:
    """Simulate a scene by the program of the class `make` with a setting.

    Returns the CPU time per 10 ms [ms] and the worst overlaps [radii]. Raises TimeoutError if all frames
    would take more than `longest` [s].
    """
    program, worst = make(scene, **setting), np.zeros(3)
    times: list[float] = []
    while len(times) < frames:
        times.append(cpu_seconds(program, 1))
        expected = median(times) * frames
        if len(times) > 2 and expected > longest:
            raise TimeoutError(f"it would take {expected:.0f} s")
        worst = np.maximum(worst, overlaps(scene, program.position()))
    if expected > SHORT:
        return 1e3 * sum(times) / frames, worst
    return 1e3 * median(cpu_seconds(make(scene, **setting), frames) for _ in range(PASSES)) / frames, worst


def cpu_seconds(program: Any, frames: int) -> float:
    clock = getattr(program, "cpu_seconds", process_time)
    begun = clock()
    program.advance(frames)
    return clock() - begun


def known(given: list[str] | None, programs: Iterable[str]) -> list[str]:
    """Return the given names of programs, or all names if none are given; exit if one is unknown."""
    names = list(programs)
    if unknown := [name for name in given or () if name not in names]:
        raise SystemExit(f"--programs: no program is named {unknown[0]!r}: there are {'; '.join(names)}")
    return given or names


def of_each(
    name: str, settings: Settings, measure: Callable[..., Result], compiles: bool = False
) -> Iterator[tuple[str, Result]]:
    """Yield the name of each setting of a program with the result of `measure` for it.

    Settings that take too long, or all if the program is missing, are left out with a message. If the program
    `compiles` at first use, the first setting is measured twice.
    """
    for k, (setting, values) in enumerate(settings):
        try:
            if compiles and k == 0:
                measure(**values)
            yield setting, measure(**values)
        except TimeoutError as error:
            say(f"  {name}, {setting}: left out: {error}")
        except (ImportError, OSError) as error:
            say(f"{name} is left out: {error}")
            return


def rows(options: argparse.Namespace) -> Iterator[Row]:
    """Yield a row for each setting of every program, each number of grains, and with and without friction."""
    programs = peers(options.box2d3)
    chosen = known(options.programs, programs)
    for n, friction, name in product(options.grains or GRAINS, FRICTIONS, chosen):
        if n > SLOW.get(name, n):
            continue
        scene, frames = start(n, friction, options.cache)
        make, settings = programs[name]
        measured = partial(measure, scene, frames, options.longest, make)
        for setting, (taken, worst) in of_each(name, settings, measured, compiles=True):
            what = {"program": name, "setting": setting, "friction": f"{friction:g}", "n": str(n)}
            figures = (f"{value:.3g}" for value in (taken, *worst))
            yield {**what, **dict(zip(FIGURES, figures, strict=True))}
