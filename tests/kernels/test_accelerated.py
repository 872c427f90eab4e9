"""The accelerated method: against a twin without a list, with any list; the residual against all pairs."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from accelerated_twin import AcceleratedTwin
from bench.flow import ACCELERATED, flowing
from residual_twin import free_velocity, twin_residual
from same_bits import at_annulus, dense_pair_correction
from sample_scenes import bullet, chain, crowd, explosion, random_scene
from schemes import EULER, SECOND_ORDER

from warpgrains import Scene, Simulation, StepReport
from warpgrains.solver import tuning

EPS = np.finfo(float).eps


def annulus(**changes: object) -> Scene:
    """Fifteen equal grains about an inner wall."""
    return Scene.load("annulus").replace(**changes)


def few(**changes: object) -> Scene:
    """Twelve grains of masses 1 to 300 that fall into an empty bowl."""
    grains = {"position": annulus().position[:12], "velocity": None, "spin": None, "radius_in": 0.0}
    grains |= {"mass": np.geomspace(30.0, 0.1, 12), "radius": np.linspace(0.06, 0.1, 12)}
    return annulus(**grains, **changes)


def tower(n: int, tolerance: float) -> Scene:
    """Grains above each other that land together: a wave runs up and down them, and t is held back."""
    r = 0.015
    return Scene(
        position=np.stack([np.zeros(n), -1.0 + 1.001 * r + 2.001 * r * np.arange(n)], axis=1),
        velocity=np.tile((0.0, -1.0), (n, 1)),
        radius=r,
        mass=0.1,
        radius_out=1.0,
        dt=0.005,
        tolerance=tolerance,
        max_iterations=500,
    )


def push() -> Scene:
    """Light grains push lighter ones on: zeta falls while the last pair still waits for a look."""
    k = np.arange(8)
    return Scene(
        position=np.stack([0.203 * k - 0.8, 1e-9 * k], axis=1),
        velocity=np.stack([np.where(k == 0, 2.0, 0.0), 0.0 * k], axis=1),
        radius=0.1,
        mass=1e-4**k,
        radius_out=2.0,
        gravity=(0.0, 0.0),
        dt=0.03,
        tolerance=0.05,
    )


CASES: dict[str, tuple[Callable[[], Scene], int]] = {
    "falls": (lambda: annulus(dt=0.03), 40),
    "rests": (lambda: few(dt=0.02), 60),
    "rests, small tolerance": (lambda: few(dt=0.04, tolerance=1e-9), 40),
    "thick syrup": (lambda: few(dt=0.02, drag=4.0), 40),
    "step far too large": (lambda: annulus(dt=0.3, drag=0.0, max_iterations=1000), 10),
    "deep overlap": (lambda: crowd(10, area=1.1, max_iterations=205), 4),
    "does not fit": (lambda: chain(6, overlap=0.05, max_iterations=205), 4),
    "grain alone": (lambda: random_scene(7), 20),
    "two grains": (lambda: random_scene(0), 20),
    "anywhere": (lambda: random_scene(4), 4),
    "bullet": (bullet, 10),
    "push that no look has passed on": (push, 1),
    "explosion": (explosion, 3),
    "tower, t of 24": (lambda: tower(40, 1e-2), 2),
    "tower, t by the fall of zeta": (lambda: tower(60, 1e-3), 2),
    "tower, t by the sweeps": (lambda: tower(60, 3e-3), 2),
}
LEAVING = {"deep overlap", "anywhere"}  # a round wall, at which their steps are refused
LISTS: dict[str, dict[str, Any]] = {
    "as they are": {},
    "as short as can be": {"BASE_SKIN": 1e-12},
    "often found wanting at the end": {"rounding": lambda scene: 0.01 * scene.typical_radius},
}


@pytest.mark.parametrize("lists", LISTS)
@pytest.mark.parametrize("case", CASES)
def test_against_all_pairs(case: str, lists: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By both schemes and both criteria in turn."""
    for name, value in LISTS[lists].items():
        monkeypatch.setattr(tuning, name, value)
    (make, steps), turn = CASES[case], [*CASES].index(case) + [*LISTS].index(lists)
    how = (EULER, SECOND_ORDER)[turn // 2 % 2] | {"stop": ("residual", "zeta")[turn % 2]}
    if case in LEAVING:
        how |= {"wall": "tangent"}
    scene, rebuilds = make().replace(method="accelerated", **how), 0
    simulation, twin = Simulation(scene, threads=1), AcceleratedTwin(scene)
    for _ in range(steps):
        report = simulation.step()
        twin.step()
        assert (report.iterations, report.zeta) == (twin.iterations, twin.zeta)
        assert report.residual == twin.residual
        assert np.array_equal(simulation.velocity, twin.velocity)
        assert np.array_equal(simulation.position, twin.position)
        carried = dense_pair_correction(simulation), at_annulus(simulation).correction
        assert np.concatenate(carried).tolist() == twin.corrections
        rebuilds += report.rebuilds
    if lists == "as short as can be" and scene.n > 1:
        assert rebuilds > 2 * steps


def steps_measured(simulation: Simulation, steps: int) -> list[StepReport]:
    """Hold the residual of each step against that of all pairs."""
    scene, reports = simulation.scene, []
    for _ in range(steps):
        free = free_velocity(simulation)
        reports.append(report := simulation.step())
        # Corrections and gap rates of up to so many m/s are added up in another order, some dozen at a grain.
        size = np.abs(free).max() + scene.radius_out / scene.dt
        assert abs(report.residual - twin_residual(simulation, free)) <= 100 * EPS * size
        met = report.zeta if scene.stop == "zeta" else report.residual
        assert report.converged == (met <= scene.tolerance)
    return reports


MEASURED = [
    ("annulus", "gauss-seidel", EULER),
    ("annulus", "accelerated", SECOND_ORDER),
    ("polydisperse", "gauss-seidel", SECOND_ORDER),
    ("polydisperse", "accelerated", EULER),
    ("no_inner_wall", "gauss-seidel", EULER),
    ("no_inner_wall", "accelerated", SECOND_ORDER),
]


@pytest.mark.parametrize(("name", "method", "scheme"), MEASURED)
def test_residual_is_that_of_all_pairs(name: str, method: str, scheme: dict[str, str]) -> None:
    steps_measured(Simulation(name, method=method, max_iterations=30, **scheme), 40)


@pytest.mark.parametrize("n", [200, pytest.param(700, marks=pytest.mark.slow)])
@pytest.mark.parametrize("dt", [0.01, 0.03])
def test_nothing_is_missing_in_flow(n: int, dt: float) -> None:
    reports = steps_measured(Simulation(flowing(n, dt=dt, **ACCELERATED)), int(1.2 / dt))
    assert all(report.converged and report.restarts == 0 for report in reports)
    assert sum(report.rebuilds for report in reports) > len(reports) / 4


def test_long_solves_do_not_drift() -> None:
    """Sweeps past convergence only gather rounding errors, which rebuilt velocities take away."""
    endless = {"tolerance": 0.0, "max_iterations": 20_000}
    simulation = Simulation("column", method="accelerated", order="color", **endless)
    # Each of the 100 sweeps between two rebuilds rounds a velocity up to five times (contacts, momentum,
    # the rebuilding itself), and momentum may repeat each of these errors in the sweeps that are left.
    repeated, scene = 5 * 100 * 100 * EPS, simulation.scene
    for _ in range(3):
        size = np.abs(free_velocity(simulation)).max() + scene.dt * np.hypot(*scene.gravity)
        assert simulation.step().residual <= repeated * size
