"""Costs of features: ratios of the time of a step with a feature to that of a step without it.

A feature is switched on with a value that has no effect on the motion. The distance between the grains of
both scenes at the end is printed, because collisions amplify rounding errors. Features that always have an
effect are compared with the plain method in the text's scheme, both with a fixed number of sweeps per step.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from warpgrains import Box, Disc, Scene, Simulation, State, analysis
from warpgrains.drawing.extent import extent_of
from warpgrains.scene.state import Corrections, first_state

from .flow import ACCELERATED, ITERATIONS, SWEPT, flowing, settled_pile
from .rows import Row, in_turn, say, seconds

COLUMNS = ("scene", "feature", "with_us", "without_us", "ratio_min", "ratio_median", "ratio_max")
FIRST = 3  # steps before the timed steps
GRAINS = (1_000,)  # numbers of grains of the larger scenes
MEASURED = (400, 10_000)  # grains of flows, for `measuring`
FLOWING = 80  # steps of flows before the measurement
STRIP = {"y": (-1.0, -0.8)}  # m
NOTHING = 1e-100
"""Value of gravity, drag or a radius that is too small to change the motion. Its square is no denormal."""
Changes = dict[str, Any]
Switch = Changes | Callable[[Scene], Changes]


class Case(NamedTuple):
    """A scene to be timed, with its corrections at the start.

    A measured time is that of `passes` passes of `steps` steps, each from the start of the scene.
    """

    name: str
    scene: Scene
    corrections: Corrections
    steps: int
    passes: int = 1


def _without_inner_wall(scene: Scene) -> Changes:
    """Return changes that remove the inner wall.

    The grains are moved below the place of this wall, and the outer wall is enlarged accordingly.
    """
    down = max(0.0, (scene.position[:, 1] + 2.0 * scene.radius).max())
    position = scene.position - np.array([0.0, down])
    return {"radius_in": 0.0, "radius_out": scene.radius_out + down, "position": position}


def _without_gravity(scene: Scene) -> Changes:
    """Return changes that remove gravity and drag. Grains get random velocities, so that they collide."""
    velocity = np.random.default_rng(1).normal(0.0, 1.0, scene.position.shape)
    return {"gravity": (0.0, 0.0), "drag": 0.0, "velocity": velocity}


def _in_a_box(scene: Scene, periodic: str = "") -> Changes:
    """Return changes that replace the annulus by a box whose sides no grain reaches."""
    half = 3.0 * extent_of(scene).half
    ends = -half, half
    return {"domain": Box(ends, ends, periodic)}


def _in_a_ring(scene: Scene) -> Changes:
    """Return changes that replace the annulus by a ring, inside of which the grains are, in a box."""
    changes = _without_inner_wall(scene)
    ring = Disc((0.0, 0.0), changes.pop("radius_out"), inside=True)
    return {**changes, **_in_a_box(scene), "walls": [ring]}


def _of_distinct(field: str, scene: Scene) -> Changes:
    """Return changes that make the equal numbers of a field distinct: the first grows by its last bit."""
    values = getattr(scene, field)
    return {field: np.append(np.nextafter(values[0], np.inf), values[1:])}


FASTER, RUBBING = {**SWEPT, "method": "accelerated"}, {**SWEPT, "friction": 0.5}
FEATURES: dict[str, tuple[Switch, Switch]] = {
    "inner wall": (_without_inner_wall, {"radius_in": NOTHING}),
    "drag": ({"drag": 0.0}, {"drag": NOTHING}),
    "gravity": (_without_gravity, {"gravity": (NOTHING, NOTHING)}),
    "distinct radii": ({}, partial(_of_distinct, "radius")),
    "distinct masses": ({}, partial(_of_distinct, "mass")),
    "periodic box": (_in_a_ring, partial(_in_a_box, periodic="x")),
    "restitution": ({}, {"restitution": 0.5, "restitution_speed": 1e9}),
    f"acceleration, {ITERATIONS} iterations": (SWEPT, FASTER),
    f"leapfrog, {ITERATIONS} iterations": (SWEPT, {"scheme": "leapfrog"}),
    f"round wall, {ITERATIONS} iterations": (SWEPT, {"wall": "round"}),
    f"friction, {ITERATIONS} iterations": (SWEPT, {"friction": 0.5}),
    f"friction, {ITERATIONS} accelerated iterations": (FASTER, {"friction": 0.5}),
    f"rolling friction beside friction, {ITERATIONS} iterations": (RUBBING, {"rolling_friction": 0.1}),
}
"""Two changes of a scene for each feature: the first removes the feature, and the second switches it on."""

TOGETHER = ["stress_xy", "force_y:Outer", "coordination_number", "packing_fraction"]
MEASUREMENTS: dict[str, Callable[[Simulation], object]] = {
    "contacts and their forces": Simulation.forces,
    "forces on walls by name": analysis.wall_forces,
    "stress of a strip": partial(analysis.mean_stress, region=STRIP),
    "packing fraction of a strip": partial(analysis.packing_fraction, region=STRIP),
    "these two, a wall force and the coordination number": partial(
        analysis.quantities, names=TOGETHER, region=STRIP
    ),
    "a profile of 20 slices": analysis.height_profile,
}


def costs(options: argparse.Namespace) -> Iterator[Row]:
    """Yield a row with the cost of every feature in the course's scene, in piles, and in flows."""
    most = options.steps or 1_000_000
    course = Scene.load("annulus")
    cases = [Case("the course's scene", course, first_state(course).corrections, course.steps - FIRST, 3)]
    for n in options.grains or GRAINS:
        kind, pile, state = settled_pile(n, options.cache)
        pile = pile.replace(position=state.position, velocity=state.velocity)
        flow = flowing(n, **ACCELERATED)
        cases.append(Case(kind, pile, state.corrections, 40))
        cases.append(Case("flowing scene, accelerated", flow, first_state(flow).corrections, 40))
    for case in cases:
        for name in FEATURES:
            yield cost(case._replace(steps=min(case.steps, most)), name, options.repeats)


