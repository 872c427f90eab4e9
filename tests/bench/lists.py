"""How good the list of candidate contacts of a settled pile is: how fat, and what it costs to build anew."""

from collections.abc import Iterator
from statistics import mean, median

from warpgrains import Simulation

from .inside import seconds_of_a_list
from .options import Options
from .piles import ITERATIONS, settled_pile
from .rows import Subject, row
from .timing import say, seconds

SIZES = (1_000, 10_000)
STEPS = 200
LISTS = 5  # built to see how long one takes


def lists(options: Options) -> Iterator[dict[str, str]]:
    """Candidates against contacts that carry a correction, and the share of building in a step's time."""
    for n in options.sizes(SIZES):
        settled = settled_pile(n, options.cache)
        for order in ("sequential", "color"):
            simulation = settled.simulation(order=order)
            seconds_of_a_list(simulation)  # once, so that the kernels are loaded
            blocks = [_block(simulation) for _ in range(options.repeats)]
            candidates, contacts, building, step = (list(values) for values in zip(*blocks, strict=True))
            if order == "sequential":
                subject = Subject(f"candidates a step, {settled.kind}", n, order)
                yield row(subject, candidates, "contacts", "active contacts", contacts, target="<= 1.5")
            subject = Subject(f"detection and order, {settled.kind}", n, order)
            whole = f"step of {ITERATIONS} iterations"
            yield row(subject, building, "ms/step", whole, step, target="<= 0.1")


def _block(simulation: Simulation) -> tuple[float, float, float, float]:
    """Return, each a mean over many steps: candidates, active contacts, ms for building lists, ms in all."""
    reports = []

    def work() -> None:
        reports.extend(simulation.step() for _ in range(STEPS))

    taken = seconds(work)
    a_list = median(seconds_of_a_list(simulation) for _ in range(LISTS))
    candidates, contacts, lists = (
        mean(getattr(report, name) for report in reports) for name in ("candidates", "contacts", "rebuilds")
    )
    say(f"  {lists * STEPS:g} lists of {a_list * 1e3:.3g} ms built in {STEPS} steps")
    return candidates, contacts, lists * a_list * 1e3, taken / STEPS * 1e3
