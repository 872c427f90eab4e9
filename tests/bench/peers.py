"""The common flowing scene in this and other programs, with and without friction: time against overlap.

    python -m tests.bench.peers --box2d3 FOLDER -o tests/bench/results/peers.csv

CPU time of 10 ms simulated by one thread, without set-up and compiling, and the worst overlaps, sampled
every 10 ms from the true circles. The window is 2 s, and of more than 1,000 grains 0.05 s in which all
splash. Programs that are not installed (extra `[bench]`, and packages of Debian: yade, liggghts,
python3-siconos and python3-scipy), and settings that take too long, are left out, and reported.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from warpgrains import Scene
from warpgrains.arrays import FloatArray

from .box2d3 import Box2d3, is_source
from .flow import flowing, splashing
from .kamino import Kamino
from .peer_programs import Box2d, Lammps, OfDebian, Pymunk, Warpgrains
from .rows import command_line, publish, say

COLUMNS = (
    "program",
    "setting",
    "friction",
    "n",
    "ms of 10 ms",
    "overlap of pairs",
    "of the outer wall",
    "of the inner wall",
)
Make = Callable[[Scene], Any]
FRICTIONS = 0.5, 0.0
GRAINS = 1_000, 10_000, 100
SLOW = {"Siconos": 1_000}  # grains at most: 10,000 did not end
FROM_REST, SPLASH = 200, 5  # frames of 10 ms
SHORT, PASSES = 2.0, 5  # s of CPU time up to which the window is measured again, so often, in one go
SPRINGS = [(f"stiff for {overlap:g} radii", {"overlap": overlap}) for overlap in (0.1, 0.035, 0.01, 0.001)]
SUBSTEPS = [
    (f"{substeps} sub-steps of {iterations} iterations", {"substeps": substeps, "iterations": iterations})
    for substeps, iterations in ((1, 10), (10, 10), (20, 10), (40, 10), (80, 10))
]
SEARCHES = [
    (f"{steps} searches, {steps * substeps} sub-steps", {"steps": steps, "substeps": substeps})
    for steps, substeps in ((1, 4), (4, 4), (10, 4), (20, 4), (40, 4), (80, 4))
]


def peers(box2d3: Path | None) -> dict[str, tuple[Callable[..., Any], list[tuple[str, dict[str, Any]]]]]:
    """Return how each program is set up, and its settings by name; `box2d3` is the folder of its source."""
    accelerated = [
        (f"dt {dt:g}, to {tolerance:g} m/s", {"dt": dt, "tolerance": tolerance})
        for dt, tolerance in product((0.01, 0.0025), (1e-1, 3e-2, 1e-2, 1e-3, 1e-4))
    ]
    of_ours = partial(Warpgrains, order="color", stop="residual")
    return {
        "warpgrains, accelerated": (partial(of_ours, method="accelerated"), accelerated),
        "warpgrains, plain": (partial(of_ours, method="gauss-seidel"), accelerated[:5]),
        "warpgrains, exact": (partial(of_ours, method="exact"), accelerated[:5]),
        "Box2D 3": (partial(Box2d3, source=box2d3), SEARCHES),
        "pymunk": (Pymunk, SUBSTEPS),
        "Box2D 2.3": (Box2d, SUBSTEPS),
        "LAMMPS": (Lammps, SPRINGS),
        "LIGGGHTS": (partial(OfDebian, name="liggghts"), SPRINGS),
        "Newton Kamino": (
            Kamino,
            [(f"{count} iterations", {"iterations": count}) for count in (24, 100, 400)],
        ),
        "YADE": (partial(OfDebian, name="yade"), SPRINGS),
        "Siconos": (
            partial(OfDebian, name="siconos", tolerance=1e-4),
            [(f"dt {dt:g}", {"dt": dt}) for dt in (0.01, 0.0025)],
        ),
    }


def start(n: int, friction: float, cache: Path) -> tuple[Scene, int]:
    """Return the scene that is measured, and the frames of its window."""
    scene = flowing(n, friction=friction)
    if n <= GRAINS[0]:
        return scene, FROM_REST
    _, state = splashing(n, cache)
    return scene.replace(position=state.position, velocity=state.velocity), SPLASH


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


def measure(scene: Scene, frames: int, make: Make, longest: float) -> tuple[float, FloatArray]:
    """Return the CPU time [ms] of 10 ms, and the worst overlaps [radii].

    Raises
    ------
    TimeoutError
        The window would take more than `longest` [s].
    """
    program, worst = make(scene), np.zeros(3)
    times: list[float] = []
    while len(times) < frames:
        times.append(_cpu_seconds(program, 1))
        expected = median(times) * frames
        if len(times) > 2 and expected > longest:
            raise TimeoutError(f"it would take {expected:.0f} s")
        worst = np.maximum(worst, overlaps(scene, program.position()))
    if expected > SHORT:
        return 1e3 * sum(times) / frames, worst
    return 1e3 * median(_cpu_seconds(make(scene), frames) for _ in range(PASSES)) / frames, worst


def _cpu_seconds(program: Any, frames: int) -> float:
    clock = getattr(program, "cpu_seconds", process_time)
    begun = clock()
    program.advance(frames)
    return clock() - begun


def rows(
    scene: Scene, frames: int, chosen: list[str], box2d3: Path | None, longest: float
) -> Iterator[dict[str, str]]:
    for name in (name for name in chosen if scene.n <= SLOW.get(name, scene.n)):
        make, settings = peers(box2d3)[name]
        for k, (setting, options) in enumerate(settings):
            try:
                of_setting = partial(make, **options)
                if k == 0:
                    measure(scene, frames, of_setting, longest)  # so that all kernels are compiled
                taken, worst = measure(scene, frames, of_setting, longest)
            except TimeoutError as error:
                say(f"  {name}, {setting}: left out: {error}")
                continue
            except (ImportError, OSError) as error:
                say(f"{name} is left out: {error}")
                break
            figures = [f"{value:.3g}" for value in (taken, *worst)]
            what = name, setting, f"{scene.friction:g}", str(scene.n)
            yield dict(zip(COLUMNS, [*what, *figures], strict=True))


def main(arguments: list[str] | None = None) -> None:
    parser = command_line("peers", __doc__)
    programs = list(peers(None))
    parser.add_argument("--grains", type=int, nargs="+", default=GRAINS, help="numbers of grains")
    parser.add_argument("--friction", type=float, nargs="+", default=FRICTIONS, help="coefficients")
    parser.add_argument(
        "--only", nargs="+", choices=programs, default=programs, help="programs that are measured"
    )
    parser.add_argument("--box2d3", type=Path, metavar="FOLDER", help="source of Box2D 3.1 or newer")
    parser.add_argument("--longest", type=float, default=80.0, help="limit of a measurement [s]")
    chosen = parser.parse_args(arguments)
    if chosen.box2d3 and not is_source(chosen.box2d3):
        parser.error(f"--box2d3: {chosen.box2d3} holds no source of Box2D 3.1 or newer (src/physics_world.c)")
    measured = (
        cells
        for n, friction in product(chosen.grains, chosen.friction)
        for cells in rows(*start(n, friction, chosen.cache), chosen.only, chosen.box2d3, chosen.longest)
    )
    publish(measured, chosen.output, COLUMNS)


if __name__ == "__main__":
    main()
