"""One pile shared out among OS threads: two, and as many as a simulation chooses, against one; same bits.

Beside it stands what the machine has to give: two simulations that share nothing, one thread each, at once.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from warpgrains import Simulation

from .flow import splashing
from .inside import default_threads
from .kept import continued
from .options import Options
from .piles import ITERATIONS, advance, settled_pile
from .rows import SPEEDUP, Subject, row
from .timing import in_turn, seconds

SIZES = (100, 1_000, 10_000, 100_000)
LARGE = 100_000
IDLE = 5  # steps
PLAIN = {"method": "gauss-seidel", "stop": "zeta", "tolerance": 1e-12, "max_iterations": ITERATIONS}


def threads(options: Options) -> Iterator[dict[str, str]]:
    """Every size in color order, at rest; many grains that splash."""
    for n in options.sizes(SIZES):
        settled = settled_pile(n, options.cache)
        name = f"one step of {ITERATIONS} iterations, {settled.kind}"
        make = partial(settled.simulation, order="color")
        yield from _compare(Subject(name, n, "color"), make, options.repeats, ">= 1.65")
    flowing = splashing(min(LARGE, options.largest), options.cache)
    n = flowing[0].n
    make = partial(continued, *flowing, order="color", **PLAIN)
    subject = Subject(f"one step of {ITERATIONS} iterations, flowing", n, "color")
    yield from _compare(subject, make, options.repeats, ">= 1.5")
    subject = Subject("one flowing step, accelerated to 1e-2 m/s", n, "color")
    yield from _compare(subject, partial(continued, *flowing), options.repeats, ">= 1.5")


def _compare(
    subject: Subject, make: Callable[[int | None], Simulation], repeats: int, target: str
) -> Iterator[dict[str, str]]:
    """Two threads, as many as a simulation chooses, and two simulations at once, against one thread."""
    simulations = [make(count) for count in (1, 2, None)]
    apart = [make(1) for _ in range(2)]
    measures = [partial(_ms_a_step, simulation) for simulation in simulations]
    one, two, chosen, both = in_turn(repeats, *measures, partial(_ms_a_step_of_both, apart))
    _hold_together([*simulations, *apart])
    aim = target if subject.n == LARGE else ""
    yield row(replace(subject, threads="2"), two, "ms", "1 thread", one, SPEEDUP, aim)
    choice = f"{default_threads(simulations[0].scene)} (default)"
    yield row(replace(subject, threads=choice), chosen, "ms", "1 thread", one, SPEEDUP, ">= 0.95")
    machine = replace(subject, name=f"{subject.name}, by two separate simulations at once", threads="1 + 1")
    yield row(machine, both, "ms", "1 thread", one, SPEEDUP)


def _ms_a_step(simulation: Simulation) -> float:
    """Return the time of a step, after the first few: an idle core needs a while to come to speed."""
    advance(simulation, IDLE)
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
        for name in ("pair", "pair_correction", "wall", "wall_correction"):
            assert np.array_equal(getattr(first.corrections, name), getattr(other.corrections, name))
