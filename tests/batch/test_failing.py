"""Scenes of a batch that fail, batches that are interrupted or refused: the other scenes go on."""

import copy

import numpy as np
import pytest
from mixed import STEPS, Alone
from same_bits import contents

from warpgrains import Batch, Scene, Simulation, SimulationError
from warpgrains.batch import loaded_scenes
from warpgrains.solver import sizes

FAILING = 5  # of the mixed scenes


@pytest.mark.parametrize("shared", [False, True])
def test_a_scene_that_fails(
    scenes: list[Scene], expected: list[Alone], shared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a velocity of a grain that no step survives."""
    simulation = Simulation(scenes[FAILING], threads=1)
    simulation.run(steps=3)
    start = simulation.state()
    start.velocity[-1] = 1.7e308 * np.sign(start.position[-1])
    simulation.restore(start)
    with pytest.raises(SimulationError) as failure:
        simulation.step()
    if shared:
        monkeypatch.setattr(loaded_scenes, "paying_threads", lambda one: 1 + (one is scenes[FAILING]))
    batch = Batch(scenes[:8], threads=2)
    batch.restore(FAILING, start)
    summaries = batch.run(steps=STEPS)
    assert [summary.error for summary in summaries] == [None] * FAILING + [str(failure.value)] + [None] * 2
    assert summaries[FAILING].steps == 0
    assert contents(batch.state(FAILING)) == contents(simulation.state())
    others = [k for k in range(8) if k != FAILING]
    for k in others:
        assert contents(batch.state(k)) == contents(expected[k][0])
    with pytest.raises(SimulationError, match=f"scene {FAILING}: step 4, from t = .*reached a velocity"):
        batch.step()
    assert [batch.state(k).steps for k in others] == [STEPS + 1] * 7


def test_the_report_after_a_failure_is_that_of_the_last_good_step() -> None:
    scene = Scene.load("annulus").replace(max_iterations=3, on_unconverged="raise")
    batch, alone = Batch([scene], threads=1), Simulation(scene, threads=1)
    (failed,) = batch.run(steps=STEPS)
    reports = [alone.step() for _ in range(failed.steps)]
    assert failed.error is not None
    assert batch.reports[0] == reports[-1]


def test_an_interrupted_run_leaves_every_scene_between_two_steps(
    scenes: list[Scene], expected: list[Alone], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sizes, "first_pairs", np.ones_like)
    batch = Batch(scenes, threads=2)

    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        batch._loaded.advance([STEPS] * len(scenes), interrupt)
    for k in range(len(scenes)):
        batch.restore(k, batch.state(k))
    left = [STEPS - batch.state(k).steps for k in range(len(scenes))]
    batch._loaded.advance(left, lambda _: None)
    for k, (state, _, _) in enumerate(expected):
        assert contents(batch.state(k)) == contents(state)


def test_scenes_that_do_not_fit_in_memory_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    annulus = Scene.load("annulus")
    four = [annulus, annulus.replace(method="accelerated")] * 2
    for free, scenes, message in (
        (1_000.0, [annulus], "15 grains and their contacts need 0.00 GB, and cpu has 0.00 GB free$"),
        (82_000.0, four, "60 grains .*: the first 3 of 4 scenes fit$"),
    ):
        monkeypatch.setattr("warpgrains.solver.memory.free_memory", lambda _, free=free: free)
        with pytest.raises(SimulationError, match=message):
            Batch(scenes)


def test_overlaps_at_the_start_are_reported_once() -> None:
    """Of the worst scene, and not again by a copy."""
    annulus = Scene.load("annulus")
    narrow = [annulus.replace(position=factor * annulus.position, radius_in=0.0) for factor in (0.7, 0.6)]
    with pytest.warns(UserWarning, match=r"^scene 2: grains overlap by up to .* m at the start") as said:
        copy.deepcopy(Batch([annulus, *narrow]))
    assert len(said) == 1
