"""What does not fit in memory is refused, with an estimate that covers what is allocated."""

import numpy as np
import pytest

from warpgrains import Scene, Simulation, SimulationError
from warpgrains.solver import memory
from warpgrains.solver.buffers import ContactBuffers


def test_a_scene_that_does_not_fit_is_refused_with_the_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "free_memory", lambda _: 50_000.0)
    scene = Scene.load("pile")
    expected = "1000 grains with 4000 candidate pairs need about 0.00 GB, and cpu has 0.00 GB free"
    with pytest.raises(SimulationError, match=expected):
        Simulation(scene)


def test_a_list_that_grows_out_of_memory_leaves_the_last_state(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation(Scene.load("polydisperse"), threads=1)
    monkeypatch.setattr(memory, "free_memory", lambda _: 1.0)
    with pytest.raises(SimulationError, match=r"0 grains with \d+ candidate pairs need about"):
        simulation.run(steps=100)
    assert np.isfinite(simulation.position).all()


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated"])
def test_the_estimate_covers_the_buffers(threads: int, method: str) -> None:
    scene = Scene.load("pile")
    heavy = scene.mass * [1.0 + k % 2 for k in range(scene.n)]
    simulation = Simulation(scene.replace(mass=heavy, method=method), threads=threads)
    simulation.run(steps=30)
    buffers: ContactBuffers = simulation._solver.contacts._buffers
    arrays = [getattr(owner, name) for owner, name in buffers._growing]
    lanes = simulation._solver.contacts._lanes
    if lanes is not None:
        arrays += [lanes._lanes.turn, buffers.contacts.turn_after]
    held = sum(array.shape[0] * array.strides[0] for array in arrays)
    capacity = buffers._capacity + 2
    assert capacity > 1000
    assert held <= memory.BYTES_PER_PAIR * capacity
