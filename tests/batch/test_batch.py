"""Many scenes together: each has the bits that it has alone, whatever is beside it."""

import warnings
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mixed import STEPS, Alone, alone
from same_bits import contents
from sample_scenes import random_scene

from warpgrains import Batch, Disc, InputError, Scene, Simulation, SimulationError
from warpgrains.base.warp_start import find_device
from warpgrains.batch import loaded_scenes
from warpgrains.batch.loaded_scenes import LoadedScenes
from warpgrains.scene.fields import METHODS
from warpgrains.solver import engine, sizes, threads

WAYS: dict[str, dict[str, Any]] = {
    "one thread": {"threads": 1},
    "three threads": {"threads": 3},
    "another order and company": {"chosen": np.random.default_rng(3).permutation(14)[:11].tolist()},
    "step by step": {"chosen": list(range(6)), "stepped": STEPS},
    "beside simulations in another thread": {"beside": 6},
    "lists that grow during a step": {"patched": (sizes, "first_pairs", np.ones_like), "stepped": 1},
    "large scenes that threads share": {
        "chosen": [1, 3, 7, 10, 12, 14],
        "patched": (loaded_scenes, "paying_threads", lambda scene: 1 + (scene.n > 20)),
        "stepped": 1,
    },
}


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_every_scene_as_alone(
    scenes: list[Scene], expected: list[Alone], way: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    if "patched" in way:
        monkeypatch.setattr(*way["patched"])
    chosen, stepped = way.get("chosen", range(len(scenes))), way.get("stepped", 0)
    batch = Batch([scenes[k] for k in chosen], threads=way.get("threads", 2))
    assert batch.reports == [None] * len(chosen)
    with ThreadPoolExecutor(1) as other:
        run = other.submit(batch.run, STEPS - stepped) if stepped < STEPS else None
        beside = [alone(scene) for scene in scenes[: way.get("beside", 0)]]
        summaries = [] if run is None else run.result()
    for _ in range(stepped):
        assert batch.step() == batch.reports
    for place, k in enumerate(chosen):
        state, statistics, report = expected[k]
        assert contents(batch.state(place)) == contents(state), f"scene {k}"
        assert np.array_equal(batch.position(place), state.position)
        assert np.array_equal(batch.velocity(place), state.velocity)
        assert batch.reports[place] == report
        if stepped == 0:
            assert summaries[place] == replace(statistics, seconds=summaries[place].seconds)
            assert summaries[place].seconds > 0.0
    assert [contents(one.state) for one in beside] == [contents(one.state) for one in expected[: len(beside)]]
    teams = {engine.team for engine, _ in batch._loaded._engines}
    assert teams == ({1, 2} if loaded_scenes in way.get("patched", ()) else {1})


def test_grains_of_all_scenes_as_one_array() -> None:
    """Of scenes of three kinds."""
    course = Scene.load("annulus")
    scenes = [course.replace(drag=drag, method=method) for drag in (0.1, 0.2) for method in METHODS[:2]]
    batch = Batch([*scenes, course.replace(pressure=1.0)], threads=2)
    assert np.array_equal(batch.position(), [course.position] * 5)
    batch.run(steps=STEPS)
    for whole, of_one in ((batch.position(), batch.position), (batch.velocity(), batch.velocity)):
        assert np.array_equal(whole, [of_one(k) for k in range(5)])
    with pytest.raises(InputError, match=r"the scenes have 15 to 200 grains: ask for one, position\(k\)"):
        Batch([course, Scene.load("bidisperse")]).position()


def test_gravity_chosen_by_the_states() -> None:
    """Each scene is drawn to the left of its center, then all as the first, and then they fall as before."""
    course = Scene.load("annulus")
    scenes = [course.replace(drag=drag) for drag in (0.1, 0.2, 0.5)]
    batch, alone = Batch(scenes, threads=2), [Simulation(scene) for scene in scenes]
    for k in range(40):
        center = batch.position().mean(axis=1)
        each = np.stack([-9.81 * center[:, 1], 9.81 * center[:, 0]], axis=1)
        gravity = each if k <= 20 else each[0] if k <= 30 else None
        batch.run(1, gravity=gravity) if k % 2 else batch.step(gravity)
        own = [scene.gravity for scene in scenes] if gravity is None else np.broadcast_to(gravity, (3, 2))
        for one, g in zip(alone, own, strict=True):
            one.change(gravity=tuple(g))
            one.step()
    assert np.array_equal(batch.position(), [one.position for one in alone])
    assert np.array_equal(batch.velocity(), [one.velocity for one in alone])


def test_scenes_with_other_numbers_of_grains_end_in_other_groups() -> None:
    """Other walls do not matter, because the arrays of grains have equal shapes."""
    course = Scene.load("annulus")
    few = course.replace(
        **{name: getattr(course, name)[:9] for name in ("position", "velocity", "radius", "mass", "spin")}
    )
    scenes = course, few, course.replace(walls=[Disc((0.0, -1.0), 0.1)])
    loaded = LoadedScenes(scenes, find_device("cpu"), threads=1)
    found = [(numbers, states.position.shape) for numbers, states in loaded.snapshots(range(3))]
    assert sorted(found) == [([0, 2], (2, 15, 2)), ([1], (1, 9, 2))]


def test_scenes_with_other_settings_share_their_grains(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are not checked again, and neither counted nor loaded one by one."""
    course = Scene.load("annulus")
    scenes = [course.replace(drag=0.1 + 0.001 * k, dt=0.005) for k in range(10)]
    assert all(scene.position is course.position for scene in scenes)
    again = [replace(scene) for scene in scenes]  # checked completely
    assert [contents(one) for one in again] == [contents(one) for one in scenes]
    counted: list[Scene] = []
    count = Scene.count_overlaps
    monkeypatch.setattr(Scene, "count_overlaps", lambda scene: counted.append(scene) or count(scene))
    monkeypatch.setattr(LoadedScenes, "load", None)
    Batch(again, threads=1)
    assert len(counted) == 1
    with pytest.raises(InputError, match="in one step, drag 100"):
        course.replace(drag=100.0)


def test_own_durations_and_other_spans() -> None:
    scene = Scene.load("annulus")
    batch = Batch([scene.replace(duration=0.1), scene.replace(duration=0.4, dt=0.02)], threads=1)
    assert [summary.steps for summary in batch.run()] == [10, 20]
    assert [summary.steps for summary in batch.run(duration=0.1)] == [10, 5]
    assert [batch.state(k).steps for k in range(2)] == [20, 25]


def test_what_is_canceled_goes_on_with_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """In color order, bits depend on the list: a step that is canceled must not make another one of it."""
    monkeypatch.setattr(engine, "BRIEF", 0)
    monkeypatch.setattr(threads, "GLANCE", 1e-4)
    scenes = [Scene.load("annulus", ["solver.order=color", "physics.drag=0.1"])]
    canceled, whole = (LoadedScenes(scenes, find_device("cpu"), threads=1) for _ in range(2))
    for _ in range(20):
        before = canceled.scenes[0].steps
        canceled.advance([10**6], lambda _: canceled.cancel())
        whole.advance([canceled.scenes[0].steps - before])
        assert contents(canceled.scenes[0].state()) == contents(whole.scenes[0].state())


@pytest.mark.parametrize("threads", [1, 2])
def test_rest_is_that_of_the_scene_alone(threads: int) -> None:
    """A scene ends where it ends alone, whatever the others do."""
    annulus = Scene.load("annulus")
    scenes = [annulus.replace(drag=drag) for drag in (0.5, 1.0)]
    scenes += [annulus.replace(duration=0.33), random_scene(3).replace(duration=0.2)]
    failing = annulus.replace(max_iterations=3, on_unconverged="raise")
    until, batch = "rest,speed=0.05,time=0.35", Batch([*scenes, failing], threads=threads)
    *summaries, failed = batch.run(until=until)
    simulation = Simulation(failing)
    with pytest.raises(SimulationError) as failure:
        simulation.run(until=until)
    assert (failed.steps, failed.met, failed.error) == (19, False, str(failure.value))
    assert contents(batch.state(4)) == contents(simulation.state())
    for k, (scene, summary) in enumerate(zip(scenes, summaries, strict=True)):
        simulation = Simulation(scene)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that rest was not met
            expected = simulation.run(until=until)
        assert replace(summary, seconds=0.0) == replace(expected, seconds=0.0)
        assert contents(batch.state(k)) == contents(simulation.state())
    assert [own.steps for own in Batch(scenes).run(steps=0, until=until)] == [0] * len(scenes)
    again = batch.run(until=until, steps=60)[:3]  # two rest from the first test to that after 35 steps
    assert [(summary.steps, summary.met) for summary in again] == [(50, True), (50, True), (60, False)]


def test_a_callable_is_given_each_scene() -> None:
    scenes = [Scene.load("annulus").replace(drag=drag) for drag in (0.1, 1.0)]
    batch = Batch(scenes)
    summaries = batch.run(until=lambda scene: scene.position[:, 1].min() < -1.0 and scene.time > 0.3)
    for k, scene in enumerate(scenes):
        simulation = Simulation(scene)
        expected = simulation.run(until=lambda other: other.position[:, 1].min() < -1.0)
        assert (summaries[k].met, summaries[k].steps) == (True, expected.steps)
        assert np.array_equal(batch.position(k), simulation.position)
    assert batch.reports[0] is not None


def test_no_thread_is_woken_for_little_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step of a few small scenes is done by the calling thread, many steps by two; the bits are equal."""
    submitted: list[Any] = []

    class Counted(ThreadPoolExecutor):
        def submit(self, *given: Any) -> Future:  # type: ignore[override]
            submitted.append(given)
            return super().submit(*given)

    monkeypatch.setattr(threads._WORKERS, "_executor", Counted(1))
    stepped, whole = (Batch([Scene.load("annulus")] * 4, threads=2) for _ in range(2))
    for _ in range(100):
        stepped.step()
    assert not submitted
    whole.run(steps=100)
    assert submitted
    assert contents(stepped.state(3)) == contents(whole.state(3))
