"""An interrupt reaches a long step, and leaves the last good state."""

import os
import signal
import threading
from collections.abc import Iterator
from time import perf_counter

import numpy as np
import pytest
from same_bits import contents

from warpgrains import Batch, Scene, Simulation

ENDLESS = {"tolerance": 0.0, "max_iterations": 2_000_000_000}


@pytest.fixture(autouse=True)
def interrupts_are_pythons_own() -> Iterator[None]:
    """Libraries that other tests import have handlers of their own."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupt_soon() -> None:
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()


@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated"])
@pytest.mark.parametrize("threads", [1, 2])
def test_one_endless_step(method: str, threads: int) -> None:
    started = Simulation(Scene.load("polydisperse"), method=method)
    started.run(steps=60)
    Simulation(started.scene, threads=threads).step()  # so that nothing has to be compiled
    simulation = Simulation(started.scene.replace(**ENDLESS), threads=threads)
    simulation.restore(started.state())
    start = perf_counter()
    interrupt_soon()
    with pytest.raises(KeyboardInterrupt):
        simulation.step()
    assert perf_counter() - start < 2.0  # a tenth of a second, and what a busy machine takes
    assert contents(simulation.state().corrections) == contents(started.state().corrections)
    assert np.array_equal(simulation.velocity, started.velocity)
    started.restore(simulation.state())
    started.step()
    expected = Simulation(Scene.load("polydisperse"), method=method)
    expected.run(steps=61)
    assert np.array_equal(started.velocity, expected.velocity)


def test_an_endless_batch() -> None:
    Simulation(Scene.load("annulus")).step()  # so that nothing has to be compiled
    batch = Batch([Scene.load("polydisperse").replace(**ENDLESS), Scene.load("annulus")], threads=2)
    interrupt_soon()
    with pytest.raises(KeyboardInterrupt):
        batch.run(steps=100)
    assert batch.state(0).steps < 100
    assert batch.state(1).steps == 100


def test_a_forked_child_goes_on() -> None:
    simulation = Simulation(Scene.load("annulus"), threads=2)
    simulation.step()
    child = os.fork()
    if child == 0:
        simulation.run(steps=10)
        os._exit(0 if simulation.steps == 11 else 1)
    assert os.waitpid(child, 0)[1] == 0
