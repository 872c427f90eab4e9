"""Zeta and residual of every iteration of a step: exact, and without another step than the one taken."""

from copy import copy

import pytest
from same_bits import contents
from sample_scenes import bullet, dense_start, random_scene

from warpgrains import Scene, Simulation

CASES = {
    "annulus": {},
    "colors": {"order": "color"},
    "accelerated": {"method": "accelerated", "order": "color"},
    "accelerated to zeta": {"method": "accelerated", "stop": "zeta"},
    "to the residual": {"stop": "residual"},
    "exact": {"method": "exact", "tolerance": 1e-9, "max_iterations": 1000},
    "cut off": {"max_iterations": 7, "tolerance": 0.0},
}


def pile(**overrides: object) -> Simulation:
    simulation = Simulation(random_scene(1), **{"tolerance": 1e-6, "max_iterations": 200, **overrides})
    simulation.advance(20)
    return simulation


@pytest.mark.parametrize("case", CASES)
def test_the_step_is_the_same(case: str) -> None:
    plain, told = pile(**CASES[case]), pile(**CASES[case])
    for _ in range(10):
        without, report = plain.step(), told.step(history=True)
        assert without.history is None
        assert report == without
        assert contents(told.state()) == contents(plain.state())
        history = report.history
        assert history is not None
        assert len(history.zeta) == len(history.residual) == report.iterations
        if report.factorizations == 0:
            assert (history.zeta[-1], history.residual[-1]) == (report.zeta, report.residual)
    assert told.step().history is None
    plain.advance(1)
    assert contents(told.state()) == contents(plain.state())


def test_exact_step_is_the_same_after_a_rejected_sweep() -> None:
    """After sweep 100 of the fourth step, a rejected one, only the history needs the residual."""
    plain = Simulation(dense_start(2, 0.7, method="exact", tolerance=1e-9, max_iterations=3000))
    plain.advance(3)
    told = copy(plain)
    assert told.step(history=True) == plain.step()
    assert contents(told.state()) == contents(plain.state())


@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated"])
def test_entries_are_what_a_step_cut_off_there_reports(method: str) -> None:
    simulation = Simulation(Scene.load("annulus"), method=method, tolerance=1e-4)
    simulation.advance(45)
    state = simulation.state()
    history = simulation.step(history=True).history
    assert history is not None
    assert len(history.zeta) > 5
    for k, entry in enumerate(zip(*history, strict=True), start=1):
        cut = Simulation(simulation.scene, max_iterations=k)
        cut.restore(state)
        report = cut.step()
        assert (report.iterations, report.zeta, report.residual) == (k, *entry)


def test_a_step_that_is_solved_again_tells_of_the_last_attempt() -> None:
    simulation, redone = Simulation(bullet()), 0
    for _ in range(30):
        report = simulation.step(history=True)
        redone += report.restarts
        assert report.history is not None
        assert (len(report.history.zeta), report.history.zeta[-1]) == (report.iterations, report.zeta)
    assert redone > 0


def test_history_of_a_step_that_the_host_solves_ends_with_its_residual():
    simulation = Simulation(Scene.load("annulus"), method="exact", max_iterations=40, tolerance=1e-10)
    simulation.advance(260)
    solved = 0
    for _ in range(8):
        report = simulation.step(history=True)
        assert report.history.residual[-1] == report.residual
        solved += report.factorizations
    assert solved > 0
