"""How the time of a step grows with the number of grains, at equal overlap, beside other programs.

    python -m tests.bench.growth -o tests/bench/results/growth.csv --picture scenes/growth.png

The common flowing scene where all splash, for 0.1 s (100,000 grains: 0.03 s). Of each program counts the
cheapest setting, of the ladders below, that keeps grains from overlapping by more than 1e-2 radii. Ladders
lead to smaller overlaps, at more cost. They end at the first setting that does, or that takes too long, and
begin, with more grains, where they ended before. Time is wall time of 10 ms simulated.
"""

import argparse
import os
from collections.abc import Callable, Iterator
from functools import partial
from math import log, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import Scene

from .box2d3 import Box2d3
from .flow import flowing, splashing
from .kamino import Kamino
from .peer_programs import Lammps, Pymunk, Warpgrains
from .peers import MARKERS, overlaps, parsed, peers_command_line
from .rows import publish, say, seconds

COLUMNS = ("program", "threads", "n", "setting", "ms of 10 ms", "overlap of pairs")
GRAINS = (100, 1_000, 10_000, 100_000)
OVERLAP = 1e-2  # radii
MOST, LEAST = 10, 3  # frames of 10 ms
SHORTEST = 0.5  # s of measuring, for small scenes
TOLERANCES = (0.1, 0.06, 0.03, 0.02, 0.01, 0.006, 0.003, 0.002, 0.001)  # m/s
STIFFNESSES = (0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.025, 0.018, 0.0125, 0.009)  # radii, of LAMMPS
Make = Callable[[Scene], Any]
Ladder = list[tuple[str, Make]]


def ladder(first: int, last: int, factor: float, make: Make, field: str, text: str) -> Ladder:
    """Return settings `first`, `factor` `first`, ... up to `last` of a field, by their names."""
    count = 1 + round(log(last / first) / log(factor))
    numbers = [round(first * factor**k) for k in range(count)]
    return [(text.format(number), partial(make, **{field: number})) for number in numbers]


def ladders(box2d3: Path | None) -> Iterator[tuple[str, int, Ladder]]:
    """Yield ladders of settings of every program, with its threads."""
    solver = {"method": "accelerated", "order": "color", "stop": "residual"}
    for threads in (1, 2):
        for dt in (0.01, 0.0025, 0.001):
            make = partial(Warpgrains, dt=dt, threads=threads, **solver)
            own = [(f"dt {dt:g}, to {t:g} m/s", partial(make, tolerance=t)) for t in TOLERANCES]
            yield "warpgrains", threads, own
    stiff = partial(Box2d3, source=box2d3, substeps=4, stiff=True)
    yield "Box2D 3", 1, ladder(4, 512, sqrt(2.0), stiff, "steps", "{} searches of 4 sub-steps")
    bodies = partial(Pymunk, iterations=10)
    yield "pymunk", 1, ladder(4, 512, sqrt(2.0), bodies, "substeps", "{} sub-steps of 10 iterations")
    yield "Newton Kamino", 1, ladder(12, 3_072, 2.0, Kamino, "iterations", "{} iterations")
    stiffness = [(f"stiff for {k:g} radii", partial(Lammps, overlap=k)) for k in STIFFNESSES]
    yield "LAMMPS", 1, stiffness


