"""Python threads: each may drive objects of its own, and none an object that another one drives."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import product
from threading import Barrier

import numpy as np
import pytest
from same_bits import run_of
from trimmed import trimmed

from warpgrains import Batch, Scene, Simulation, SimulationError
from warpgrains.scene.fields import ORDERS

KINDS = [*product(("annulus", "column"), ("gauss-seidel", "exact"), ORDERS)]


def end_of(k, start=None):
    """Return where the grains of the kind k are after some steps; odd kinds are advanced in batches."""
    if start is not None:
        start.wait()
    name, method, order = KINDS[k]
    scene = Scene.load(name).replace(method=method, order=order)
    one = Batch([scene], threads=1) if k % 2 else Simulation(scene, threads=1 + k % 4)
    one.run(steps=3)
    return (one.position(0) if isinstance(one, Batch) else one.position).tobytes()


def ends_together():
    """Build and advance all kinds at once, each in a Python thread; kernels are compiled meanwhile."""
    start, kinds = Barrier(len(KINDS)), range(len(KINDS))
    with ThreadPoolExecutor(len(KINDS)) as pool:
        together = [pool.submit(end_of, k, start) for k in kinds]
    assert [ended.result() for ended in together] == [end_of(k) for k in kinds]


@pytest.mark.slow
@pytest.mark.parametrize("attempt", range(max(1, trimmed(20) // 4)))
def test_eight_threads_that_compile_at_once(attempt, tmp_path):
    own = {"WARP_CACHE_PATH": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    program = "import test_python_threads as t; t.ends_together()"
    subprocess.run([sys.executable, "-c", program], check=True, env=os.environ | own)


def require_refusals(what, advance, calls):
    """Check that calls are refused while something is advanced: in another thread, and in its callback."""
    by = "by another thread or by the call that runs this callback"
    message = f"this {what} is being advanced, {by}: wait until it has ended, or use one {what} per thread"
    refused = []

    def refusal_of(call):
        with pytest.raises(SimulationError) as error:
            call()
        return str(error.value)

    def callback(_):
        with ThreadPoolExecutor(1) as pool:
            refused.extend(pool.map(refusal_of, calls))
        refused.extend(map(refusal_of, calls))

    advance(callback)
    assert set(refused) == {message}


class Observing:
    every = 5

    def __init__(self, callback):
        self.callback = callback

    def observe(self, simulation):
        assert simulation.state().steps == simulation.steps
        self.callback(simulation.steps)

    def flush(self): ...


WAYS = {
    "advance": lambda simulation, callback: simulation.advance(10, callback),
    "observer": lambda simulation, callback: simulation.run(steps=10, observer=Observing(callback)),
    "until": lambda simulation, callback: simulation.run(steps=10, until=callback),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_simulation_is_driven_by_one_thread(way):
    """Callbacks of a run may read it."""
    simulation = Simulation("annulus")
    state = simulation.state()
    calls = [
        simulation.step,
        lambda: simulation.advance(1),
        lambda: simulation.run(steps=1),
        lambda: simulation.change(drag=0.1),
        lambda: simulation.restore(state),
        *([simulation.state] if way == "advance" else []),
    ]
    require_refusals("simulation", partial(WAYS[way], simulation), calls)
    simulation.step()
    assert np.array_equal(simulation.position, run_of(Scene.load("annulus"), 11).position)


def test_a_batch_is_driven_by_one_thread():
    batch = Batch(["annulus"])
    state = batch.state(0)
    calls = [batch.step, lambda: batch.run(steps=1), lambda: batch.restore(0, state), lambda: batch.state(0)]

    def drive(callback):
        with batch._with_gravity(None):
            batch._advance([10], callback)

    require_refusals("batch", drive, calls)
    batch.step()
    assert batch.state(0).steps == 11
