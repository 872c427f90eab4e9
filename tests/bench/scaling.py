"""How the cost of a step grows with the grains: time and memory for each."""

import gc
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from statistics import median

import numpy as np

from warpgrains import Segment, Simulation
from warpgrains.warp_start import start_warp

from .options import Options
from .piles import advance, pile, settled_pile
from .rows import Subject, row
from .timing import in_turn, seconds

SIZES = (1_000, 10_000, 100_000, 1_000_000)
MANY = 1_000_000
BELOW_SEGMENTS = 10_000


def costs(options: Options) -> Iterator[dict[str, str]]:
    """Time for each grain and iteration, against the size for which it is least."""
    piles = [settled_pile(n, options.cache) for n in options.sizes(SIZES)]
    simulations = [settled.simulation() for settled in piles]
    measures = [partial(_ns_a_grain, simulation) for simulation in simulations]
    found = dict(zip(piles, in_turn(options.repeats, *measures), strict=True))
    least = min(found, key=lambda settled: median(found[settled]))
    for settled, values in found.items():
        subject = Subject(f"cost a grain and iteration, {settled.kind}", settled.scene.n)
        yield row(subject, values, "ns", f"n = {least.scene.n}", found[least], target="<= 2")


def _ns_a_grain(simulation: Simulation) -> float:
    """Return the cost of some whole steps, by grain and iteration."""
    n, iterations = simulation.scene.n, 0
    steps = min(max(2, 200_000 // n), 1_000)

    def work() -> None:
        nonlocal iterations
        iterations = advance(simulation, steps)

    return seconds(work) / (n * iterations) * 1e9


def segments(options: Options) -> Iterator[dict[str, str]]:
    """A step of a pile below many segments, against one of the annulus alone, by both methods."""
    settled = settled_pile(min(BELOW_SEGMENTS, options.largest), options.cache)
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-0.6, 0.6, 10), np.linspace(0.05, 0.6, 10)))
    walls = [Segment((a - 0.04, b), (a + 0.04, b)) for a, b in zip(x, y, strict=True)]
    for changes in ({"method": "gauss-seidel"}, {"method": "accelerated", "order": "color"}):
        simulations = settled.simulation(walls=walls, **changes), settled.simulation(**changes)
        measures = (partial(_ns_a_grain, simulation) for simulation in simulations)
        ours, its = in_turn(options.repeats, *measures)
        name = f"cost a grain and iteration below {len(walls)} segments, {changes['method']}"
        subject = Subject(name, settled.scene.n, changes.get("order", "sequential"))
        yield row(subject, ours, "ns", "the annulus alone", its, target="<= 1.1")


def memory(options: Options) -> Iterator[dict[str, str]]:
    """Memory for each grain, held after some steps and at its peak, each time in a process of its own."""
    n = min(MANY, options.largest)
    kind = settled_pile(n, options.cache).kind
    held, peak = zip(*(_in_a_fresh_process(n, options.cache) for _ in range(options.repeats)), strict=True)
    target = "<= 1.5" if n == MANY else ""
    yield row(Subject(f"memory a grain, {kind}", n), held, "kB", target=target)
    yield row(Subject(f"memory a grain at its peak, {kind}", n), peak, "kB", target=target)


def _in_a_fresh_process(n: int, cache: Path) -> tuple[float, float]:
    with ProcessPoolExecutor(1, get_context("spawn")) as process:
        return process.submit(_kb_a_grain, n, cache).result()


def _kb_a_grain(n: int, cache: Path) -> tuple[float, float]:
    """Return what a simulation adds to what its scene and state take, at the end and at most."""
    start_warp()
    settled = settled_pile(n, cache)
    advance(Simulation(pile(10), threads=1), 1)  # what is loaded once is not counted
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    before = _kb("VmRSS")
    simulation = Simulation(settled.scene, threads=1)
    simulation.restore(settled.state)
    advance(simulation, 3)
    return (_kb("VmRSS") - before) / n, (_kb("VmHWM") - before) / n


def _kb(name: str) -> float:
    """Read a line of this process's status."""
    lines = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return float(lines[name].split()[0]) * 1.024
