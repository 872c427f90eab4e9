"""Many scenes together: each has the bits that it has alone, whatever is beside it."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from same_bits import contents
from sample_scenes import SUDDEN, random_scene

from warpgrains import Batch, Scene, SceneError, Simulation, SimulationError, State, StepReport
from warpgrains.batch import resident
from warpgrains.reference.reference import Reference
from warpgrains.scene.scene import METHODS, ORDERS
from warpgrains.solver import sizes, tuning
from warpgrains.solver.statistics import RunStatistics

STEPS = 25
FAILING, LARGE = 5, 9  # of the mixed scenes


def mixed_scenes() -> list[Scene]:
    """Scenes of many kinds and sizes, in both orders, and some by the accelerated method."""
    drawn = [random_scene(seed) for seed in range(12)] + [make() for make in SUDDEN]
    accelerated = {2, 7, 10, 12}
    return [
        scene.replace(order=ORDERS[k % 3 % 2], method=METHODS[k in accelerated])
        for k, scene in enumerate(drawn)
    ]


def about_to_fail(state: State) -> State:
    """Give a grain a velocity that no step survives."""
    velocity = state.velocity.copy()
    velocity[-1] = 1.7e308 * np.sign(state.position[-1])
    return replace(state, velocity=velocity)


def of_step(report: StepReport) -> RunStatistics:
    """Return the statistics of one step."""
    return RunStatistics(
        steps=1,
        iterations=report.iterations,
        iterations_max=report.iterations,
        unconverged=int(not report.converged),
        infeasible=int(bool(report.infeasible)),
        infeasible_grains=report.infeasible,
        residual=report.residual,
        gap_error=report.gap_error,
        overlap=report.overlap,
        rebuilds=report.rebuilds,
        redos=report.redos,
    )


def alone(scene: Scene) -> tuple[State, RunStatistics, StepReport]:
    simulation, statistics = Simulation(scene, threads=1), RunStatistics()
    for _ in range(STEPS):
        report = simulation.step()
        statistics.add(of_step(report))
    return simulation.state(), statistics, report


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return mixed_scenes()


@pytest.fixture(scope="module")
def expected(scenes: list[Scene]) -> list[tuple[State, RunStatistics, StepReport]]:
    return [alone(scene) for scene in scenes]


def assert_as_alone(
    batch: Batch, order: list[int], expected: list[tuple[State, RunStatistics, StepReport]]
) -> None:
    for place, k in enumerate(order):
        state, _, report = expected[k]
        assert contents(batch.state(place)) == contents(state), f"scene {k}"
        assert batch.reports[place] == report


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_every_scene_as_alone(
    scenes: list[Scene], expected: list[tuple[State, RunStatistics, StepReport]], threads: int
) -> None:
    batch = Batch(scenes, threads=threads)
    summaries = batch.run(steps=STEPS)
    assert_as_alone(batch, list(range(len(scenes))), expected)
    for summary, (_, statistics, _) in zip(summaries, expected, strict=True):
        assert summary.error is None
        assert summary.seconds > 0.0
        alike = replace(statistics.summary(None), seconds=summary.seconds)
        assert {**vars(summary)} == {**vars(alike), "error": None}


def test_another_order_and_other_company(
    scenes: list[Scene], expected: list[tuple[State, RunStatistics, StepReport]]
) -> None:
    order = np.random.default_rng(3).permutation(len(scenes))[:11].tolist()
    batch = Batch([scenes[k] for k in order], threads=2)
    batch.run(steps=STEPS)
    assert_as_alone(batch, order, expected)


def test_step_by_step(scenes: list[Scene], expected: list[tuple[State, RunStatistics, StepReport]]) -> None:
    batch = Batch(scenes[:6], threads=2)
    assert batch.reports == [None] * len(batch)
    for _ in range(STEPS):
        reports = batch.step()
    assert reports == batch.reports
    assert_as_alone(batch, list(range(6)), expected)
    assert np.array_equal(batch.position(3), expected[3][0].position)
    assert np.array_equal(batch.velocity(3), expected[3][0].velocity)


def test_resident_sets(
    scenes: list[Scene],
    expected: list[tuple[State, RunStatistics, StepReport]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(resident, "free_memory", lambda _: 200_000.0)
    batch = Batch(scenes, threads=2)
    assert len(batch._sets._sets) > 3
    batch.run(steps=STEPS - 1)
    batch.step()
    assert_as_alone(batch, list(range(len(scenes))), expected)


def test_lists_grow_amid_a_step(
    scenes: list[Scene],
    expected: list[tuple[State, RunStatistics, StepReport]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sizes, "first_pairs", np.ones_like)
    batch = Batch(scenes, threads=2)
    batch.run(steps=STEPS)
    assert_as_alone(batch, list(range(len(scenes))), expected)


def test_a_scene_that_threads_share(
    scenes: list[Scene],
    expected: list[tuple[State, RunStatistics, StepReport]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    large = scenes[LARGE]
    monkeypatch.setattr(resident, "paying_threads", lambda scene: 2 if scene is large else 1)
    batch = Batch(scenes[:12], threads=2)
    assert [LARGE] in batch._sets._sets
    batch.run(steps=STEPS - 1)
    batch.step()
    assert_as_alone(batch, list(range(12)), expected)


@pytest.mark.parametrize("shared", [False, True])
def test_a_scene_that_fails(
    scenes: list[Scene],
    expected: list[tuple[State, RunStatistics, StepReport]],
    shared: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = Simulation(scenes[FAILING], threads=1)
    simulation.run(steps=3)
    simulation.restore(about_to_fail(simulation.state()))
    start = simulation.state()
    with pytest.raises(SimulationError) as failure:
        simulation.step()
    if shared:
        monkeypatch.setattr(resident, "paying_threads", lambda scene: 2 if scene is scenes[FAILING] else 1)
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


def test_tiles_of_pairs(
    scenes: list[Scene],
    expected: list[tuple[State, RunStatistics, StepReport]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tuning, "TILE", dict.fromkeys(ORDERS, 5))
    batch = Batch(scenes, threads=2)
    batch.run(steps=STEPS)
    assert_as_alone(batch, list(range(len(scenes))), expected)


def test_a_step_that_has_not_converged_is_not_taken(scenes: list[Scene]) -> None:
    raising = [scene.replace(on_unconverged="raise", max_iterations=8) for scene in scenes[:8]]
    batch = Batch(raising, threads=2)
    summaries = batch.run(steps=STEPS)
    assert any(summary.error for summary in summaries)
    for k, (scene, summary) in enumerate(zip(raising, summaries, strict=True)):
        simulation, error = Simulation(scene, threads=1), None
        try:
            for _ in range(STEPS):
                simulation.step()
        except SimulationError as failure:
            error = str(failure)
        assert summary.error == error
        assert contents(batch.state(k)) == contents(simulation.state())


def test_grains_that_cannot_fit_are_named() -> None:
    ring = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    scene = Scene(
        position=0.6 * np.stack([np.cos(ring), np.sin(ring)], axis=1),
        radius=0.5,
        mass=0.1,
        radius_out=1.0,
        radius_in=0.0,
        gravity=(0.0, -9.81),
        max_iterations=50,
    )
    simulation, statistics = Simulation(scene, threads=1), RunStatistics()
    for _ in range(5):
        report = simulation.step()
        statistics.add(of_step(report))
    assert report.infeasible
    batch = Batch([Scene.load("annulus"), scene], threads=2)
    summary = batch.run(steps=5)[1]
    assert batch.reports[1] == report
    assert (summary.infeasible, summary.infeasible_grains) == (
        statistics.infeasible,
        statistics.infeasible_grains,
    )


def test_against_the_c_reference(reference: Callable[..., Reference]) -> None:
    scenes = [random_scene(seed) for seed in range(8)]
    batch = Batch(scenes, threads=2)
    batch.run(steps=STEPS)
    for k, scene in enumerate(scenes):
        in_c = reference(scene)
        for _ in range(STEPS):
            in_c.update()
        assert np.array_equal(batch.position(k), in_c.position)
        assert np.array_equal(batch.velocity(k), in_c.velocity)


def test_beside_simulations_in_another_thread(
    scenes: list[Scene], expected: list[tuple[State, RunStatistics, StepReport]]
) -> None:
    batch = Batch(scenes, threads=2)
    with ThreadPoolExecutor(1) as other:
        run = other.submit(batch.run, STEPS)
        beside = [alone(scene) for scene in scenes[:6]]
        run.result()
    assert_as_alone(batch, list(range(len(scenes))), expected)
    assert [contents(state) for state, _, _ in beside] == [contents(state) for state, _, _ in expected[:6]]


def test_own_durations_and_other_spans() -> None:
    scene = Scene.load("annulus")
    batch = Batch([scene.replace(duration=0.1), scene.replace(duration=0.4, dt=0.02)], threads=1)
    assert [summary.steps for summary in batch.run()] == [10, 20]
    assert [summary.steps for summary in batch.run(duration=0.1)] == [10, 5]
    assert [batch.state(k).steps for k in range(2)] == [20, 25]


def test_an_interrupted_run_leaves_every_scene_between_two_steps(
    scenes: list[Scene],
    expected: list[tuple[State, RunStatistics, StepReport]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sizes, "first_pairs", np.ones_like)
    batch = Batch(scenes, threads=2)

    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(batch._sets.work([STEPS] * len(scenes), interrupt))
    for k in range(len(scenes)):
        batch.restore(k, batch.state(k))
    left = [STEPS - batch.state(k).steps for k in range(len(scenes))]
    list(batch._sets.work(left, lambda _: None))
    for k, (state, _, _) in enumerate(expected):
        assert contents(batch.state(k)) == contents(state)


def test_what_is_no_batch() -> None:
    scene = Scene.load("annulus")
    with pytest.raises(SceneError, match="at least one scene"):
        Batch([])
    with pytest.raises(SceneError, match="threads"):
        Batch([scene], threads=0)
    with pytest.raises(SceneError, match="device 'gpu' is unknown"):
        Batch([scene], device="gpu")
    with pytest.raises(SceneError, match="steps"):
        Batch([scene]).run(steps=-1)


def test_a_scene_larger_than_memory_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("warpgrains.solver.memory.free_memory", lambda _: 1_000.0)
    with pytest.raises(SimulationError, match="contacts need"):
        Batch([Scene.load("annulus")])
