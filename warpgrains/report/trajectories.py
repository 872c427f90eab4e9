"""The error of a whole trajectory against dt; and whether many short steps or few well solved ones pay."""

from collections.abc import Iterator
from time import process_time
from typing import NamedTuple

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.errors import SimulationError
from warpgrains.report.rows import ACCURATE, COSTS, SCHEMES, SECOND_ORDER, SWEEPING, FrontierRow, PathRow
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.simulation.simulation import Simulation

COARSEST = 4  # of the scene's own steps, in the longest one tried
FRACTIONS = (4.0, 2.0, 1.0, 1 / 2, 1 / 4, 1 / 8, 1 / 16)  # of the scene's own step
FINEST = 1 / 64  # the trajectory that the others are held against
APART = 0.01  # of the smallest radius: where it and one of steps twice as long part, it ends
SOLVED = 1e-9  # m/s: residual to which every step is solved
SOLVED_ITERATIONS = 20_000


class Path(NamedTuple):
    """A trajectory."""

    position: FloatArray
    """At every multiple of the coarsest step [m], shape (k, n, 2)."""
    overlap: float
    """Worst one after any step of its second half [m]."""
    fastest: float
    """Largest speed of a grain after any coarsest step [m/s]."""
    cpu_time: float
    """Spent on all steps [s]."""


def measure_paths(scene: Scene, start: State, longest: int) -> Iterator[PathRow]:
    """Follow the grains from a state on, without its corrections, by steps of all lengths in both schemes.

    They are followed for four of the scene's own steps, and on while two trajectories of fine steps stay
    together, for `longest` steps at most.
    """
    solved = begin_solved(scene, start)
    finest = follow(solved, FINEST, longest, SCHEMES[SECOND_ORDER]).position
    finer = follow(solved, 2.0 * FINEST, longest, SCHEMES[SECOND_ORDER]).position
    apart = np.abs(finer - finest).max(axis=(1, 2))
    together = max(1, int(np.argmax(np.append(apart > APART * scene.radius.min(), True))))
    for name, scheme in SCHEMES.items():
        for fraction in possible_fractions(scene, scheme["scheme"]):
            try:
                path = follow(solved, fraction, together * COARSEST, scheme)
            except SimulationError:
                error, cpu_time = np.nan, np.nan
            else:
                error, cpu_time = float(np.abs(path.position - finest[:together]).max()), path.cpu_time
            yield PathRow(
                scene=scene.name,
                scheme=name,
                horizon=together * COARSEST * scene.dt,
                dt=scene.dt * fraction,
                error=error,
                finest_error=float(apart[:together].max()),
                cpu_time=cpu_time,
            )


def measure_frontier(scene: Scene, start: State, horizon: int) -> Iterator[FrontierRow]:
    """Run from a state on, without its corrections, in color order, for `horizon` steps of the scene."""
    fastest = follow(begin_solved(scene, start), 1.0, horizon).fastest
    for cost in COSTS:
        for fraction in possible_fractions(scene, scene.scheme):
            for method in SWEEPING:
                dt, iterations = scene.dt * fraction, round(cost * fraction)
                spending = begin(scene, start).replace(
                    method=method, order="color", tolerance=0.0, max_iterations=iterations
                )
                try:
                    overlap = follow(spending, fraction, horizon).overlap
                except SimulationError:
                    overlap = np.nan
                yield FrontierRow(
                    scene=scene.name,
                    method=method,
                    horizon=horizon * scene.dt,
                    cost=cost,
                    dt=dt,
                    iterations=iterations,
                    overlap=overlap,
                    wall_floor=(fastest * dt) ** 2 / (2.0 * scene.radius_out) * (scene.wall == "tangent"),
                )


def begin(scene: Scene, state: State) -> Scene:
    """Return the scene that begins where another one is."""
    return scene.replace(position=state.position, velocity=state.velocity)


def begin_solved(scene: Scene, state: State) -> Scene:
    """Return the scene that begins where another one is, and solves every step."""
    return begin(scene, state).replace(**ACCURATE, tolerance=SOLVED, max_iterations=SOLVED_ITERATIONS)


def possible_fractions(scene: Scene, scheme: str) -> list[float]:
    """Return the fractions of a step in which drag turns no grain round, which the leapfrog does not mind."""
    longest = np.inf if scheme == "leapfrog" else scene.mass.min()
    return [fraction for fraction in FRACTIONS if scene.drag * scene.dt * fraction < longest]


def follow(scene: Scene, fraction: float, horizon: int, changes: dict[str, str] | None = None) -> Path:
    """Follow a scene for `horizon` of its steps, by steps of a fraction of their length."""
    simulation = Simulation(scene, dt=scene.dt * fraction, threads=1, **(changes or {}))
    fastest = overlap = cpu_time = 0.0
    position = []
    pieces = horizon // COARSEST
    for piece in range(pieces):
        begun = process_time()
        statistics = simulation.advance(round(COARSEST / fraction))
        cpu_time += process_time() - begun
        overlap = max(overlap, statistics.overlap if 2 * piece >= pieces else 0.0)
        fastest = max(fastest, float(np.hypot(*simulation.velocity.T).max()))
        position.append(simulation.position)
    return Path(np.stack(position), overlap, fastest, cpu_time)
