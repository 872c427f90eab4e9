"""The common flowing scene beside other programs: time against overlap, one thread, one run.

    python -m tests.bench.peers -o tests/bench/results/peers.csv --picture scenes/peers.png
    python -m tests.bench.peers --friction 0.5 -o tests/bench/results/peers_friction.csv

CPU time of 10 ms simulated, set-up and compiling apart, and the worst overlaps over 2 s, sampled every 10 ms
from the true circles. Programs that are not installed (extra `[bench]`), and Box2D 3 where its source is not
given, are left out, and said.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from warpgrains import Scene
from warpgrains.arrays import FloatArray

from .box2d3 import Box2d3, is_source
from .flow import DURATION, flowing
from .kamino import Kamino
from .peer_programs import FRAME, Box2d, Lammps, Pymunk, Warpgrains
from .rows import command_line, publish, say

COLUMNS = (
    "program",
    "setting",
    "n",
    "ms of 10 ms",
    "overlap of pairs",
    "of the outer wall",
    "of the inner wall",
)
Setting = tuple[str, str, Callable[[Scene], Any]]
MARKERS = "osD^vP"


def settings(box2d3: Path | None) -> Iterator[Setting]:
    """Name every program and setting, and how it is set up; `box2d3` is the folder of Box2D's source."""
    accelerated = {"method": "accelerated", "order": "color", "stop": "residual"}
    for dt in (0.01, 0.005, 0.0025):
        for tolerance in (1e-1, 1e-2, 1e-3, 1e-4):
            solver = accelerated | {"tolerance": tolerance}
            yield "warpgrains", f"dt {dt:g}, to {tolerance:g} m/s", partial(Warpgrains, dt=dt, **solver)
        for iterations in (5, 20, 60):
            solver = accelerated | {"tolerance": 0.0, "max_iterations": iterations}
            yield "warpgrains", f"dt {dt:g}, {iterations} iterations", partial(Warpgrains, dt=dt, **solver)
    for name, program in (("pymunk", Pymunk), ("Box2D 2.3", Box2d)):
        for substeps, iterations in ((1, 10), (1, 30), (4, 10), (10, 10), (40, 10)):
            setting = f"{substeps} sub-steps, {iterations} iterations"
            yield name, setting, partial(program, substeps=substeps, iterations=iterations)
    soft, stiff = ((1, 4), (1, 20), (1, 40), (1, 160)), ((4, 4), (10, 4), (40, 4))
    for steps, substeps in (*soft, *stiff):
        setting = f"{steps * substeps} sub-steps" + f", {steps} searches, stiff" * (steps > 1)
        make = partial(Box2d3, source=box2d3, steps=steps, substeps=substeps, stiff=steps > 1)
        yield "Box2D 3", setting, make
    for iterations in (24, 100, 400):
        yield "Newton Kamino", f"{iterations} iterations", partial(Kamino, iterations=iterations)
    for overlap in (1e-1, 1e-2, 1e-3):
        yield "LAMMPS", f"stiff for {overlap:g} radii", partial(Lammps, overlap=overlap)


def overlaps(scene: Scene, x: FloatArray) -> FloatArray:
    """Worst overlaps of pairs, with the outer and with the inner wall, in radii."""
    radius = float(scene.radius[0])
    pairs = cKDTree(x).query_pairs(2.0 * radius, output_type="ndarray")
    apart = np.hypot(*(x[pairs[:, 0]] - x[pairs[:, 1]]).T)
    rho = np.hypot(*x.T)
    worst = (
        np.max(2.0 * radius - apart, initial=0.0),
        max(0.0, rho.max() + radius - scene.radius_out),
        max(0.0, scene.radius_in + radius - rho.min()),
    )
    return np.array(worst) / radius


def measure(scene: Scene, make: Callable[[Scene], Any]) -> tuple[float, FloatArray]:
    """Return the CPU time [ms] that 10 ms take, and the worst overlaps [radii]."""
    frames = round(DURATION / FRAME)
    program, worst = make(scene), np.zeros(3)
    for _ in range(frames):
        program.advance(1)
        worst = np.maximum(worst, overlaps(scene, program.position()))
    program = make(scene)
    start = process_time()
    program.advance(frames)
    return 1e3 * (process_time() - start) / frames, worst


def rows(scene: Scene, box2d3: Path | None) -> Iterator[dict[str, str]]:
    missing = set()
    for name, setting, make in settings(box2d3):
        if name in missing:
            continue
        try:
            taken, worst = measure(scene, make)
        except (ImportError, OSError) as error:
            missing.add(name)
            say(f"{name} is left out: {error}")
            continue
        figures = [f"{value:.3g}" for value in (taken, *worst)]
        yield dict(zip(COLUMNS, [name, setting, str(scene.n), *figures], strict=True))


def draw(measured: list[dict[str, str]], file: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    sizes = sorted({int(cells["n"]) for cells in measured})
    size = (5.0 * len(sizes), 4.6)
    figure, panels = pyplot.subplots(1, len(sizes), figsize=size, squeeze=False, layout="constrained")
    names = list(dict.fromkeys(cells["program"] for cells in measured))
    for panel, n in zip(panels[0], sizes, strict=True):
        for name, marker in zip(names, MARKERS, strict=False):
            own = [c for c in measured if c["program"] == name and int(c["n"]) == n]
            points = np.array([[float(c["overlap of pairs"]), float(c["ms of 10 ms"])] for c in own])
            if len(points):
                panel.loglog(*points.T, marker, label=name, alpha=0.8)
        panel.set(title=f"{n:,} grains", xlabel="worst overlap of two grains [radii]")
        panel.grid(alpha=0.3)
    panels[0][0].set_ylabel("CPU time of 10 ms simulated [ms]")
    figure.legend(*panels[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=len(names))
    figure.savefig(file, dpi=110)


def peers_command_line(module: str, document: str | None, grains: Sequence[int]) -> argparse.ArgumentParser:
    """Return the parser of the options that comparisons with other programs have."""
    parser = command_line(module, document)
    parser.add_argument("--picture", type=Path, help="PNG file of the figures")
    parser.add_argument("--grains", type=int, nargs="+", default=grains, help="how many grains")
    parser.add_argument("--box2d3", type=Path, metavar="FOLDER", help="source of Box2D 3.1 or newer")
    return parser


def parsed(parser: argparse.ArgumentParser, arguments: list[str] | None) -> argparse.Namespace:
    """Return the options that are given, after a look at the source of Box2D."""
    chosen = parser.parse_args(arguments)
    if chosen.box2d3 and not is_source(chosen.box2d3):
        parser.error(f"--box2d3: {chosen.box2d3} holds no source of Box2D 3.1 or newer (src/physics_world.c)")
    return chosen


def main(arguments: list[str] | None = None) -> None:
    parser = peers_command_line("peers", __doc__, [100, 1000])
    parser.add_argument("--friction", type=float, default=0.0, help="coefficient of friction (default: 0)")
    chosen = parsed(parser, arguments)
    scenes = (flowing(n, friction=chosen.friction) for n in chosen.grains)
    measured = (cells for scene in scenes for cells in rows(scene, chosen.box2d3))
    written = publish(measured, chosen.output, COLUMNS)
    if chosen.picture:
        draw(written, chosen.picture)


if __name__ == "__main__":
    main()