def frames_of(n: int) -> int:
    """Return the length of a window [10 ms]."""
    return min(MOST, max(LEAST, 100_000 // n))


def measure(scene: Scene, make: Make, longest: float) -> tuple[float, float]:
    """Return the median time of a window, in ms of 10 ms, and the worst overlap of two grains [radii].

    Raises
    ------
    TimeoutError
        The window would take more than `longest` [s].
    """
    frames = frames_of(scene.n)
    times: list[float] = []
    worst = 0.0
    while not times or sum(times) < SHORTEST:
        program, taken = make(scene), 0.0
        for frame in range(frames):
            taken += seconds(partial(program.advance, 1))
            if frame == 0 and taken * frames > longest:
                raise TimeoutError(f"{taken * frames:.0f} s")
            if not times:
                worst = max(worst, float(overlaps(scene, program.position())[0]))
        times.append(taken)
    return 1e3 * float(np.median(times)) / frames, worst


def cheapest(scene: Scene, settings: Ladder, first: int, longest: float) -> tuple[int, float, float] | None:
    """Return the first rung from `first` on that keeps the overlap, its time [ms] and overlap [radii]."""
    for rung, (setting, make) in enumerate(settings[first:], first):
        try:
            taken, worst = measure(scene, make, longest)
        except (ImportError, OSError, TimeoutError) as error:
            say(f"  {setting}: {type(error).__name__}: {error}")
            return None
        say(f"  {setting}: {taken:.3g} ms, {worst:.2g} radii")
        if worst <= OVERLAP:
            return rung, taken, worst
    return None


def rows(options: argparse.Namespace) -> Iterator[dict[str, str]]:
    all_ladders = list(ladders(options.box2d3))
    first: dict[int, int | None] = dict.fromkeys(range(len(all_ladders)), 0)
    of_grain: dict[int, float] = {}  # time of 10 ms with fewer grains, by grain [s]
    for n in options.grains:
        _, state = splashing(n, options.cache)
        scene = flowing(n).replace(position=state.position, velocity=state.velocity)
        found: dict[tuple[str, int], tuple[float, float, str]] = {}
        for k, (name, threads, settings) in enumerate(all_ladders):
            begin = first[k]
            if begin is None or (threads > 1 and (n < 1_000 or (os.cpu_count() or 1) < threads)):
                continue
            say(f"{name}, {threads} threads, {n} grains")
            if of_grain.get(k, 0.0) * n * frames_of(n) > options.longest:
                say("  left out: it would take too long")
                continue
            best = cheapest(scene, settings, begin, options.longest)
            first[k] = best and best[0]
            if best:
                taken, worst = best[1:]
                of_grain[k] = 1e-3 * taken / n
                found[name, threads] = min(
                    found.get((name, threads), (np.inf, 0.0, "")), (taken, worst, settings[best[0]][0])
                )
        for (name, threads), (taken, worst, setting) in found.items():
            figures = f"{taken:.3g}", f"{worst:.2g}"
            yield dict(zip(COLUMNS, [name, str(threads), str(n), setting, *figures], strict=True))


def draw(measured: list[dict[str, str]], file: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panel = pyplot.subplots(figsize=(6.4, 4.6), layout="constrained")
    lines = list(dict.fromkeys((cells["program"], cells["threads"]) for cells in measured))
    markers = dict(zip(dict.fromkeys(name for name, _ in lines), MARKERS, strict=False))
    for name, threads in lines:
        own = [c for c in measured if (c["program"], c["threads"]) == (name, threads)]
        points = np.array([[float(c["n"]), float(c["ms of 10 ms"])] for c in own])
        style = "-" if threads == "1" else "--"
        label = name if threads == "1" else f"{name}, {threads} threads"
        panel.loglog(*points.T, markers[name] + style, label=label)
    title = f"the cheapest setting that keeps overlaps below {OVERLAP:g} radii"
    panel.set(xlabel="grains", ylabel="time of 10 ms simulated [ms]", title=title)
    panel.grid(alpha=0.3)
    panel.legend()
    figure.savefig(file, dpi=110)


def main(arguments: list[str] | None = None) -> None:
    parser = peers_command_line("growth", __doc__, GRAINS)
    parser.add_argument("--longest", type=float, default=300.0, help="limit of a measurement [s]")
    chosen = parsed(parser, arguments)
    measured = publish(rows(chosen), chosen.output, COLUMNS)
    if chosen.picture:
        draw(measured, chosen.picture)


if __name__ == "__main__":
    main()
