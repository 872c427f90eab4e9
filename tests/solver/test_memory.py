"""What does not fit in memory is refused, with an estimate that covers what is allocated."""

import numpy as np
import pytest
from same_bits import contents

from warpgrains import Scene, Simulation, SimulationError
from warpgrains.solver import memory, sizes


def test_a_scene_that_does_not_fit_is_refused_with_the_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "free_memory", lambda _: 50_000.0)
    scene = Scene.load("pile")
    expected = "1000 grains and their contacts need 0.00 GB, and cpu has 0.00 GB free"
    with pytest.raises(SimulationError, match=expected):
        Simulation(scene)


def test_a_list_that_grows_out_of_memory_leaves_the_last_state(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sizes, "first_contacts", lambda n: 3 * n // 2)
    simulation = Simulation(Scene.load("polydisperse"), threads=1)
    monkeypatch.setattr(memory, "free_memory", lambda _: 1.0)
    with pytest.raises(SimulationError, match=r"step \d+, .*80 grains and their contacts need"):
        simulation.run(steps=100)
    monkeypatch.undo()
    steps, undisturbed = simulation.steps, Simulation(simulation.scene, threads=1)
    undisturbed.run(steps=steps)
    assert steps > 10
    assert contents(simulation.state().corrections) == contents(undisturbed.state().corrections)
    simulation.run(steps=20)
    undisturbed.run(steps=20)
    assert np.array_equal(simulation.position, undisturbed.position)
    assert np.array_equal(simulation.velocity, undisturbed.velocity)
