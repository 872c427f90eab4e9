"""What every feature costs a scene that lacks it: CSV, ratios of steps with the feature to steps without it.

    python -m tests.bench.features -o tests/bench/results/features.csv

A feature is switched on so that it does nothing: an inner wall that no grain reaches, a drag and a gravity
that no velocity feels, a radius and a mass that differ in their last digit, a restitution that no impact is
fast enough for. How far the grains of both scenes are apart at the end is said: last digits grow where grains
collide. Acceleration, half steps, a round wall, friction and rolling friction cannot do nothing: here they
have as many sweeps a step as the plain method in the text's scheme.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from warpgrains import Box, Disc, Scene, Simulation, State
from warpgrains.arrays import FloatArray
from warpgrains.scene.state import Corrections, first_state

from .flow import ACCELERATED, flowing
from .piles import ITERATIONS, settled_pile
from .rows import command_line, in_turn, publish, say, seconds

COLUMNS = ("scene", "feature", "with_us", "without_us", "ratio_min", "ratio_median", "ratio_max")
FIRST = 3  # steps before those that are timed
GRAINS = 1_000  # of the larger scenes
NOTHING = 1e-100
"""A gravity, drag or radius that changes no other number; products of two are still floats of full digits."""
Changes = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A scene, what its contacts carry at the start, and what of it is timed.

    Attributes
    ----------
    steps, passes : int
        Steps of a pass, and passes that a time is the mean of.
    """

    name: str
    scene: Scene
    corrections: Corrections
    steps: int
    passes: int = 1


@dataclass(frozen=True)
class Feature:
    """Changes of a scene after which it lacks a feature, and changes of that one that switch it on."""

    lacking: Callable[[Scene], Changes]
    switched_on: Callable[[Scene], Changes]


def _without_inner_wall(scene: Scene) -> Changes:
    """No inner wall; the grains start, and stay, below where it has been, and the outer one makes room."""
    down = max(0.0, (scene.position[:, 1] + 2.0 * scene.radius).max())
    position = scene.position - np.array([0.0, down])
    return {"radius_in": 0.0, "radius_out": scene.radius_out + down, "position": position}


def _without_gravity(scene: Scene) -> Changes:
    """No gravity; the grains fly about, so that a step has something to do."""
    velocity = np.random.default_rng(1).normal(0.0, 1.0, scene.position.shape)
    return {"gravity": (0.0, 0.0), "drag": 0.0, "velocity": velocity}


def _box(scene: Scene, periodic: str = "") -> Box:
    """A box whose sides no grain reaches."""
    ends = -3.0 * scene.extent.half, 3.0 * scene.extent.half
    return Box(ends, ends, periodic)


def _in_a_ring(scene: Scene) -> Changes:
    """A ring in a box instead of the outer wall."""
    changes = _without_inner_wall(scene)
    ring = Disc((0.0, 0.0), changes.pop("radius_out"), inside=True)
    return changes | {"domain": _box(scene), "walls": [ring]}


def _swept_by(method: str) -> Changes:
    return {"method": method, "stop": "zeta", "tolerance": 0.0, "max_iterations": ITERATIONS}


def _next(values: FloatArray) -> FloatArray:
    """Return equal numbers of which the first is a last digit larger."""
    return np.append(np.nextafter(values[0], np.inf), values[1:])


