"""The same bits in every way to run a scene: by threads, launches, batches, files and processes."""

import hashlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from copy import copy, deepcopy
from dataclasses import replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from time import sleep, thread_time
from typing import Any

import pytest
from hard_scenes import SOON, drum, heap
from same_bits import contents
from schemes import SECOND_ORDER
from walled_scenes import (
    BOXES,
    CORNERS,
    DRIVEN,
    ROLLING,
    TURNING,
    around,
    boxed,
    cloud,
    cornered,
    pressed,
    stirred,
)

from warpgrains import Batch, Scene, Simulation, State
from warpgrains.scene.fields import METHODS, ORDERS
from warpgrains.solver import tuning

STEPS = 24  # a step of the polydisperse scene is solved again in the 18th


def loaded(name: str, **changes: Any) -> Callable[[], Scene]:
    return lambda: Scene.load(name).replace(**changes)


SCENES: dict[str, Callable[[], Scene]] = {}
"""Grains of many sizes that fall, knock and settle; in a bowl; with friction; in a box; walls that move."""
for order in ORDERS:
    for method in METHODS:
        sizes = loaded("polydisperse", order=order, method=method, max_iterations=100)
        bowl = loaded("no_inner_wall", order=order, method=method, max_iterations=30, **SECOND_ORDER)
        bounces = loaded("polydisperse", order=order, method=method, max_iterations=100, restitution=0.7)
        SCENES[f"polydisperse, bouncing, {method}, {order}"] = bounces
        SCENES |= {f"polydisperse, {method}, {order}": sizes, f"bowl, {method}, {order}": bowl}
    for method in METHODS[:2]:
        driven = partial(pressed, order=order, method=method, walls=[DRIVEN])
        SCENES[f"driven walls, {method}, {order}"] = driven
        SCENES[f"rolling friction, {method}, {order}"] = partial(
            cloud, 100, order=order, method=method, **ROLLING
        )
    SCENES[f"friction, {order}"] = partial(cloud, 100, order=order)
    SCENES[f"moving walls, {order}"] = partial(stirred, order=order, time=-0.2, **TURNING)
    SCENES[f"walls begin to move, {order}"] = partial(stirred, order=order, time=0.05, **TURNING)
    SCENES[f"box, {order}"] = partial(boxed, "lid", order=order)
    SCENES[f"walls, {order}"] = partial(around, 110, order=order)
    SCENES[f"exact, {order}"] = partial(heap, 60, spacing=2.0, order=order, **SOON)
    SCENES[f"exact, rough, {order}"] = partial(drum, order=order)
    SCENES[f"corners, {order}"] = partial(cornered, CORNERS["chute"], 40, order=order)


@cache
def scene_of(which: str) -> Scene:
    return SCENES[which]()


@cache
def expected(which: str) -> Any:
    """Return all that one thread leaves behind."""
    return contents(advanced(scene_of(which), threads=1))


def advanced(scene: Scene, **options: Any) -> State:
    simulation = Simulation(scene, **options)
    simulation.advance(STEPS)
    return simulation.state()


def loaded_again(simulation: Simulation, folder: Path) -> Simulation:
    simulation.save(folder / "state.npz")
    other = Simulation.load(folder / "state.npz", threads=3)
    assert contents(other.scene) == contents(simulation.scene)
    return other


def gone_back(simulation: Simulation, _: Path) -> Simulation:
    """Return a simulation whose steps from the state have not changed it."""
    other, state = Simulation(simulation.scene), simulation.state()
    other.restore(state)
    other.advance(50)
    other.restore(state)
    return other


CONTINUED: dict[str, Callable[[Simulation, Path], Simulation]] = {
    "saved": loaded_again,
    "restored": lambda simulation, _: Simulation(simulation.scene, state=simulation.state(), threads=2),
    "gone back": gone_back,
    "copied": lambda simulation, _: copy(simulation),
    "deeply copied": lambda simulation, _: deepcopy(simulation),
    "pickled": lambda simulation, _: pickle.loads(pickle.dumps(simulation)),
}
"""How to have another simulation go on."""


