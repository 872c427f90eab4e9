"""Plane shear between rough walls in this and other programs: CPU time, friction, packing and overlaps.

A mean disc has a diameter of 1 m and a mass of 1 kg, and a lid presses with 1 N/m. So the shear rate [1/s] is
equal to the inertial number I. The lid, as heavy as its half discs, moves at I times the height of the box.
Soft discs have a restitution of 0.1; their walls are rows of fixed discs. CPU times are for one thread and a
unit of strain: the shorter of two runs without other measurements. The friction mu is shear force over normal
force, from the forces on both walls. The packing fraction phi and the shear rate are measured in the middle
half of the height, and overlaps in mean radii.
"""

import argparse
from collections.abc import Callable, Iterator
from functools import cache, partial
from itertools import product
from math import hypot, inf
from statistics import fmean
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from warpgrains import Box, Scene, Simulation, analysis
from warpgrains.base.arrays import FloatArray
from warpgrains.scene.layouts import random_layout

from .debian import ShearedOfLammps, contact
from .peer_programs import InDebian, new_lammps
from .peers import Settings, cpu_seconds, known, of_each
from .rows import Row

FRICTION = 0.5
RADII, WALL = (0.4, 0.6), 0.5  # radii of grains, and of half discs on the walls [m]
RUN_IN, TIMED = 2.0, 4.0  # strain before a measurement, and strain that is timed
MEASURED = {(400, 0.1): 20.0, (400, 0.01): 8.0}  # measured strain by (grains, I); else TIMED
MANY = 1_000  # for more grains, only one packing is measured
SAMPLE, READ = 0.01, 10  # strain per sample, and readings of forces per sample here
PASSES, BLOCKS = 2, 8
STEPS, TOLERANCES = (0.4, 0.2, 0.1, 0.05, 0.025, 0.0125), (1e-1, 1e-2)  # dt [s], tolerance over dt [m/s2]
STIFFNESSES, PARTS = (1e3, 1e4), (10, 20)  # stiffness over pressure, and steps per contact
REFERENCES = "warpgrains", "LAMMPS"  # programs whose finest settings are averaged
FIGURES = "mu", "phi", "rate"


def box(n: int, rate: float) -> Box:
    """Return a box of n square meters between rough walls, of which the upper one moves.

    Its velocity is the shear rate `rate` [1/s] times the height of the box.
    """
    height = 20.0 if n < 4_000 else 40.0
    rough: dict[str, Any] = {"roughness": {"radius": WALL, "spacing": 2.0 * WALL}}
    lid = {"velocity": (rate * height, 0.0), "pressure": 1.0, "mass": n / height}
    return Box((0.0, n / height), (0.0, height), periodic="x", bottom=rough, top=rough | lid)


@cache
def layout(n: int, seed: int) -> tuple[FloatArray, FloatArray]:
    domain = box(n, 0.0)
    walls = [wall for side in domain.sides.values() for wall in side]
    return random_layout(domain.space, walls, radius=[*RADII], packing_fraction=0.78, seed=seed)


def sheared(n: int, rate: float, seed: int) -> dict[str, Any]:
    """Return a scene of n grains for all programs, as values by name.

    Arrays hold n grains, then the discs of the bottom, then those of the lid.
    """
    domain, (position, radius) = box(n, rate), layout(n, seed)
    length, height = domain.lengths
    along = np.arange(WALL, length, 2.0 * WALL)
    rows = [np.stack([along, np.full(len(along), y)], axis=1) for y in (0.0, height)]
    return {
        "length": length,
        "height": height,
        "rate": rate,
        "friction": FRICTION,
        "n": len(radius),
        "position": np.concatenate([position, *rows]),
        "radius": np.concatenate([radius, np.full(2 * len(along), WALL)]),
        "domain": domain.table,
    }


