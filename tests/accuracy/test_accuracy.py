"""The true error of a step: exact velocities against closed forms and the twin, and what is refused."""

import itertools
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from same_bits import at_annulus
from sample_scenes import bullet
from schemes import SECOND_ORDER

from warpgrains import Box, InputError, Scene, Simulation, SimulationError
from warpgrains.accuracy import certify
from warpgrains.accuracy.exact_step import ExactStep, StepProblem, pairs_within, solve_exactly

DT = 0.01
EPS = np.finfo(float).eps


def exact_first_step(scene: Scene) -> ExactStep:
    return solve_exactly(StepProblem(scene, scene.position, scene.velocity), scene.velocity)


def assert_exact(scene: Scene, expected: np.ndarray) -> None:
    """The velocities are the expected ones, to within what is claimed and what b = gap / dt rounds."""
    exact = exact_first_step(scene)
    rounding = 8.0 * EPS * scene.n * (scene.radius_out / scene.dt + np.abs(expected).max())
    # The gap of a projection that is solved to a relative 1e-14 of it: its root is some 1e-7 of the speeds.
    assert exact.error <= 1e-6 * max(1.0, np.abs(expected).max())
    assert np.abs(exact.velocity - expected).max() <= exact.error + rounding


def column(n: int) -> Scene:
    """Grains at rest, one on the other, on the outer wall."""
    y = -2.0 + 0.05 + 0.1 * np.arange(n)
    return Scene(position=np.stack([np.zeros(n), y], axis=1), radius=0.05, mass=0.1, radius_out=2.0, dt=DT)


class TestExactVelocities:
    def test_a_column_rests(self) -> None:
        """All gaps are 0 but for rounding, and so are all velocities."""
        assert_exact(column(20), np.zeros((20, 2)))

    def test_a_blow_is_passed_on_to_grains_that_seemed_out_of_reach(self) -> None:
        """v_0 = v_1, v_1 - v_2 = gap / dt, and the sum of all three is kept."""
        v, gap = 3.0, 0.002
        x = np.array([[0.5, 0.0], [0.7, 0.0], [0.9 + gap, 0.0]])
        start = np.array([[v, 0.0], [0.0, 0.0], [0.0, 0.0]])
        scene = Scene(
            position=x, velocity=start, radius=0.1, mass=0.2, radius_out=5.0, gravity=(0.0, 0.0), dt=DT
        )
        last = (v - 2.0 * gap / DT) / 3.0
        assert_exact(scene, np.array([[last + gap / DT, 0.0], [last + gap / DT, 0.0], [last, 0.0]]))

    def test_error_is_that_of_the_lightest_grain(self) -> None:
        """A heavy grain that rests far away makes no other velocity more certain."""
        alone = crowd(np.random.default_rng(0)).replace(gravity=(0.0, 0.0), radius_out=9.0)
        beside = alone.replace(
            position=np.vstack([alone.position, [8.0, 0.0]]),
            velocity=np.vstack([alone.velocity, [0.0, 0.0]]),
            radius=np.append(alone.radius, 0.1),
            mass=np.append(alone.mass, 1e12),
        )
        # The same problem, but for the library's rounding; by its mass it would be a millionth.
        assert exact_first_step(beside).error >= 0.1 * exact_first_step(alone).error