def measuring(options: argparse.Namespace) -> Iterator[Row]:
    """Yield a row with the cost of each of `MEASUREMENTS`, if it is made after every step of a flow."""
    for n in options.grains or MEASURED:
        scene = flowing(n, **ACCELERATED, friction=0.5)
        simulation = Simulation(scene, threads=1)
        simulation.advance(0 if options.steps else FLOWING)
        size = f"flow with friction, {n:,} grains"
        for name, measure in MEASUREMENTS.items():
            ways = [
                partial(_us_of_steps, simulation, options.steps or 40, taken) for taken in (measure, None)
            ]
            for way in ways:
                way()
            yield _row(size, name, *in_turn(options.repeats, *ways))


def _us_of_steps(simulation: Simulation, steps: int, measure: Callable[[Simulation], object] | None) -> float:
    """Return the mean time of a step with `measure` after it [us]; restore the state afterwards."""
    state, taken = simulation.state(), 0.0
    for _ in range(steps):
        taken += seconds(partial(simulation.advance, 1))
        if measure:
            taken += seconds(partial(measure, simulation))
    simulation.restore(state)
    return taken / steps * 1e6


def cost(case: Case, name: str, repeats: int) -> Row:
    """Return the row with the cost of the feature `name`: times with and without it, taken alternately."""
    lacking, switched_on = FEATURES[name]
    without = _changed(case.scene, lacking)
    timed = [Simulation(scene, threads=1) for scene in (_changed(without, switched_on), without)]
    ways = [partial(_us_a_step, simulation, case) for simulation in timed]
    for way in ways:
        way()  # loads the kernels
    apart = np.abs(timed[0].position - timed[1].position).max()
    say(f"  {case.name}, {name}: {apart:.1g} m apart")
    return _row(case.name, name, *in_turn(repeats, *ways))


def _row(scene: str, name: str, ours: Sequence[float], its: Sequence[float]) -> Row:
    ratios = [on / off for on, off in zip(ours, its, strict=True)]
    values = median(ours), median(its), min(ratios), median(ratios), max(ratios)
    return dict(zip(COLUMNS, (scene, name, *(f"{value:.4g}" for value in values)), strict=True))


def _changed(scene: Scene, changes: Switch) -> Scene:
    return scene.replace(**(changes(scene) if callable(changes) else changes))


def _us_a_step(simulation: Simulation, case: Case) -> float:
    """Return the mean time of a step of a case [us]. The first `FIRST` steps of each pass do not count."""
    scene, taken = simulation.scene, 0.0
    for _ in range(case.passes):
        simulation.restore(State(0, scene.position, scene.velocity, case.corrections))
        simulation.advance(FIRST)
        taken += seconds(partial(simulation.advance, case.steps))
    return taken / (case.passes * case.steps) * 1e6
