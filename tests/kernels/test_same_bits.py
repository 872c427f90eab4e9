"""The same bits in every way to run a scene: by threads, launches, batches, files and processes."""

import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from time import sleep, thread_time
from typing import Any

import pytest
from hard_scenes import SOON, drum, heap
from same_bits import contents
from schemes import SECOND_ORDER
from walled_scenes import DRIVEN, ROLLING, WALLED, cloud, pressed

from warpgrains import Batch, Scene, Simulation, State
from warpgrains.scene.fields import METHODS, ORDERS

STEPS = 24  # a step of the polydisperse scene is solved again in the 18th
SEQUENTIAL = "polydisperse, gauss-seidel, sequential"


def scenes(**order: str) -> dict[str, Callable[[], Scene]]:
    """Grains that fall and settle, by every method that takes them."""
    sizes = partial(Scene.load("polydisperse").replace, max_iterations=100, **order)
    bowl = partial(Scene.load("no_inner_wall").replace, max_iterations=30, **order, **SECOND_ORDER)
    made: dict[str, Callable[[], Scene]] = {}
    for method in METHODS:
        made[f"polydisperse, {method}"] = partial(sizes, method=method)
        made[f"polydisperse, bouncing, {method}"] = partial(sizes, method=method, restitution=0.7)
        made[f"bowl, {method}"] = partial(bowl, method=method)
    for method in METHODS[:2]:
        made[f"driven walls, {method}"] = partial(pressed, 80, walls=[DRIVEN], method=method, **order)
        made[f"rolling friction, {method}"] = partial(cloud, 100, method=method, **order, **ROLLING)
    return made | {
        "exact": partial(heap, 60, spacing=2.0, **order, **SOON),
        "exact, rough": partial(drum, **order),
    }


SCENES = {f"{kind}, {order}": make for order in ORDERS for kind, make in scenes(order=order).items()}
for k, (walls, make) in enumerate(WALLED.items()):
    SCENES[walls] = partial(make, max_iterations=60, order=ORDERS[k % 2])


@cache
def expected(which: str) -> Any:
    """Return all that one thread leaves behind."""
    return contents(advanced(SCENES[which](), threads=1))


def advanced(scene: Scene, **options: Any) -> State:
    simulation = Simulation(scene, **options)
    simulation.advance(STEPS)
    return simulation.state()


def loaded_again(simulation: Simulation, folder: Path) -> Simulation:
    simulation.save(folder / "state.npz")
    return Simulation.load(folder / "state.npz", threads=2)


def gone_back(simulation: Simulation, _: Path) -> Simulation:
    """Return a simulation whose steps from the state have not changed it."""
    other, state = Simulation(simulation.scene), simulation.state()
    other.restore(state)
    other.advance(50)
    other.restore(state)
    return other


CONTINUED: dict[str, Callable[[Simulation, Path], Simulation]] = {
    "saved": loaded_again,
    "gone back": gone_back,
    "deeply copied": lambda simulation, _: deepcopy(simulation),
    "pickled": lambda simulation, _: pickle.loads(pickle.dumps(simulation)),
}
"""How to have another simulation go on; test_continuing.py has the state itself, and copies."""


def continued(how: str, scene: Scene, folder: Path) -> State:
    first = Simulation(scene, threads=1)
    first.advance(STEPS // 2)
    before = contents(first.state())
    second = CONTINUED[how](first, folder)
    assert contents(first.state()) == before
    assert contents(second.scene) == contents(first.scene)
    assert second.time == first.time
    rest = range(STEPS - STEPS // 2)
    assert [second.step() for _ in rest] == [first.step() for _ in rest]
    return second.state()


def in_batch(scene: Scene, _: Path) -> State:
    batch = Batch([Scene.load("annulus"), scene, cloud(80), scene], threads=2)
    batch.run(STEPS)
    assert contents(batch.state(3)) == contents(batch.state(1))
    return batch.state(1)


FRESH = """
import sys
from warpgrains import Simulation
simulation = Simulation.load(sys.argv[1], threads=2)
simulation.advance(int(sys.argv[2]))
simulation.save(sys.argv[1])
"""


def in_a_fresh_process(scene: Scene, folder: Path) -> State:
    file = folder / "state.npz"
    Simulation(scene).save(file)
    subprocess.run([sys.executable, "-c", FRESH, str(file), str(STEPS)], check=True)
    return Simulation.load(file).state()


WAYS: dict[str, Callable[[Scene, Path], State]] = {
    "2 threads": lambda scene, _: advanced(scene, threads=2),
    "3 threads": lambda scene, _: advanced(scene, threads=3),
    "batch": in_batch,
    "fresh process": in_a_fresh_process,
    **{how: partial(continued, how) for how in CONTINUED},
}
FOR_KIND = {
    "poly": ("2 threads", "3 threads"),
    "bowl": ("2 threads", "batch"),
    "exac": ("2 threads", "batch", "saved"),
}
CASES = [
    (f"{kind}, {order}", way)
    for k, order in enumerate(ORDERS)
    for kind in scenes()
    for way in FOR_KIND.get(kind[:4], ("saved", "batch"))[k::2]
]
CASES += [(walls, [*WAYS][k % len(WAYS)]) for k, walls in enumerate(WALLED)]
"""Every way with every kind of scene, in one order of the two, and walls by one way each."""


@pytest.mark.parametrize(("which", "way"), CASES)
def test_same_bits(tmp_path: Path, which: str, way: str) -> None:
    assert contents(WAYS[way](SCENES[which](), tmp_path)) == expected(which)


ON_GPU = {which: make for which, make in SCENES.items() if not re.search("moving|drum", which)}


@pytest.mark.gpu
@pytest.mark.parametrize("which", ON_GPU)
def test_a_gpu(which: str) -> None:
    """Where nothing turns: the sine and cosine of a GPU may differ in the last bit."""
    on_gpu, own = (advanced(ON_GPU[which](), device=device) for device in ("cuda:0", "cpu"))
    assert contents(on_gpu) == contents(own)


@pytest.mark.gpu
@pytest.mark.parametrize(("own", "other"), [("cpu", "cuda:0"), ("cuda:0", "cpu")])
def test_a_gpu_and_a_cpu_go_on_from_each_other(tmp_path: Path, own: str, other: str) -> None:
    first = Simulation(SCENES[SEQUENTIAL](), device=own)
    first.advance(STEPS // 3)
    first.save(tmp_path / "state.npz")
    on_other = Simulation.load(tmp_path / "state.npz", device=other)
    on_other.advance(STEPS - STEPS // 3)
    assert contents(on_other.state()) == expected(SEQUENTIAL)


def test_a_thread_that_waits_sleeps() -> None:
    """A second thread is launched alone: it waits for the first, which has nothing to do."""
    first, second = Simulation(SCENES[SEQUENTIAL](), threads=2)._engine.tasks(2)

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
    settled.advance(300)
    assert settled.state().corrections.wall_correction.any()
    state = replace(settled.state(), lists=None)
    one, two = (Simulation(settled.scene, threads=threads, state=state) for threads in (1, 2))
    assert one.step() == two.step()
    assert contents(one.state()) == contents(two.state())


def test_simulations_side_by_side() -> None:
    """Each in a Python thread of its own: what one captures must not take in what another launches."""
    with ThreadPoolExecutor(2) as pool:
        ends = [pool.submit(partial(advanced, SCENES[SEQUENTIAL](), threads=1)) for _ in range(8)]
        assert all(contents(end.result()) == expected(SEQUENTIAL) for end in ends)