def continued(how: str, scene: Scene, folder: Path) -> State:
    first = Simulation(scene, threads=1)
    first.advance(STEPS // 2)
    before = contents(first.state())
    second = CONTINUED[how](first, folder)
    assert contents(first.state()) == before
    assert second.time == first.time
    rest = range(STEPS - STEPS // 2)
    assert [second.step() for _ in rest] == [first.step() for _ in rest]
    return second.state()


def in_batch(scene: Scene, _: Path) -> State:
    batch = Batch([Scene.load("annulus"), scene, cloud(80), scene], threads=2)
    batch.run(STEPS)
    assert contents(batch.state(3)) == contents(batch.state(1))
    return batch.state(1)


WAYS: dict[str, Callable[[Scene, Path], State]] = {
    "2 threads": lambda scene, _: advanced(scene, threads=2),
    "3 threads": lambda scene, _: advanced(scene, threads=3),
    "batch": in_batch,
    **{how: partial(continued, how) for how in CONTINUED},
}


CASES = [
    (which, way)
    for which in SCENES
    for way in {
        "poly": ("2 threads", "3 threads", "restored"),
        "bowl": ("2 threads", "batch"),
        "exac": ("2 threads", "batch", "saved"),
        "box,": [*WAYS],
    }.get(which[:4], ("saved", "batch"))
]


@pytest.mark.parametrize(("which", "way"), CASES)
def test_same_bits(tmp_path: Path, which: str, way: str) -> None:
    assert contents(WAYS[way](scene_of(which), tmp_path)) == expected(which)


@pytest.mark.gpu
@pytest.mark.parametrize("which", [which for which in SCENES if "mov" not in which])
def test_a_gpu(which: str) -> None:
    """Where nothing turns: the sine and cosine of a GPU may differ in the last bit."""
    assert contents(advanced(scene_of(which), device="cuda:0")) == expected(which)


@pytest.mark.gpu
@pytest.mark.parametrize("kind", BOXES)
def test_boxes_on_a_gpu(kind: str) -> None:
    on_gpu, own = (advanced(boxed(kind), device=device) for device in ("cuda:0", "cpu"))
    assert contents(on_gpu) == contents(own)


@pytest.mark.gpu
@pytest.mark.parametrize("before", ["cpu", "cuda:0"])
def test_a_gpu_and_a_cpu_go_on_from_each_other(tmp_path: Path, before: str) -> None:
    """In a batch, too, whose lists grow."""
    own, other = ("cpu", "cuda:0") if before == "cpu" else ("cuda:0", "cpu")
    first = Simulation(scene_of(SEQUENTIAL), device=own)
    first.advance(STEPS // 3)
    first.save(tmp_path / "state.npz")
    on_other = Simulation.load(tmp_path / "state.npz", device=other)
    on_other.advance(STEPS - STEPS // 3)
    assert contents(on_other.state()) == expected(SEQUENTIAL)


IN_A_FRESH_PROCESS = "import sys, test_same_bits as t; print(t.digest(int(sys.argv[1])))"


def digest(threads: int) -> str:
    """Hash all that runs in both orders leave behind, and all that they report."""
    found = hashlib.sha256()
    for scene, order in product((Scene.load("polydisperse"), boxed("lid")), ORDERS):
        simulation = Simulation(scene, threads=threads, order=order)
        reports = [simulation.step() for _ in range(50)]
        told = [(r.iterations, r.zeta, r.contacts, r.overlap) for r in reports]
        found.update(repr((told, contents(simulation.state()))).encode())
    return found.hexdigest()


@pytest.mark.parametrize("threads", [1, 2])
def test_fresh_process(threads: int) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", IN_A_FRESH_PROCESS, str(threads)]
    process = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert process.returncode == 0, process.stderr
    assert process.stdout.splitlines()[-1] == digest(1)


def test_a_thread_that_waits_sleeps() -> None:
    """A second thread is launched alone: it waits for the first, which has nothing to do."""
    engine = Simulation(scene_of(SEQUENTIAL), threads=2)._engine
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


@pytest.mark.parametrize("order", ORDERS)
def test_threads_continue_alike_from_a_state_without_lists(order: str) -> None:
    settled = Simulation(Scene.load("annulus"), order=order)
    settled.run(steps=300)
    assert settled.state().corrections.wall_correction.any()
    ends = []
    for threads in (1, 2):
        simulation = Simulation(settled.scene, threads=threads)
        simulation.restore(replace(settled.state(), lists=None))
        simulation.step()
        ends.append(contents(simulation.state()))
    assert ends[0] == ends[1]


SEQUENTIAL = "polydisperse, gauss-seidel, sequential"


@pytest.mark.parametrize(("name", "value"), [("BASE_SKIN", 1e-12), ("MONITOR_THRESHOLD", 0.0)])
def test_lists_for_one_step_and_monitored_sweeps(
    monkeypatch: pytest.MonkeyPatch, name: str, value: float
) -> None:
    whole = advanced(scene_of(SEQUENTIAL), threads=1)
    monkeypatch.setattr(tuning, name, value)
    simulation = Simulation(scene_of(SEQUENTIAL), threads=1)
    rebuilds = [simulation.step().rebuilds for _ in range(STEPS)]
    assert (min(rebuilds) >= 1) == (name == "BASE_SKIN")
    for own in ("position", "velocity", "corrections"):
        assert contents(getattr(simulation.state(), own)) == contents(getattr(whole, own))


def test_simulations_side_by_side() -> None:
    """Each in a Python thread of its own: what one captures must not take in what another launches."""
    with ThreadPoolExecutor(2) as pool:
        ends = [pool.submit(partial(advanced, scene_of(SEQUENTIAL), threads=1)) for _ in range(8)]
        assert all(contents(end.result()) == expected(SEQUENTIAL) for end in ends)
