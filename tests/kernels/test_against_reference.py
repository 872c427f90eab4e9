"""The sequential order against the course's program in C: the same bits, step after step."""

import ctypes
from collections.abc import Callable

import numpy as np
import pytest
from same_bits import assert_same_bits
from sample_scenes import SUDDEN, random_scene
from schemes import MIXED, SCHEMES
from simulate import Simulate

from warpgrains import Scene, Simulation, State, StepReport
from warpgrains.reference.reference import Grains, Reference

TEXTS = {"method": "gauss-seidel", "order": "sequential"}

MakeReference = Callable[..., Reference]


def worst_overlap(simulation: Simulation) -> float:
    """Measure the overlaps of all pairs and of all grains with the walls [m]."""
    scene, x = simulation.scene, simulation.position
    i, j = np.triu_indices(scene.n, 1)
    d, rho = x[j] - x[i], np.sqrt(x[:, 0] * x[:, 0] + x[:, 1] * x[:, 1])
    pair_gap = np.sqrt(d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1]) - (scene.radius[i] + scene.radius[j])
    wall_gap = scene.radius_out - rho - scene.radius
    if scene.radius_in > 0.0:
        wall_gap = np.minimum(wall_gap, rho - scene.radius_in - scene.radius)
    return max(0.0, -pair_gap.min(initial=0.0), -wall_gap.min())


STATES: dict[str, State] = {}


def after(scene: Scene, steps: int) -> State:
    """Return the state of a scene after so many steps, which one thread takes once for all ways."""
    if scene.name not in STATES:
        simulation = Simulation(scene, threads=1)
        simulation.advance(steps)
        STATES[scene.name] = simulation.state()
    return STATES[scene.name]


def step_both(simulation: Simulation, reference: Reference, steps: int) -> list[StepReport]:
    """Hold every step against the reference."""
    reports = []
    for _ in range(steps):
        report = simulation.step()
        iterations, zeta = reference.step()
        assert (report.iterations, report.zeta) == (iterations, zeta)
        assert report.converged == (zeta <= simulation.scene.tolerance)
        assert_same_bits(simulation, reference)
        carrying = np.count_nonzero(reference.pair_correction) + np.count_nonzero(reference.wall_correction)
        assert report.contacts == carrying
        assert report.overlap == worst_overlap(simulation)
        reports.append(report)
    return reports


@pytest.mark.parametrize("scheme", [*SCHEMES, *MIXED])
def test_python_side_of_the_reference(reference: MakeReference, scheme: dict[str, str]) -> None:
    scene = Scene.load("annulus").replace(mass=np.geomspace(0.1, 3.0, 15), **scheme)
    in_c, in_python = reference(scene), reference(scene)
    for _ in range(60):
        in_c.update()
        in_python.step()
    for name in ("position", "velocity", "pair_correction", "wall_correction"):
        assert np.array_equal(getattr(in_c, name), getattr(in_python, name))


def test_annulus_is_the_scene_of_the_course(c_library: ctypes.CDLL) -> None:
    scene = Scene.load("annulus")
    created = c_library.femGrainsCreateSimple(15, 0.1, 0.1, 0.5, 2.0)
    course: Grains = created.contents
    assert (course.radiusIn, course.radiusOut) == (scene.radius_in, scene.radius_out)
    assert (*course.gravity, course.gamma) == (*scene.gravity, scene.drag)
    for values, name in zip((*scene.position.T, scene.radius, scene.mass), "xyrm", strict=True):
        assert getattr(course, name)[: scene.n] == values.tolist()
    c_library.femGrainsFree(created)


@pytest.mark.parametrize("name", ["annulus", "column", "no_inner_wall", "polydisperse"])
def test_shipped_scene(reference: MakeReference, simulate: Simulate, name: str) -> None:
    """From its start, and again where its grains have come to lie on each other."""
    scene = Scene.load(name)
    reports = step_both(simulate(scene), reference(scene), steps=max(30, simulate.of(60)))
    later = simulate(scene)
    later.restore(after(scene, 400))
    reports += step_both(later, reference(scene, later.state()), steps=5)
    assert all(report.converged for report in reports)


def test_pile_from_its_start(reference: MakeReference, simulate: Simulate) -> None:
    scene = Scene.load("pile").replace(max_iterations=200, **TEXTS)
    step_both(simulate(scene), reference(scene), steps=simulate.of(10))


def test_pile_that_settles(reference: MakeReference, simulate: Simulate) -> None:
    scene = Scene.load("pile").replace(max_iterations=60, **TEXTS)
    simulation = simulate(scene)
    simulation.restore(after(scene, 200))
    reports = step_both(simulation, reference(scene, simulation.state()), steps=max(1, simulate.of(2)))
    assert min(report.contacts for report in reports) > scene.n


@pytest.mark.parametrize("seed", range(8))
def test_random_scene(reference: MakeReference, simulate: Simulate, seed: int) -> None:
    scene = random_scene(seed)
    step_both(simulate(scene), reference(scene), steps=simulate.of(120))


@pytest.mark.parametrize("seed", range(8, 24))
def test_another_random_scene(reference: MakeReference, seed: int) -> None:
    scene = random_scene(seed)
    step_both(Simulation(scene), reference(scene), steps=60)


@pytest.mark.parametrize("make", SUDDEN)
def test_step_that_is_solved_again(
    reference: MakeReference, simulate: Simulate, make: Callable[[], Scene]
) -> None:
    scene = make()
    reports = step_both(simulate(scene), reference(scene), steps=simulate.of(30))
    assert sum(report.restarts for report in reports) > 0
