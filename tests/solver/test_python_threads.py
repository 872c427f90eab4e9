"""Python threads: each may drive objects of its own, and none an object that another one drives."""

import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trimmed import trimmed

from warpgrains import Batch, Scene, Simulation, SimulationError

MANY = Path(__file__).parents[1] / "support" / "many_threads.py"


@pytest.mark.slow
@pytest.mark.parametrize("attempt", range(max(1, trimmed(20) // 4)))
def test_eight_threads_that_compile_at_once(attempt: int, tmp_path: Path) -> None:
    environment = {**os.environ, "WARP_CACHE_PATH": str(tmp_path)}
    done = subprocess.run([sys.executable, str(MANY)], capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stdout) == (0, "same bits\n"), done.stderr


def error_of(call: Callable[[], object]) -> str:
    with pytest.raises(SimulationError) as error:
        call()
    return str(error.value)


def errors_amid(
    advance: Callable[[Callable[[int], object]], object], calls: list[Callable[[], Any]]
) -> set[str]:
    """Return what calls raise while something is advanced: in another thread, and in its callback."""
    errors: set[str] = set()

    def callback(_: int) -> None:
        with ThreadPoolExecutor(1) as pool:
            errors.update(pool.map(error_of, calls))
        errors.update(map(error_of, calls))

    advance(callback)
    return errors


def messages(what: str) -> set[str]:
    by = "by another thread or by the call that runs this callback"
    return {f"this {what} is being advanced, {by}: wait until it has ended, or use one {what} per thread"}


def test_a_simulation_is_driven_by_one_thread() -> None:
    simulation, alone = (Simulation(Scene.load("annulus")) for _ in range(2))
    state = simulation.state()
    calls = [
        simulation.step,
        lambda: simulation.advance(1),
        lambda: simulation.run(steps=1),
        lambda: simulation.change(drag=0.1),
        lambda: simulation.restore(state),
        simulation.state,
    ]
    assert errors_amid(lambda callback: simulation.advance(10, callback), calls) == messages("simulation")
    simulation.step()
    alone.run(steps=11)
    assert simulation.steps == 11
    assert np.array_equal(simulation.position, alone.position)


def test_a_batch_is_driven_by_one_thread() -> None:
    batch = Batch([Scene.load("annulus")])
    state = batch.state(0)
    calls = [batch.step, lambda: batch.run(steps=1), lambda: batch.restore(0, state), lambda: batch.state(0)]
    found = errors_amid(lambda callback: batch._advance([10], None, callback), calls)
    assert found == messages("batch")
    batch.step()
    assert batch.state(0).steps == 11


def test_an_observer_may_read_what_it_observes() -> None:
    class Keep:
        every = 1

        def __init__(self) -> None:
            self.states: list[int] = []

        def observe(self, simulation: Simulation) -> None:
            self.states.append(simulation.state().steps)

        def flush(self) -> None: ...

    simulation = Simulation(Scene.load("annulus"))
    keep = Keep()
    simulation.run(steps=2, observer=keep)
    assert keep.states == [0, 1, 2]
