"""The true error of a step: exact velocities against closed forms, and what is refused."""

import itertools
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sample_scenes import bullet
from schemes import SECOND_ORDER

from warpgrains import Box, InputError, Scene, Simulation, SimulationError
from warpgrains.accuracy import certify
from warpgrains.accuracy.exact_step import StepProblem, pairs_within, solve_exactly

DT = 0.01
SOLVED = {"tolerance": 1e-12, "max_iterations": 100_000}


def column(n: int) -> Scene:
    """Return grains at rest, one on the other, on the outer wall."""
    y = -2.0 + 0.05 + 0.1 * np.arange(n)
    return Scene(position=np.stack([np.zeros(n), y], axis=1), radius=0.05, mass=0.1, radius_out=2.0, dt=DT)


def crowd(seed: int, **changes: Any) -> Scene:
    """Return thirty grains of unlike sizes that touch nothing yet and run into one another and both walls."""
    rng = np.random.default_rng(seed)
    angle = 2.0 * np.pi * (np.arange(30) % 10) / 10 + rng.uniform(0.0, 0.05, 30)
    rho = 0.75 + 0.45 * (np.arange(30) // 10) + rng.uniform(0.0, 0.05, 30)
    position = rho[:, np.newaxis] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    grains = {"velocity": rng.normal(0.0, 30.0, (30, 2)), "radius": rng.uniform(0.15, 0.2, 30)}
    grains["mass"] = rng.uniform(0.1, 1.0, 30)
    return Scene(**{"position": position, **grains, "radius_in": 0.5, "radius_out": 2.0, "dt": DT, **changes})


def test_error_is_that_of_the_lightest_grain() -> None:
    """A heavy grain that rests far away makes no other velocity more certain."""
    alone = crowd(0, gravity=(0.0, 0.0), radius_out=9.0)
    beside = alone.replace(
        position=np.vstack([alone.position, [8.0, 0.0]]),
        velocity=np.vstack([alone.velocity, [0.0, 0.0]]),
        radius=np.append(alone.radius, 0.1),
        mass=np.append(alone.mass, 1e12),
    )
    errors = [
        solve_exactly(StepProblem(scene, scene.position, scene.velocity), scene.velocity).error
        for scene in (beside, alone)
    ]
    # the same problem, but for the library's rounding; by its mass it would be a millionth
    assert errors[0] >= 0.1 * errors[1]


def test_error_is_the_difference_from_the_closed_form() -> None:
    """A column rests; an error below that of the solver is not named."""
    simulation = Simulation(column(20), max_iterations=10)
    assert not simulation.step().converged
    bound = certify(simulation)
    assert bound.error == pytest.approx(np.abs(simulation.velocity).max(), abs=bound.solver_error)
    assert bound.error > 100.0 * bound.solver_error
    assert bound.at_most == bound.error + bound.solver_error
    solved = Simulation(column(20), stop="residual", tolerance=1e-13, max_iterations=100_000)
    assert solved.step().converged
    bound = certify(solved)
    assert bound.error is None
    assert 0.0 < bound.solver_error <= bound.at_most <= 2.0 * bound.solver_error


def test_wrong_velocities_are_caught_and_nothing_is_changed() -> None:
    simulation, plain = (Simulation("annulus", stop="residual", tolerance=1e-12) for _ in range(2))
    for _ in range(40):
        report = simulation.step()
        plain.step()
        assert certify(simulation).error is None
    assert report.contacts > 5
    assert np.array_equal(plain.velocity, simulation.velocity)
    simulation._engine.records.array(0, "grains.velocity")[7, 1] += 1e-5
    bound = certify(simulation)
    assert bound.error == pytest.approx(1e-5, abs=bound.solver_error)


def test_it_is_the_last_step_that_is_certified() -> None:
    simulation, restarts = Simulation(bullet(), threads=2), 0
    for _ in range(6):
        start = simulation.state()
        restarts += simulation.step().restarts
        begun = simulation.last_start()
        assert np.array_equal(begun.position, start.position)
        assert np.array_equal(begun.velocity, start.velocity)
        assert begun.staggered == start.staggered
        assert certify(simulation).at_most >= 0.0
    assert restarts > 0


def test_at_a_round_wall_the_fixed_point_is_certified() -> None:
    """Gaps that follow the exact velocities lead, from those of the free ones, to the step's own."""
    scene = Scene.load("no_inner_wall").replace(**SECOND_ORDER)
    simulation = Simulation(scene, method="accelerated", **SOLVED)
    for _ in range(30):
        assert simulation.step().converged
    bound = certify(simulation)
    problem = StepProblem(scene, *simulation.last_start())
    assert problem.staggered
    slide, change = problem.free_velocity, [np.inf]
    while change[-1] > bound.solver_error:
        exact = solve_exactly(problem, slide)
        change.append(np.abs(exact.velocity - slide).max())
        slide = exact.velocity
    # the changes shrink to less than a half each time: what is left is less than the last of them
    assert len(change) > 3
    assert max(new / old for old, new in itertools.pairwise(change[1:-1])) < 0.5
    assert np.abs(slide - simulation.velocity).max() <= 2.0 * (change[-1] + exact.error + bound.at_most)
    tangent = solve_exactly(replace(problem, scene=scene.replace(wall="tangent")), slide)
    assert np.abs(tangent.velocity - slide).max() > 1e3 * (tangent.error + bound.at_most)


def test_a_step_that_failed_is_not_the_last_one() -> None:
    simulation = Simulation(column(3))
    with pytest.raises(SimulationError, match="no step has been taken"):
        certify(simulation)
    simulation.step()
    state = simulation.state()
    simulation._engine.records.array(0, "grains.velocity")[:] = np.inf
    with pytest.raises(SimulationError, match="reached a velocity"):
        simulation.step()
    begun = simulation.last_start()
    assert np.array_equal(begun.position, column(3).position)
    assert np.array_equal(begun.velocity, np.zeros((3, 2)))
    simulation.restore(state)
    with pytest.raises(SimulationError, match="no step has been taken"):
        certify(simulation)


def test_what_cannot_be_certified_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two grains, one behind the other, are together wider than the room between the walls; no library."""
    position = [[0.66, 0.0], [0.94, 0.0]]
    tight = Scene(position=position, radius=0.16, mass=1.0, radius_in=0.5, radius_out=1.1, max_iterations=10)
    simulation = Simulation(tight)
    simulation.step()
    with pytest.raises(SimulationError, match="no velocities satisfy every gap"):
        certify(simulation)
    monkeypatch.setitem(sys.modules, "clarabel", None)
    monkeypatch.delitem(sys.modules, "warpgrains.accuracy.exact_step")
    with pytest.raises(InputError, match=r"certify needs clarabel: pip install 'matplotlib>="):
        certify(simulation)


@pytest.mark.parametrize("periodic", ["", "x", "xy"])
def test_pairs_within_reach_are_those_of_all_pairs(periodic: str) -> None:
    rng = np.random.default_rng(0)
    position, radius = rng.uniform(-1.0, 1.0, (60, 2)), 10.0 ** rng.uniform(-3.0, -0.5, 60)
    reach = 10.0 ** rng.uniform(-4.0, 0.0, 60)
    scene = Scene(position=position, radius=radius, mass=1.0, domain=Box((-1.0, 1.0), (-1.0, 1.0), periodic))
    i, j = np.triu_indices(60, 1)
    way = position[j] - position[i]
    for d, name in enumerate("xy"):
        if name in periodic:
            way[:, d] = (way[:, d] + 1.0) % 2.0 - 1.0
    gap = np.hypot(*way.T) - (radius[i] + radius[j])
    near = gap <= reach[i] + reach[j]
    assert 0 < near.sum() < len(i)
    assert np.array_equal(pairs_within(scene, position, reach), np.stack([i[near], j[near]], axis=1))


WITH_FRICTION: dict[str, Any] = {"friction": 0.4, "wall_friction": 0.2}
WITH_FRICTION |= {"angular_velocity_out": 2.0, "angular_velocity_in": -5.0}
ROUND: dict[str, Any] = {"scheme": "leapfrog", "wall": "round", "drag": 0.3, "spin_drag": 1e-3}


@pytest.mark.parametrize("changes", [{}, ROUND], ids=["text", "leapfrog, round"])
def test_a_solved_step_with_friction_is_the_minimizer(changes: dict[str, Any]) -> None:
    """The convex problem whose slip is frozen at the velocities has these as its solution."""
    scene = crowd(2, **WITH_FRICTION, **changes)
    solved = Simulation(scene, tolerance=1e-13, max_iterations=100_000)
    for _ in range(4):
        assert solved.step().converged
    bound = certify(solved)
    # the solver stops at changes of 1e-13 m/s, and velocities of 30 m/s are rounded in every correction
    assert bound.at_most <= bound.solver_error + 1e-9
    assert bound.solver_error <= 1e-5  # the root of a duality gap of 1e-14, times speeds of up to 100 m/s
    unsolved = Simulation(scene, tolerance=0.0, max_iterations=2)
    unsolved.advance(4)
    assert (certify(unsolved).error or 0.0) > 1e-3