def crowd(rng: np.random.Generator) -> Scene:
    """Thirty grains of unlike sizes that touch nothing yet and run into one another and both walls."""
    angle = 2.0 * np.pi * (np.arange(30) % 10) / 10 + rng.uniform(0.0, 0.05, 30)
    rho = 0.75 + 0.45 * (np.arange(30) // 10) + rng.uniform(0.0, 0.05, 30)
    return Scene(
        position=rho[:, np.newaxis] * np.stack([np.cos(angle), np.sin(angle)], axis=1),
        velocity=rng.normal(0.0, 30.0, (30, 2)),
        radius=rng.uniform(0.15, 0.2, 30),
        mass=rng.uniform(0.1, 1.0, 30),
        radius_in=0.5,
        radius_out=2.0,
        dt=DT,
    )


class TestCertify:
    def test_error_is_the_difference_from_the_closed_form(self) -> None:
        simulation = Simulation(column(20), max_iterations=10)
        assert not simulation.step().converged
        certificate = certify(simulation)
        assert certificate.error == pytest.approx(
            np.abs(simulation.velocity).max(), abs=certificate.solver_error
        )
        assert certificate.error > 100.0 * certificate.solver_error
        assert certificate.at_most == certificate.error + certificate.solver_error

    def test_error_below_that_of_the_solver_is_not_named(self) -> None:
        simulation = Simulation(column(20), stop="residual", tolerance=1e-13, max_iterations=100_000)
        assert simulation.step().converged
        certificate = certify(simulation)
        assert certificate.error is None
        assert 0.0 < certificate.solver_error <= certificate.at_most <= 2.0 * certificate.solver_error

    @pytest.mark.parametrize("wrong", [1e-3, 1e-5])
    def test_wrong_velocities_are_caught(self, wrong: float) -> None:
        simulation = Simulation(Scene.load("annulus"), stop="residual", tolerance=1e-12)
        for _ in range(40):
            report = simulation.step()
        assert report.contacts > 5
        assert certify(simulation).error is None
        velocity = simulation._engine.records.array(0, "grains.velocity")
        velocity[7, 1] += wrong
        certificate = certify(simulation)
        assert certificate.error == pytest.approx(wrong, abs=certificate.solver_error)

    @pytest.mark.parametrize("threads", [1, 2])
    def test_it_is_the_last_step_that_is_certified(self, threads: int) -> None:
        simulation = Simulation(bullet(), threads=threads)
        restarts = 0
        for _ in range(6):
            start = simulation.state()
            restarts += simulation.step().restarts
            begun = simulation.last_start()
            assert np.array_equal(begun.position, start.position)
            assert np.array_equal(begun.velocity, start.velocity)
            assert begun.staggered == start.staggered
            assert certify(simulation).at_most >= 0.0
        assert restarts > 0

    def test_at_a_round_wall_the_fixed_point_is_certified(self) -> None:
        """Gaps that follow the exact velocities lead, from those of the free ones, to the step's own."""
        scene = Scene.load("no_inner_wall").replace(**SECOND_ORDER)
        simulation = Simulation(scene, method="accelerated", tolerance=1e-12, max_iterations=100_000)
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

    def test_drag_at_the_midpoint(self) -> None:
        """Contacts share by masses of which drag dt / 2 is half a kg, where grains have 0.1 to 1 kg."""
        scene = crowd(np.random.default_rng(1)).replace(drag=100.0, scheme="leapfrog")
        simulation = Simulation(scene, method="accelerated", tolerance=1e-12, max_iterations=100_000)
        for _ in range(5):
            assert simulation.step().converged
            assert simulation.contacts().force.max(initial=0.0) + at_annulus(simulation).force.max() > 1.0
            bound = certify(simulation)
            assert bound.at_most - bound.solver_error <= 1e-9  # the difference, of speeds of 30 m/s

    def test_it_changes_nothing(self) -> None:
        plain, certified = (Simulation(Scene.load("annulus")) for _ in range(2))
        for _ in range(60):
            plain.step()
            certified.step()
            certify(certified)
        assert np.array_equal(plain.velocity, certified.velocity)

    def test_a_step_that_failed_is_not_the_last_one(self) -> None:
        simulation = Simulation(column(3))
        simulation.step()
        simulation._engine.records.array(0, "grains.velocity")[:] = np.inf
        with pytest.raises(SimulationError, match="reached a velocity"):
            simulation.step()
        begun = simulation.last_start()
        assert np.array_equal(begun.position, column(3).position)
        assert np.array_equal(begun.velocity, np.zeros((3, 2)))

    def test_no_step(self) -> None:
        simulation = Simulation(column(2))
        with pytest.raises(SimulationError, match="no step has been taken"):
            certify(simulation)
        simulation.step()
        simulation.restore(simulation.state())
        with pytest.raises(SimulationError, match="no step has been taken"):
            certify(simulation)

    def test_grains_that_do_not_fit(self) -> None:
        """Two grains, one behind the other, that are together wider than the room between the walls."""
        scene = Scene(
            position=[[0.66, 0.0], [0.94, 0.0]],
            radius=0.16,
            mass=1.0,
            radius_in=0.5,
            radius_out=1.1,
            max_iterations=10,
        )
        simulation = Simulation(scene)
        simulation.step()
        with pytest.raises(SimulationError, match="no velocities satisfy every gap"):
            certify(simulation)

    def test_missing_library_is_named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        simulation = Simulation(column(2))
        simulation.step()
        monkeypatch.setitem(sys.modules, "clarabel", None)
        monkeypatch.delitem(sys.modules, "warpgrains.accuracy.exact_step")
        with pytest.raises(InputError, match=r"certify needs clarabel: pip install 'matplotlib>="):
            certify(simulation)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("periodic", ["", "x", "xy"])
def test_pairs_within_reach_are_those_of_all_pairs(seed: int, periodic: str) -> None:
    rng = np.random.default_rng(seed)
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


WITH_FRICTION = {
    "friction": 0.4,
    "wall_friction": 0.2,
    "angular_velocity_out": 2.0,
    "angular_velocity_in": -5.0,
}
ROUND: dict[str, Any] = {"scheme": "leapfrog", "wall": "round", "drag": 0.3, "spin_drag": 1e-3}


@pytest.mark.parametrize("changes", [{}, ROUND], ids=["text", "leapfrog, round"])
def test_a_solved_step_with_friction_is_the_minimizer(changes: dict[str, Any]) -> None:
    """The convex problem whose slip is frozen at the velocities has these as its solution."""
    scene = crowd(np.random.default_rng(2)).replace(**WITH_FRICTION, **changes, tolerance=1e-13)
    simulation = Simulation(scene.replace(max_iterations=100_000))
    for _ in range(4):
        assert simulation.step().converged
    bound = certify(simulation)
    # the solver stops at changes of 1e-13 m/s, and velocities of 30 m/s are rounded in every correction
    assert bound.at_most <= bound.solver_error + 1e-9
    assert bound.solver_error <= 1e-5  # the root of a duality gap of 1e-14, times speeds of up to 100 m/s


def test_an_unsolved_step_with_friction_is_not() -> None:
    scene = crowd(np.random.default_rng(2)).replace(**WITH_FRICTION, tolerance=0.0, max_iterations=2)
    simulation = Simulation(scene)
    simulation.advance(4)
    bound = certify(simulation)
    assert bound.error is not None
    assert bound.error > 1e-3
