"""How good the list of candidate contacts of a settled pile is: how fat, and what it costs to build anew."""

from collections.abc import Iterator

from warpgrains import Simulation

from .inside import time_rebuilds
from .options import Options
from .piles import ITERATIONS, settled_pile
from .rows import Subject, row
from .timing import say, seconds

SIZES = (1_000, 10_000)
STEPS = 200


def lists(options: Options) -> Iterator[dict[str, str]]:
    """Candidates against contacts that carry a correction, and the share of building in a step's time."""
    for n in options.sizes(SIZES):
        settled = settled_pile(n, options.cache)
        for order in ("sequential", "color"):
            simulation = settled.simulation(order=order)
            rebuilds = time_rebuilds(simulation)
            blocks = [_block(simulation, rebuilds) for _ in range(options.repeats)]
            candidates, contacts, building, step = (list(values) for values in zip(*blocks, strict=True))
            say(f"  {len(rebuilds)} lists built in {STEPS * options.repeats} steps")
            if order == "sequential":
                subject = Subject(f"candidates a step, {settled.kind}", n, order)
                yield row(subject, candidates, "contacts", "active contacts", contacts, target="<= 1.5")
            subject = Subject(f"detection and order, {settled.kind}", n, order)
            whole = f"step of {ITERATIONS} iterations"
            yield row(subject, building, "ms/step", whole, step, target="<= 0.1")


def _block(simulation: Simulation, rebuilds: list[float]) -> tuple[float, float, float, float]:
    """Return, each a mean over many steps: candidates, active contacts, ms for building lists, ms in all."""
    candidates = contacts = 0
    built = len(rebuilds)

    def work() -> None:
        nonlocal candidates, contacts
        for _ in range(STEPS):
            report = simulation.step()
            candidates += report.candidates
            contacts += report.contacts

    taken = seconds(work)
    building = sum(rebuilds[built:])
    return candidates / STEPS, contacts / STEPS, building / STEPS * 1e3, taken / STEPS * 1e3
