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
from schemes import EULER, SECOND_ORDER
from swept_order import Followed, follow_reference, full_order, residual_in_c
from trimmed import first_fast
from walled_scenes import BOUNCY, DRIVEN, ROLLING, ROUGH, WALLED, cloud, pressed

from warpgrains import Scene, Simulation, State
from warpgrains.reference.reference import Grains, Reference
from warpgrains.solver import tuning
from warpgrains.walls.rim import Rim

COLOR, ROUND, LEAPFROG = {"order": "color"}, {"wall": "round"}, {"scheme": "leapfrog"}


class Case(NamedTuple):
    """A scene, the steps of it that are followed, and those before, which one thread takes once."""

    make: Callable[[], Scene]
    steps: int
    before: int = 0
    meets: Callable[[Followed], bool] = bool
    """What must happen, or the case shows nothing."""


def changed(make: Callable[..., Scene], *arguments: Any, **changes: Any) -> Callable[[], Scene]:
    return lambda: make(*arguments).replace(**changes)


def stiff(heaviest: float, **changes: Any) -> Scene:
    """Return a scene of which the text's scheme would reverse the velocities by drag."""
    scene = Scene.load("annulus").replace(scheme="leapfrog", **changes)
    mass = np.geomspace(0.1, heaviest, scene.n)
    return scene.replace(mass=mass, drag=40.0 * mass[0] / scene.dt)


def all_converge(met: Followed) -> bool:
    return all(report.converged for report in met.reports)


def restarts(met: Followed) -> bool:
    return sum(report.restarts for report in met.reports) > 0


def touches_walls(met: Followed) -> bool:
    """Whether three of five walls carry a grain, or of many that stand in line a few."""
    of = [wall.image.of if wall.image else k for k, wall in enumerate(met.scene.walls)]
    walls = {k for k in of if not isinstance(met.scene.walls[k], Rim)} or {0} & {*of}
    return len({of[k] for k in met.touched} & walls) >= min(0.6 * len(walls), 7)


def matters(law: dict[str, float], met: Followed) -> bool:
    """Return whether grains end elsewhere without each of these coefficients."""
    for name in {"restitution", "wall_restitution", "rolling_friction", "wall_rolling_friction"} & {*law}:
        if "wall" in name and not met.touched:
            continue
        without = {name: 0.0} | ({} if met.scene.walls else {"restitution_speed": 0.0})
        plain = Simulation(met.scene.replace(**without), threads=1)
        plain.advance(len(met.reports))
        if np.array_equal(plain.position, met.position):
            return False
    return True


CASES = {
    "stiff drag, equal": Case(partial(stiff, 0.1), 40),
    "stiff drag": Case(partial(stiff, 30.0, **ROUND, **COLOR), 40),
}
for name in ("annulus", "column", "no_inner_wall", "polydisperse"):
    CASES[name] = Case(changed(Scene.load, name), 40, meets=all_converge)
    CASES[f"{name}, settled"] = Case(changed(Scene.load, name, **COLOR), 6, 400, all_converge)
PAIRWISE = ({}, ROUND | BOUNCY | COLOR, LEAPFROG | COLOR, LEAPFROG | ROUND, LEAPFROG | BOUNCY)
"""Every two of scheme, wall, order and restitution are met together."""
for sudden in SUDDEN:
    CASES[sudden.__name__] = Case(sudden, 30, meets=restarts)
    CASES[f"{sudden.__name__}, color"] = Case(changed(sudden, **COLOR), 30)
    CASES[f"{sudden.__name__}, second order"] = Case(changed(sudden, **SECOND_ORDER, **BOUNCY), 30)
TURNS = ({}, COLOR, LEAPFROG, LEAPFROG | COLOR)
LAWS: dict[str, dict[str, float]] = {
    "rough": ROUGH,
    "bouncing": BOUNCY,
    "resisting": {**ROUGH, **ROLLING},
    "of every law": {**ROUGH, **ROLLING, **BOUNCY},
}
for k, (walls, make) in enumerate(WALLED.items()):  # in two turns that have both schemes and both orders
    law = [*LAWS][k % 4]
    plain, ruled = (partial(make, max_iterations=30, **turn) for turn in (TURNS[k % 4], TURNS[3 - k % 4]))
    CASES[walls] = Case(plain, 60, meets=touches_walls)
    CASES[f"{walls}, {law}"] = Case(partial(ruled, **LAWS[law]), 30, meets=partial(matters, LAWS[law]))
for seed in sorted({*range(40)} - {16, 26, 28}):  # of eight kinds; of these three, grains leave a round wall
    CASES[f"random {seed}"] = Case(changed(random_scene, seed, **PAIRWISE[seed % 5]), 50)


@cache
def begun(which: str) -> tuple[Scene, State | None]:
    """Return a scene and its state after the steps before, the same for all ways to simulate."""
    scene, before = CASES[which].make(), CASES[which].before
    if not before:
        return scene, None
    simulation = Simulation(scene, threads=1)
    simulation.advance(before)
    return scene, simulation.state()


WAYS = [
    pytest.param(1, True, 1, id="1 thread"),
    pytest.param(2, True, 10, id="2 threads", marks=pytest.mark.slow),
    pytest.param(1, False, 5, id="1 thread, a list every step", marks=pytest.mark.slow),
    pytest.param(2, False, 10, id="2 threads, a list every step", marks=pytest.mark.slow),
]
"""Threads, whether a list is used again, and the share of the steps that is followed."""


@pytest.mark.parametrize(("threads", "use_again", "share"), WAYS)
@pytest.mark.parametrize("which", first_fast(CASES, len(CASES) - 20))
def test_bits_of_the_reference(
    c_library: ctypes.CDLL,
    monkeypatch: pytest.MonkeyPatch,
    which: str,
    threads: int,
    use_again: bool,
    share: int,
) -> None:
    if not use_again:
        monkeypatch.setattr(tuning, "BASE_SKIN", 1e-12)
    scene, state = begun(which)
    steps = max(2, CASES[which].steps // share)
    met = follow_reference(scene, steps, c_library, partial(Simulation, threads=threads), state)
    assert share > 1 or CASES[which].meets(met)


@pytest.mark.filterwarnings("ignore:grains overlap")
@pytest.mark.parametrize(
    "seed", first_fast(sorted({*range(60)} - {12}), 30)
)  # in which grains leave a round wall
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
    "text": changed(Scene.load, "annulus", mass=np.geomspace(0.1, 3.0, 15), **EULER),
    "second order": changed(Scene.load, "annulus", mass=np.geomspace(0.1, 3.0, 15), **SECOND_ORDER),
    "friction": partial(cloud, **LEAPFROG, **ROLLING),
    "driven": partial(pressed, walls=[DRIVEN], restitution=0.5, **LEAPFROG),
}


@pytest.mark.parametrize("which", PYTHON)
def test_python_side_of_the_reference(c_library: ctypes.CDLL, which: str) -> None:
    scene = PYTHON[which]()
    in_c, in_python = Reference(c_library, scene), Reference(c_library, scene)
    for _ in range(60 if scene.n == 15 else 8):
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
