"""The same bits for any number of workers, any way of launching, and any care taken with lists."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from time import sleep, thread_time

import numpy as np
import pytest
from launched import launched_state
from schemes import SECOND_ORDER

from warpgrains import Scene, Simulation, State
from warpgrains.scene.fields import METHODS, ORDERS
from warpgrains.solver import tuning

STEPS = 24  # a step is solved again in the 18th


def scene(order: str, method: str = "gauss-seidel") -> Scene:
    """Return eighty grains of many sizes that fall, knock and settle."""
    return Scene.load("polydisperse").replace(order=order, method=method, max_iterations=100)


def final_state(order: str, method: str = "gauss-seidel", steps: int = STEPS, **options: int) -> State:
    simulation = Simulation(scene(order, method), **options)
    simulation.run(steps=steps)
    return simulation.state()


@pytest.fixture(scope="module", params=ORDERS)
def order(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module", params=METHODS)
def method(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def expected(order: str, method: str) -> State:
    return final_state(order, method, threads=1)


def assert_same_bits(state: State, expected: State) -> None:
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)
    assert np.array_equal(state.corrections.pair, expected.corrections.pair)
    assert np.array_equal(state.corrections.pair_correction, expected.corrections.pair_correction)
    for name in ("wall", "wall_correction"):
        assert np.array_equal(getattr(state.corrections, name), getattr(expected.corrections, name))


def assert_same_lists(state: State, expected: State) -> None:
    for name, listed in vars(expected.lists).items():
        assert np.array_equal(getattr(state.lists, name), listed)


@pytest.mark.parametrize(("threads", "steps"), [(2, STEPS), (3, 18)])
def test_threads(order: str, method: str, threads: int, steps: int) -> None:
    state, expected = (final_state(order, method, steps, threads=count) for count in (threads, 1))
    assert_same_bits(state, expected)
    assert_same_lists(state, expected)


def test_a_thread_that_waits_sleeps() -> None:
    """A second thread is launched alone: it waits for the first, which has nothing to do."""
    engine = Simulation(scene("sequential"), threads=2)._engine
    first, second = engine.tasks(2)

    def wait() -> float:
        begun = thread_time()
        second()
        return thread_time() - begun

    with ThreadPoolExecutor(1) as pool:
        waited = pool.submit(wait)
        sleep(0.5)
        assert not waited.done()
        first()
        assert waited.result() < 0.1


def test_threads_continue_alike_from_a_state_without_lists(order: str) -> None:
    settled = Simulation(Scene.load("annulus"), order=order)
    settled.run(steps=300)
    assert settled.state().corrections.wall_correction.any()
    ends = []
    for threads in (1, 2):
        simulation = Simulation(settled.scene, threads=threads)
        simulation.restore(replace(settled.state(), lists=None))
        simulation.step()
        ends.append(simulation.state())
    assert_same_bits(*ends)
    assert_same_lists(*ends)


def test_a_launch_for_every_stage_as_on_a_gpu(order: str, method: str) -> None:
    """Of a scene that falls, and of one that lies in a bowl, by the other scheme and wall."""
    bowl = Scene.load("no_inner_wall").replace(max_iterations=30, **SECOND_ORDER)
    for launched, steps in ((scene(order, method), 18), (bowl.replace(order=order, method=method), 5)):
        simulation = Simulation(launched, threads=1)
        simulation.advance(steps)
        assert_same_bits(launched_state(launched, steps), simulation.state())


@pytest.fixture(scope="module")
def expected_in_sequence() -> State:
    return final_state("sequential", threads=1)


def test_no_list_is_used_for_two_steps(expected_in_sequence: State, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tuning, "BASE_SKIN", 1e-12)
    simulation = Simulation(scene("sequential"), threads=1)
    rebuilds = [simulation.step().rebuilds for _ in range(STEPS)]
    assert min(rebuilds) >= 1
    assert_same_bits(simulation.state(), expected_in_sequence)


def test_lists_are_used_again(order: str) -> None:
    simulation = Simulation(scene(order), threads=1)
    assert 0 in [simulation.step().rebuilds for _ in range(STEPS)]


def test_every_sweep_is_monitored(expected_in_sequence: State, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tuning, "MONITOR_THRESHOLD", 0.0)
    assert_same_bits(final_state("sequential", threads=1), expected_in_sequence)


def test_a_restored_state_continues_as_if_nothing_had_been(order: str, method: str, expected: State) -> None:
    first = Simulation(scene(order, method), threads=1)
    first.run(steps=STEPS // 2)
    second = Simulation(scene(order, method), threads=1)
    second.restore(first.state())
    reports = [second.step() for _ in range(STEPS // 2)]
    assert_same_bits(second.state(), expected)
    assert reports == [first.step() for _ in range(STEPS // 2)]


def test_simulations_side_by_side(expected_in_sequence: State) -> None:
    """Each in a Python thread of its own: what one captures must not take in what another launches."""
    with ThreadPoolExecutor(2) as pool:
        ends = [pool.submit(partial(final_state, "sequential", threads=1)) for _ in range(8)]
        for end in ends:
            assert_same_bits(end.result(), expected_in_sequence)