FEATURES = {
    "inner wall": Feature(_without_inner_wall, lambda _: {"radius_in": NOTHING}),
    "drag": Feature(lambda _: {"drag": 0.0}, lambda _: {"drag": NOTHING}),
    "gravity": Feature(_without_gravity, lambda _: {"gravity": (NOTHING, NOTHING)}),
    "distinct radii": Feature(lambda _: {}, lambda scene: {"radius": _next(scene.radius)}),
    "distinct masses": Feature(lambda _: {}, lambda scene: {"mass": _next(scene.mass)}),
    "periodic box": Feature(_in_a_ring, lambda scene: {"domain": _box(scene, "x")}),
    "restitution": Feature(lambda _: {}, lambda _: {"restitution": 0.5, "restitution_speed": 1e9}),
    f"acceleration, {ITERATIONS} sweeps": Feature(
        lambda _: _swept_by("gauss-seidel"), lambda _: _swept_by("accelerated")
    ),
    f"leapfrog, {ITERATIONS} sweeps": Feature(
        lambda _: _swept_by("gauss-seidel"), lambda _: {"scheme": "leapfrog"}
    ),
    f"round wall, {ITERATIONS} sweeps": Feature(
        lambda _: _swept_by("gauss-seidel"), lambda _: {"wall": "round"}
    ),
    f"friction, {ITERATIONS} sweeps": Feature(
        lambda _: _swept_by("gauss-seidel"), lambda _: {"friction": 0.5}
    ),
    f"friction, {ITERATIONS} accelerated sweeps": Feature(
        lambda _: _swept_by("accelerated"), lambda _: {"friction": 0.5}
    ),
    f"rolling friction beside friction, {ITERATIONS} sweeps": Feature(
        lambda _: _swept_by("gauss-seidel") | {"friction": 0.5}, lambda _: {"rolling_friction": 0.1}
    ),
}


def cases(cache: Path, largest: int) -> Iterator[Case]:
    """The course's scene, a pile, and grains that flow."""
    course, n = Scene.load("annulus"), min(GRAINS, largest)
    flow, settled = flowing(n, **ACCELERATED), settled_pile(n, cache)
    pile = settled.scene.replace(position=settled.state.position, velocity=settled.state.velocity)
    yield Case("the course's scene", course, first_state(course).corrections, course.steps - FIRST, 3)
    yield Case(settled.kind, pile, settled.state.corrections, 40)
    yield Case("flowing scene, accelerated", flow, first_state(flow).corrections, 40)


def cost(case: Case, name: str, repeats: int) -> dict[str, str]:
    """Time a scene with a feature and without it in turn, and return the row of both."""
    feature = FEATURES[name]
    lacking = case.scene.replace(**feature.lacking(case.scene))
    scenes = lacking.replace(**feature.switched_on(lacking)), lacking
    timed = [Timed(scene, case) for scene in scenes]
    for one in timed:
        one.us_a_step()  # once, so that the kernels are loaded
    one, other = timed
    apart = np.abs(one.simulation.position - other.simulation.position).max()
    say(f"  {case.name}, {name}: {one.iterations:,} and {other.iterations:,} sweeps, {apart:.1g} m apart")
    ours, its = in_turn(repeats, *(one.us_a_step for one in timed))
    ratios = [on / off for on, off in zip(ours, its, strict=True)]
    values = median(ours), median(its), min(ratios), median(ratios), max(ratios)
    return dict(zip(COLUMNS, (case.name, name, *(f"{value:.4g}" for value in values)), strict=True))


class Timed:
    """A simulation that is run again and again from where its case starts."""

    def __init__(self, scene: Scene, case: Case):
        self.simulation, self.iterations = Simulation(scene, threads=1), 0
        self._case, self._start = case, State(0, scene.position, scene.velocity, case.corrections)

    def us_a_step(self) -> float:
        """Return the mean time of the steps after the first ones [us]."""
        steps, passes = self._case.steps, self._case.passes
        return sum(self._seconds(steps) for _ in range(passes)) / (passes * steps) * 1e6

    def _seconds(self, steps: int) -> float:
        self.simulation.restore(self._start)
        self.simulation.advance(FIRST)
        return seconds(lambda: self._advance(steps))

    def _advance(self, steps: int) -> None:
        self.iterations = self.simulation.advance(steps).iterations


def main(arguments: list[str] | None = None) -> None:
    parser = command_line("features", __doc__, repeats=15)
    parser.add_argument("--largest", type=int, default=GRAINS, help=f"grains at most (default: {GRAINS:,})")
    chosen = parser.parse_args(arguments)
    measured = (
        cost(case, name, chosen.repeats) for case in cases(chosen.cache, chosen.largest) for name in FEATURES
    )
    publish(measured, chosen.output, COLUMNS)


if __name__ == "__main__":
    main()
