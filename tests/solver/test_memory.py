"""What does not fit in memory is refused, with an estimate that covers what is allocated."""

from dataclasses import replace

import numpy as np
import pytest
from same_bits import contents

from warpgrains import Scene, Simulation, SimulationError
from warpgrains.solver import memory, sizes
from warpgrains.solver.records import SceneRecords


def test_a_scene_that_does_not_fit_is_refused_with_the_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "free_memory", lambda _: 50_000.0)
    scene = Scene.load("pile")
    expected = "1000 grains and their contacts need 0.00 GB, and cpu has 0.00 GB free"
    with pytest.raises(SimulationError, match=expected):
        Simulation(scene)


def test_a_list_that_grows_out_of_memory_leaves_the_last_state(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sizes, "first_pairs", lambda n: n // 2)
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


def test_a_repeated_search_that_runs_out_of_memory_leaves_the_last_state(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Rows of the first search are written already, and are not joined with the contacts of the last list."""
    simulation = Simulation(Scene.load("annulus"), threads=1)
    simulation.advance(300)
    state = simulation.state()
    apart = np.linalg.norm(state.position[:, np.newaxis] - state.position, axis=2)
    pairs = np.unique(np.sort(np.stack([np.arange(15), apart.argmax(axis=1)], axis=1)), axis=0)
    corrections = replace(
        state.corrections,
        pair=pairs.astype(np.int32),
        pair_correction=np.full(len(pairs), 1e-3),
        wall=np.zeros((0, 2), np.int32),
        wall_correction=np.zeros(0),
    )
    simulation.restore(replace(state, lists=None, corrections=corrections))
    before = contents(simulation.state().corrections)
    reserve = SceneRecords.reserve_contacts

    def refuse(records: SceneRecords, k: int, count: int) -> None:
        if count > len(records.array(k, "neighbors.found")):
            raise SimulationError(f"no memory for {count}")
        reserve(records, k, count)

    with monkeypatch.context() as patch:
        patch.setattr(SceneRecords, "reserve_contacts", refuse)
        with pytest.raises(SimulationError, match="no memory"):
            simulation.step()
    assert contents(simulation.state().corrections) == before
    undisturbed = Simulation(simulation.scene, threads=1)
    undisturbed.restore(replace(state, lists=None, corrections=corrections))
    assert contents(simulation.step()) == contents(undisturbed.step())
    assert np.array_equal(simulation.position, undisturbed.position)
