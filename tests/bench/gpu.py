"""Measure how fast a GPU is beside the cores of its machine, in batches and alone, to the same bits, as CSV.

python -m tests.bench.gpu -o tests/bench/results/gpu.csv
"""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from warpgrains import Batch, Scene, Simulation
from warpgrains.solver.threads import cores
from warpgrains.warp_start import find_device

from .batch import course
from .piles import pile
from .rows import SPEEDUP, Subject, command_line, in_turn, publish, row, seconds

COURSES = (1, 60, 1_000, 10_000)  # scenes of a batch
FALL, STEPS = 80, 40  # steps of the course before they are measured, and that each time is of
PILES = ((1_000, 100), (10_000, 100), (200, 1_000), (1_000, 1_000), (1, 1_000), (1, 10_000), (1, 100_000))
"""Scenes of a batch, and grains of each."""
SETTLING, PILE_STEPS = 200, 10  # steps before, and that each time is of
ALONE = 25_000  # grains of a batch up to which one thread is measured, too


def settling(n: int) -> Scene:
    """A pile that has fallen a while."""
    simulation = Simulation(pile(n), order="color")
    simulation.advance(SETTLING)
    return simulation.present_scene


def compared(
    what: str, scenes: Sequence[Scene], steps: int, device: str, repeats: int
) -> Iterator[dict[str, str]]:
    """A step of all scenes, on the GPU, by all threads and, if there are few grains, by one thread."""
    n, count = scenes[0].n, len(scenes)
    threads = [cores(), *([1] if count * n <= ALONE or count == 1 else [])]
    own = Batch(scenes, device=device)
    others = [Batch(scenes, threads=k) for k in threads]
    for batch in (own, *others):
        batch.run(FALL if what == "course" else steps)
    ways = [lambda batch=batch: 1e3 * seconds(partial(batch.run, steps)) / steps for batch in (own, *others)]
    times, *its = in_turn(repeats, *ways)
    assert all(np.array_equal(own.position(k), batch.position(k)) for batch in others for k in range(count))
    many = f"{count:,} {what}s" if count > 1 else f"one {what}"
    name = getattr(find_device(device), "name", device)
    for k, values in zip(threads, its, strict=True):
        subject = Subject(f"a step of {many}, {name}", n, scenes[0].order, "GPU")
        yield row(subject, times, "ms", f"{k} CPU threads" if k > 1 else "one CPU thread", values, SPEEDUP)


def figures(device: str, largest: int, repeats: int) -> Iterator[dict[str, str]]:
    """Every figure, one by one."""
    for count in (count for count in COURSES if count <= largest):
        yield from compared("course", course(count, 24, 6), STEPS, device, repeats)
    for count, n in PILES:
        if max(count, n) <= largest:
            yield from compared("pile", [settling(n)] * count, PILE_STEPS, device, repeats)


def main(arguments: list[str] | None = None) -> None:
    """Measure, and write the figures down one by one."""
    parser = command_line("gpu", __doc__)
    parser.add_argument("--device", default="cuda:0", help="the GPU (default: cuda:0)")
    parser.add_argument(
        "--largest", type=int, default=100_000, help="most grains, and scenes (default: 100,000)"
    )
    chosen = parser.parse_args(arguments)
    publish(figures(chosen.device, chosen.largest, chosen.repeats), chosen.output)


if __name__ == "__main__":
    main()
