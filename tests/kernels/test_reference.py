"""Every step of many scenes against the course's program in C: the same bits, in the order of the sweeps."""

import ctypes
from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import pytest
from random_scenes import random_scene as random_scene_of_all
from same_bits import assert_same_bits
from sample_scenes import SUDDEN, random_scene
from schemes import SECOND_ORDER, TEXTS
from simulate import Simulate
from swept_order import Followed, follow_reference, full_order, residual_in_c
from walled_scenes import (
    BOUNCING,
    BOUNCY,
    BOXES,
    CORNERS,
    DRIVEN,
    RESISTING,
    ROLLING,
    ROUGH,
    SMOOTH_DRIVEN,
    STILL,
    STIRRED_ROUGH,
    TURNING,
    around,
    boxed,
    cloud,
    cornered,
    pressed,
    stirred,
)

from warpgrains import Scene, Simulation, State
from warpgrains.reference.reference import Grains, Reference
from warpgrains.scene.fields import ORDERS

COLOR: dict[str, Any] = {"order": "color"}


class Case(NamedTuple):
    """A scene, the steps of it that are followed, and those before, which one thread takes once."""

    make: Callable[[], Scene]
    steps: int
    before: int = 0
    meets: Callable[[Followed], bool] = bool
    """What must happen, or the case shows nothing."""


def loaded(name: str, **changes: Any) -> Callable[[], Scene]:
    return lambda: Scene.load(name).replace(**changes)


def drawn(seed: int, **changes: Any) -> Callable[[], Scene]:
    return lambda: random_scene(seed).replace(**changes)


def stiff(heaviest: float, **changes: Any) -> Scene:
    """Return a scene of which the text's scheme would reverse the velocities by drag."""
    scene = Scene.load("annulus").replace(scheme="leapfrog", **changes)
    mass = np.geomspace(0.1, heaviest, scene.n)
    return scene.replace(mass=mass, drag=40.0 * mass[0] / scene.dt)


def all_converge(met: Followed) -> bool:
    return all(report.converged for report in met.reports)


def is_crowded(met: Followed) -> bool:
    return min(report.contacts for report in met.reports) > met.scene.n


def restarts(met: Followed) -> bool:
    return sum(report.restarts for report in met.reports) > 0


def touches_corners(met: Followed) -> bool:
    return bool(met.touched - {0, 1})


def touches_all(met: Followed) -> bool:
    return met.touched >= {*met.scene.numbered_walls}


def touches(*walls: int) -> Callable[[Followed], bool]:
    return lambda met: met.touched >= {*walls}


def matters(*laws: str) -> Callable[[Followed], bool]:
    """Return whether grains end elsewhere without each of these laws."""

    def without(met: Followed, law: str) -> bool:
        plain = Simulation(met.scene.replace(**{law: 0.0}), threads=1)
        plain.advance(len(met.reports))
        return not np.array_equal(plain.position, met.position)

    return lambda met: all(without(met, law) for law in laws)


PILE: dict[str, Any] = {"method": "gauss-seidel", "order": "sequential"}
ROUND, LEAPFROG = {"wall": "round"}, {"scheme": "leapfrog"}
BY_TURNS: tuple[dict[str, Any], ...] = ({}, LEAPFROG | COLOR)
CASES = {
    "pile": Case(loaded("pile", max_iterations=200, **PILE), 10),
    "pile, settled": Case(loaded("pile", max_iterations=60, **PILE), 2, 200, is_crowded),
    "leapfrog, tangent": Case(loaded("no_inner_wall", max_iterations=100, **TEXTS | LEAPFROG), 25),
    "text, round": Case(loaded("no_inner_wall", max_iterations=100, **TEXTS | ROUND), 25),
}
for name in ("annulus", "column", "no_inner_wall", "polydisperse"):
    CASES[name] = Case(loaded(name), 60, meets=all_converge)
    CASES[f"{name}, settled"] = Case(loaded(name), 6, 400, all_converge)
    CASES[f"{name}, color"] = Case(loaded(name, max_iterations=200, **COLOR), 60)
for seed in range(24):
    CASES[f"random {seed}"] = Case(drawn(seed), 60)
for seed in range(9):  # at a round wall and at tangents by turns, so that each goes with every kind of scene
    CASES[f"random {seed}, color"] = Case(drawn(seed, **COLOR), 60)
    for order in ORDERS:
        is_round = (seed.bit_count() + ORDERS.index(order)) % 2
        changes = {"order": order, "scheme": "leapfrog", "wall": ("tangent", "round")[is_round]}
        CASES[f"random {seed}, leapfrog, {order}"] = Case(drawn(seed, **changes), 40)
for sudden in SUDDEN:
    for how, changes in {"text": {}, "color": COLOR, "second order": SECOND_ORDER}.items():
        make = partial(lambda begin, changes: begin().replace(**changes), sudden, changes)
        CASES[f"{sudden.__name__}, {how}"] = Case(make, 30, meets=bool if changes else restarts)
