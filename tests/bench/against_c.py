"""The solver against C, with the same bits: one sweep, whole steps, and the course's own scene."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from warpgrains import Scene, Simulation

from ..support.same_bits import assert_same_bits
from .compiled import COMPILER, CReference, sweep_in_c
from .inside import Sweeps
from .options import Options
from .piles import ITERATIONS, advance, settled_pile
from .rows import SPEEDUP, Subject, row
from .timing import in_turn, seconds

SWEPT, SWEEPS = 10_000, 200  # grains, and how often they are swept in one go
FASTER_THAN_ALL_PAIRS = {100: ">= 25", 1_000: ">= 250", 5_000: ">= 1000"}
COURSE_STEPS = 800


def sweeps(options: Options) -> Iterator[dict[str, str]]:
    """One sweep in either order, on the same arrays."""
    n = min(SWEPT, options.largest)
    pile = settled_pile(n, options.cache)
    for order in ("sequential", "color"):
        arrays = Sweeps(pile.simulation(order=order, max_iterations=SWEEPS))
        _hold_against_c(arrays)
        ours, in_c = in_turn(
            options.repeats,
            partial(_us_a_sweep, arrays, arrays.run),
            partial(_us_a_sweep, arrays, partial(sweep_in_c, arrays, SWEEPS)),
        )
        subject = Subject(f"one sweep, {pile.kind}", n, order)
        target = "<= 1.1" if (n, order) == (SWEPT, "sequential") else ""
        yield row(subject, ours, "us", f"same arrays, {COMPILER}", in_c, target=target)


def _hold_against_c(arrays: Sweeps) -> None:
    """The same bits from both."""
    arrays.reset()
    zeta = sweep_in_c(arrays, SWEEPS)
    expected = arrays.contents()
    arrays.reset()
    arrays.run()
    assert arrays.done() == (SWEEPS, zeta)
    assert all(map(np.array_equal, arrays.contents(), expected))


def _us_a_sweep(arrays: Sweeps, sweep: Callable[[], object]) -> float:
    arrays.reset()
    return seconds(sweep) / SWEEPS * 1e6


def steps(options: Options) -> Iterator[dict[str, str]]:
    """Whole steps against all pairs in C."""
    for n in options.sizes(FASTER_THAN_ALL_PAIRS):
        pile, count = settled_pile(n, options.cache), max(2, 4_000 // n)
        simulation = pile.simulation()
        reference = CReference(simulation.scene, simulation.state())
        ours, in_c = in_turn(
            options.repeats,
            partial(_ms_a_step, partial(advance, simulation), count),
            partial(_ms_a_step, reference.run, count),
        )
        assert_same_bits(simulation, reference)
        subject = Subject(f"one step of {ITERATIONS} iterations, {pile.kind}", n)
        target = FASTER_THAN_ALL_PAIRS.get(n, "")
        yield row(subject, ours, "ms", f"all pairs, {COMPILER}", in_c, SPEEDUP, target)


def _ms_a_step(run: Callable[[int], object], steps: int) -> float:
    return seconds(partial(run, steps)) / steps * 1e3


def course(options: Options) -> Iterator[dict[str, str]]:
    """The course's scene from its start, all of it."""
    scene = Scene.load("annulus")
    simulation = Simulation(scene)
    start = simulation.state()
    references: list[CReference] = []

    def ours() -> float:
        simulation.restore(start)
        return seconds(partial(simulation.run, COURSE_STEPS)) * 1e3

    def in_c() -> float:
        references.append(CReference(scene))
        return seconds(partial(references[-1].run, COURSE_STEPS)) * 1e3

    ours()  # once, so that the launches are captured
    times = in_turn(options.repeats, ours, in_c)
    assert_same_bits(simulation, references[-1])
    subject = Subject(f"the course's scene, {COURSE_STEPS} steps", scene.n)
    yield row(subject, times[0], "ms", f"all pairs, {COMPILER}", times[1], SPEEDUP, ">= 1.5")
