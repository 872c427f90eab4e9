"""One pile shared out among OS threads: two, and as many as a simulation chooses, against one; same bits.

Beside it stands what the machine has to give: two simulations that share nothing, one thread each, at once.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from warpgrains import Simulation

from .inside import default_threads
from .options import Options
from .piles import ITERATIONS, advance, settled_pile
from .rows import SPEEDUP, Subject, row
from .timing import in_turn, seconds

SIZES = (100, 1_000, 10_000, 100_000)
LARGE = 100_000


def threads(options: Options) -> Iterator[dict[str, str]]:
    """Every size in both orders."""
    for n in options.sizes(SIZES):
        for order in ("sequential", "color"):
            yield from _compare(n, order, options)


def _compare(n: int, order: str, options: Options) -> Iterator[dict[str, str]]:
    settled = settled_pile(n, options.cache)
    simulations = [settled.simulation(count, order=order) for count in (1, 2, None)]
    apart = [settled.simulation(1, order=order) for _ in range(2)]
    measures = [partial(_ms_a_step, simulation) for simulation in simulations]
    one, two, chosen, both = in_turn(options.repeats, *measures, partial(_ms_a_step_of_both, apart))
    _hold_together([*simulations, *apart])
    name = f"one step of {ITERATIONS} iterations, {settled.kind}"
    target = ">= 1.6" if n == LARGE else ""
    yield row(Subject(name, n, order, "2"), two, "ms", "1 thread", one, SPEEDUP, target)
    choice = f"{default_threads(simulations[0].scene)} (default)"
    yield row(Subject(name, n, order, choice), chosen, "ms", "1 thread", one, SPEEDUP, ">= 0.95")
    machine = f"the same by two separate simulations at once, {settled.kind}"
    yield row(Subject(machine, n, order, "1 + 1"), both, "ms", "1 thread", one, SPEEDUP)


def _ms_a_step(simulation: Simulation) -> float:
    steps = min(max(5, 100_000 // simulation.scene.n), 100)
    return seconds(partial(advance, simulation, steps)) / steps * 1e3


def _ms_a_step_of_both(simulations: list[Simulation]) -> float:
    """Return the time for each step done by either, while both advance."""
    with ThreadPoolExecutor(2) as pool:
        return sum(pool.map(_ms_a_step, simulations)) / 4.0


def _hold_together(simulations: list[Simulation]) -> None:
    """The same bits from any number of threads."""
    first, *others = (simulation.state() for simulation in simulations)
    for other in others:
        assert np.array_equal(first.position, other.position)
        assert np.array_equal(first.velocity, other.velocity)
        for name in ("pair", "pair_correction", "wall_correction"):
            assert np.array_equal(getattr(first.corrections, name), getattr(other.corrections, name))