for heaviest in (0.1, 30.0):
    for changes in ({"wall": "tangent"}, ROUND | COLOR):
        CASES[f"stiff drag, {heaviest}, {changes}"] = Case(partial(stiff, heaviest, **changes), 40)

IN_TURN = ({}, ROUND | ROUGH | COLOR, LEAPFROG | COLOR, LEAPFROG | ROUND, LEAPFROG | ROUGH)
for changes in IN_TURN:  # every two of scheme, wall, order and friction are met together
    make = partial(around, 110, **{"max_iterations": 60} | changes)
    CASES[f"walls, {changes}"] = Case(make, 80, meets=touches(2, 3, 4, 5, 6, 7))
MOVES: dict[str, dict[str, Any]] = {
    "smooth": {},
    "turning": TURNING,
    "later": {**TURNING, "time": 0.37},
    "two": {**STIRRED_ROUGH, "radius_in": 0.05},
}
for k, (how, moves) in enumerate(MOVES.items()):
    changes = {"max_iterations": 60} | moves | BY_TURNS[k % 2]
    make = partial(stirred, 90, **changes)
    CASES[f"moving walls, {how}"] = Case(make, 200, meets=touches(2, 3, 4, 5, 6, 7))
FALL = {"gravity": (0.0, -9.81)}
DRIVES: dict[str, dict[str, Any]] = {
    "circle": {},
    "leapfrog": {**LEAPFROG, **COLOR, "drag": 0.5, "wall_mass": 0.5},
    "rough": {**COLOR, **ROUGH, "radius_in": 0.15, "walls": [SMOOTH_DRIVEN]},
    "both": {**FALL, "radius_in": 0.15, "walls": [DRIVEN]},
    "piston": {**FALL, **COLOR, "pressure": None, "walls": [STILL, DRIVEN]},
}
for how, changes in DRIVES.items():
    wall = 3 if how == "piston" else 0
    CASES[f"driven walls, {how}"] = Case(partial(pressed, 80, **changes), 100, meets=touches(wall))
FRICTION: dict[str, dict[str, Any]] = {
    "text": {},
    "leapfrog, round": LEAPFROG | ROUND,
    "equal, no drag": {"mass": 0.3, "radius": 0.04, "drag": 0.0, "spin_drag": 0.0, **LEAPFROG},
    "equal, drag": {"mass": 0.3, "radius": 0.04, **LEAPFROG},
    "one circle": {"radius_in": 0.0, "angular_velocity_in": 0.0, "walls": ()},
    "smooth walls": {"wall_friction": 0.0, "angular_velocity_in": 0.0, "angular_velocity_out": 0.0},
    "smooth grains": {"friction": 0.0, "wall_friction": 0.5},
    "color": COLOR,
}
for how, changes in FRICTION.items():
    make = partial(cloud, 120, max_iterations=60, **changes)
    CASES[f"friction, {how}"] = Case(make, 48, meets=lambda met: met.reports[-1].contacts > 10)
RESISTED: dict[str, Callable[[], Scene]] = {
    "text": partial(cloud, 120, max_iterations=60, **ROLLING),
    "leapfrog, round": partial(cloud, 120, max_iterations=60, **ROLLING, **LEAPFROG, **ROUND, **COLOR),
    "equal": partial(cloud, 120, **FRICTION["equal, no drag"], max_iterations=60, **ROLLING),
    "moving walls": partial(
        stirred, 90, **TURNING | {"walls": RESISTING}, max_iterations=60, rolling_friction=0.2
    ),
    "driven": partial(pressed, 80, **DRIVES["rough"], **ROLLING, **BOUNCY),
    "rough lid": partial(boxed, "rough lid", **ROLLING, **COLOR),
}
for how, make in RESISTED.items():
    CASES[f"rolling friction, {how}"] = Case(
        make, 100, meets=matters("rolling_friction", "wall_rolling_friction")
    )
for k, (corners, walls) in enumerate(CORNERS.items()):
    rough = {**BY_TURNS[1], "friction": 0.4, "wall_friction": 0.6, "radius_in": 0.1}
    make = partial(cornered, walls, 40, **({}, rough)[k % 2])
    CASES[f"corners, {corners}"] = Case(make, 100, meets=touches_corners)
for k, kind in enumerate(BOXES):
    CASES[f"box, {kind}"] = Case(partial(boxed, kind, **BY_TURNS[k % 2]), 120, meets=touches_all)
BOUNCES: dict[str, Callable[[], Scene]] = {
    "pairs": loaded("polydisperse", restitution=0.8, max_iterations=60),
    "two sides": loaded("annulus", restitution=0.3, wall_restitution=1.0, **COLOR),
    "moving walls": partial(stirred, 90, **BOUNCY, **{**TURNING, "walls": BOUNCING, "max_iterations": 60}),
    "round": partial(cloud, 90, **LEAPFROG, **ROUND, **COLOR, **BOUNCY),
    "driven": partial(pressed, 80, walls=[DRIVEN], restitution=0.5, radius_in=0.15),
    "corners": partial(cornered, CORNERS["chute"], 40, **BOUNCY, **LEAPFROG),
    "shear": partial(boxed, "shear", **BOUNCY, **COLOR),
    "piston": partial(boxed, "piston", **BOUNCY),
}
for how, make in BOUNCES.items():
    CASES[f"restitution, {how}"] = Case(make, 100, meets=matters("restitution", "wall_restitution"))