class Warpgrains:
    """This package, on one thread.

    Forces on walls are read about READ times in `every` steps. If `every` is 0, they are not read.
    """

    def __init__(self, scene: dict[str, Any], dt: float, tolerance: float, every: int):
        n, height = scene["n"], scene["height"]
        position, radius = scene["position"][:n], scene["radius"][:n]
        own = Scene(
            position=position,
            velocity=np.stack([scene["rate"] * position[:, 1], np.zeros(n)], axis=1),
            radius=radius,
            mass=4.0 * radius**2,
            domain=scene["domain"],
            friction=scene["friction"],
            gravity=(0.0, 0.0),
            dt=dt,
            scheme="leapfrog",
            method="accelerated",
            order="color",
            stop="residual",
            tolerance=tolerance,
            max_iterations=5000,
            duration=1e9,
        )
        self._simulation, self._every, self._height = Simulation(own, threads=1), every, height
        self._lid = own.wall_names.index("top")

    def advance(self, steps: int) -> None:
        if not self._every:
            self._simulation.advance(steps)
            return
        stride, read = max(1, self._every // READ), []
        for left in range(steps, 0, -stride):
            self._simulation.advance(min(stride, left))
            read.append(self._wall_forces())
        self._force = np.mean(read, axis=0)

    def _wall_forces(self) -> FloatArray:
        """Return the forces of the grains on the lid (x, y) and on the bottom (x, y) [N], shape (4,)."""
        found = analysis.wall_forces(self._simulation)
        return np.concatenate([found[name].force for name in ("top", "bottom")])

    def sample(self) -> tuple[FloatArray, float, FloatArray, FloatArray]:
        now = self._simulation
        return self._force, self._height - now.driven[self._lid, 0], now.position, now.velocity[:, 0]


class Lammps(ShearedOfLammps):
    """LAMMPS: soft discs (granular hooke/history)."""

    def __init__(self, scene: dict[str, Any], stiffness: float, dt: float, every: int):
        self._lammps, (_, gamma) = new_lammps(), contact(stiffness)
        self.command = self._lammps.command
        hooke = f"{stiffness} {0.5 * stiffness} {gamma} {0.5 * gamma} {scene['friction']} 1 limit_damping"
        begin = ["units lj", "dimension 2", "boundary p f p", "atom_style sphere", "comm_modify vel yes"]
        moves = ["fix move grains nve/sphere disc", "fix plane all enforce2d"]
        self.start(scene, dt, every, begin, [f"pair_style gran/hooke/history {hooke}"], moves)

    def gather(self, name: str) -> FloatArray:
        return np.array(self._lammps.gather_atoms(name, 1, 3)).reshape(-1, 3)

    def mean(self, k: int) -> float:
        return self._lammps.extract_fix("mean", 0, 1, k)


def programs(whole: bool) -> dict[str, tuple[Callable[..., Any], Settings]]:
    """Return all programs by name: each with its class, and its settings as (name, arguments of the class).

    The finest setting is the last. Unless `whole`, there are only few settings.
    """
    pairs = product(STEPS, TOLERANCES) if whole else product(STEPS[2:5], TOLERANCES[:1])
    ours = [(f"dt {dt:g}, to {part:g} dt", {"dt": dt, "tolerance": part * dt}) for dt, part in pairs]
    springs = [
        (f"k / p {k:g}, contact in {parts} steps", {"stiffness": k, "dt": contact(k)[0] / parts})
        for k, parts in product(STIFFNESSES, PARTS if whole else PARTS[:1])
    ]
    return {
        "warpgrains": (Warpgrains, ours),
        "LAMMPS": (Lammps, springs),
        "LIGGGHTS": (partial(InDebian, name="liggghts, sheared"), springs),
        "YADE": (partial(InDebian, name="yade, sheared"), springs),
    }


def timed(make: Callable[..., Any], run_in: int, steps: int, all_steps: int, longest: float) -> float:
    """Return the CPU time per step [s], measured over `steps` steps after `run_in` steps.

    `make` starts the program. Raises TimeoutError if `all_steps` steps would take more than `longest` [s].
    """
    program, first = make(every=0), max(1, run_in // 10)
    program.advance(1)  # compiles the kernels
    expected = cpu_seconds(program, first) / first * all_steps
    if expected > longest:
        raise TimeoutError(f"it would take {expected:.0f} s")
    program.advance(run_in - first)
    return cpu_seconds(program, steps) / steps


def samples(
    program: Any, scene: dict[str, Any], begin: int, every: int, count: int, dt: float
) -> tuple[FloatArray, float]:
    """Simulate a shear of `begin` steps, then take `count` samples, one after every `every` steps.

    Returns shear force [N], normal force [N], phi and shear rate [1/s] of the samples, shape (count, 4), and
    the worst overlap [mean radii].
    """
    n, length, radius, place = scene["n"], scene["length"], scene["radius"], scene["position"].copy()
    lid, table, worst = n + (len(radius) - n) // 2, np.empty((count, 4)), 0.0
    program.advance(begin)
    for k in range(count):
        program.advance(every)
        force, top, place[:n], velocity = program.sample()
        way = scene["rate"] * scene["height"] * dt * (begin + (k + 1) * every)
        place[lid:] = np.add(scene["position"][lid:], (way, top - scene["height"]))
        worst = max(worst, overlap(place, radius, n, length))
        y, low, high = place[:n, 1], 0.25 * top, 0.75 * top
        inside = (y > low) & (y < high)
        area = area_below(high, y, radius[:n]).sum() - area_below(low, y, radius[:n]).sum()
        rate = np.polyfit(y[inside], np.array(velocity)[inside], 1)[0]
        table[k] = 0.5 * (force[2] - force[0]), force[1], area / (0.5 * top * length), rate
    return table, worst


def area_below(line: float, y: FloatArray, r: FloatArray) -> FloatArray:
    """Return the area of each disc below the height `line` [m2], shape (n,)."""
    h = np.clip(line - y, -r, r)
    return r * r * (0.5 * np.pi + np.arcsin(h / r)) + h * np.sqrt(r * r - h * h)


def overlap(place: FloatArray, radius: FloatArray, n: int, length: float) -> float:
    """Return the worst overlap of a grain with any disc [mean radii], in a box of period `length` in x [m].

    The grains are the first n discs; the others are those of the walls.
    """
    raised = np.stack([place[:, 0] % length, place[:, 1] - place[:, 1].min()], axis=1)
    i, j = cKDTree(raised, boxsize=[length, 1e6]).query_pairs(2.0 * max(RADII), output_type="ndarray").T
    i, j = i[i < n], j[i < n]  # i < j
    apart = place[i] - place[j]
    apart[:, 0] -= length * np.round(apart[:, 0] / length)
    return float(np.max(radius[i] + radius[j] - np.hypot(*apart.T), initial=0.0)) / WALL


def measure(
    make: Callable[..., Any],
    scenes: list[dict[str, Any]],
    strain: float,
    options: argparse.Namespace,
    **setting: Any,
) -> Row:
    """Return the figures of a program with a setting: CPU time, mu, phi, rate and the worst overlap.

    They are means over all scenes. Standard errors are from means of blocks of samples. `strain` is the
    strain in which samples are taken, and `make` the class of the program.
    """
    a_step, most = scenes[0]["rate"] * setting["dt"], options.steps or inf
    run_in, steps, whole = (max(1, round(min(part / a_step, most))) for part in (RUN_IN, TIMED, strain))
    every = min(max(1, round(SAMPLE / a_step)), whole)
    all_steps = len(scenes) * (run_in + whole + PASSES * (run_in + steps))
    times, blocks, worst = [], [], 0.0
    for scene in scenes:
        own = partial(make, scene, **setting)
        passes = [timed(own, run_in, steps, all_steps, options.longest) for _ in range(PASSES)]
        times.append(min(passes) / a_step)
        begin = every * max(1, round(run_in / every))
        table, own_worst = samples(own(every=every), scene, begin, every, whole // every, setting["dt"])
        worst = max(worst, own_worst)
        table[:, 0] /= table[:, 1].mean()
        parts = np.array_split(table[:, [0, 2, 3]], min(BLOCKS, len(table)))
        blocks += [part.mean(axis=0) for part in parts]
    figures = {"s of a strain": f"{np.mean(times):.4g}"}
    for name, values in zip(FIGURES, np.transpose(blocks), strict=True):
        own_error = values.std() / np.sqrt(max(1, len(values) - 1))
        figures |= {name: f"{values.mean():.3g}", f"error of {name}": f"{own_error:.1g}"}
    return figures | {"worst overlap": f"{worst:.2g}"}


def rows(options: argparse.Namespace) -> Iterator[Row]:
    """Yield a row for each setting of every program, each number of grains, and each inertial number."""
    by_name = programs(options.long)
    for n, rate, name in product(options.grains, options.rates, known(options.programs, by_name)):
        make, settings = by_name[name]
        scenes = [sheared(n, rate, seed + 1) for seed in range(options.seeds if n <= MANY else 1)]
        measured = partial(measure, make, scenes, MEASURED.get((n, rate), TIMED), options)
        for setting, figures in of_each(name, settings, measured):
            what = {"program": name, "setting": setting, "n": str(n), "I": f"{rate:g}"}
            yield what | {"seeds": str(len(scenes))} | figures


def error(row: Row, rows: list[Row]) -> float:
    """Return the largest relative error of mu, phi and rate in a row.

    `rows` are all rows of the same number of grains and inertial number. The reference is the mean of the
    finest settings (last rows) of warpgrains and LAMMPS. An error is at least its standard error.
    """
    finest = {other["program"]: other for other in rows if other["program"] in REFERENCES}.values()
    relative = []
    for name in FIGURES:
        value, mean = float(row[name]), fmean(float(other[name]) for other in finest)
        errors = [float(row[f"error of {name}"])]
        errors += [float(other[f"error of {name}"]) / len(finest) for other in finest]
        relative.append(max(abs(value - mean), hypot(*errors)) / mean)
    return max(relative)