for seed in range(1, 16, 2):
    CASES[f"random {seed}, restitution"] = Case(drawn(seed, restitution=0.5 + seed / 30), 60)
for sudden in SUDDEN:
    CASES[f"{sudden.__name__}, restitution"] = Case(
        partial(lambda begin: begin().replace(**BOUNCY), sudden), 30
    )


@cache
def begun(which: str) -> tuple[Scene, State | None]:
    """Return a scene and its state after the steps before, the same for all ways to simulate."""
    scene, before = CASES[which].make(), CASES[which].before
    if not before:
        return scene, None
    simulation = Simulation(scene, threads=1)
    simulation.advance(before)
    return scene, simulation.state()


@pytest.mark.parametrize("which", CASES)
def test_bits_of_the_reference(c_library: ctypes.CDLL, simulate: Simulate, which: str) -> None:
    scene, state = begun(which)
    steps = max(2, simulate.of(CASES[which].steps))
    met = follow_reference(scene, steps, c_library, simulate, state)
    assert simulate.share > 1 or CASES[which].meets(met)


@pytest.mark.filterwarnings("ignore:grains overlap")
@pytest.mark.parametrize("seed", {*range(60)} - {12, 26})  # in which grains leave a round wall
def test_bits_and_residual_of_every_law(c_library: ctypes.CDLL, seed: int) -> None:
    """A few grains with some of all laws and walls, whose sweeps end by zeta or by the residual."""
    scene = random_scene_of_all(np.random.default_rng(seed), "few", method="gauss-seidel")
    simulation, on_residual = Simulation(scene, threads=1), scene.stop == "residual"
    for _ in range(12):
        start, report = simulation.state(), simulation.step()
        met = report.residual if on_residual else report.zeta
        assert report.converged == (met <= scene.tolerance)
        last = report.iterations == scene.max_iterations
        assert last or report.converged
        assert last or not on_residual or report.iterations == 1 or report.iterations % 10 == 0
        tolerance = 0.0 if on_residual else scene.tolerance
        cut = scene.replace(stop="zeta", tolerance=tolerance, max_iterations=report.iterations)
        reference = Reference(c_library, cut, start)
        in_order = full_order(simulation) if scene.order == "color" else None
        assert (report.iterations, report.zeta)[on_residual:] == reference.step(in_order)[on_residual:]
        assert_same_bits(simulation, reference)
        # two errors of a contact with both circles, and a wall that a visit moves before its grain slips
        in_one = scene.radius_in > 0.0 and not scene.has_friction and not scene.has_driven_walls
        moved = scene.has_friction and any(drive.inverse_mass for drive in scene.bodies.drives[1:])
        if not (in_one or moved):
            found = residual_in_c(c_library, simulation, start)
            speeds = simulation.velocity, scene.radius * simulation.spin, scene.dt * 1e4
            largest = max(np.abs(own).max() for own in speeds) + scene.radius_out / scene.dt
            assert abs(report.residual - found) <= 100.0 * np.finfo(float).eps * largest


PYTHON: dict[str, Callable[[], Scene]] = {
    **{
        str(scheme): loaded("annulus", mass=np.geomspace(0.1, 3.0, 15), **scheme)
        for scheme in (TEXTS, SECOND_ORDER, TEXTS | ROUND, TEXTS | LEAPFROG)
    },
    "friction": partial(cloud, **LEAPFROG, **ROLLING),
    "driven": partial(pressed, 40, walls=[DRIVEN], restitution=0.5, **LEAPFROG),
}


@pytest.mark.parametrize("which", PYTHON)
def test_python_side_of_the_reference(c_library: ctypes.CDLL, which: str) -> None:
    scene = PYTHON[which]()
    in_c, in_python = Reference(c_library, scene), Reference(c_library, scene)
    for _ in range(60 if scene.n == 15 else 20):
        in_c.update()
        in_python.step()
    names = ["position", "velocity", "spin", "angle", "pair_correction", "wall_correction"]
    names += ["pair_friction", "pair_rolling"]
    for name in names + ["driven"] * scene.has_driven_walls:
        assert np.array_equal(getattr(in_c, name), getattr(in_python, name)), name


def test_annulus_is_the_scene_of_the_course(c_library: ctypes.CDLL) -> None:
    scene = Scene.load("annulus")
    created = c_library.femGrainsCreateSimple(15, 0.1, 0.1, 0.5, 2.0)
    course: Grains = created.contents
    assert (course.radiusIn, course.radiusOut) == (scene.radius_in, scene.radius_out)
    assert (*course.gravity, course.gamma) == (*scene.gravity, scene.drag)
    for values, own in zip((*scene.position.T, scene.radius, scene.mass), "xyrm", strict=True):
        assert getattr(course, own)[: scene.n] == values.tolist()
    c_library.femGrainsFree(created)
