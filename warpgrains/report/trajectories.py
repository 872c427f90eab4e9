"""The error of a whole trajectory against dt."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.simulation.simulation import Simulation

COARSEST = 4  # of the scene's own steps, in the longest one tried
FRACTIONS = (4.0, 2.0, 1.0, 1 / 2, 1 / 4, 1 / 8, 1 / 16)  # of the scene's own step
FINEST = 1 / 64  # the trajectory that the others are held against
APART = 0.01  # of the smallest radius: where it and one of steps twice as long part, it ends
SOLVED = 1e-9  # m/s: residual to which every step is solved
SOLVED_ITERATIONS = 20_000


@dataclass(frozen=True)
class PathRow:
    """A trajectory: a row of trajectories.csv.

    Attributes
    ----------
    scene : str
    horizon : float
        How long it is [s].
    dt : float
        [s].
    error : float
        Largest distance of a coordinate from the trajectory of steps 1/64 as long as the scene's own, at any
        multiple of four of the scene's own steps [m].
    finest_error : float
        The same distance of a trajectory of steps 1/32 as long: errors near it are not to be trusted [m].
    """

    scene: str
    horizon: float
    dt: float
    error: float
    finest_error: float


class Path(NamedTuple):
    """A trajectory."""

    position: FloatArray
    """At every multiple of the coarsest step [m], shape (k, n, 2)."""
    overlap: float
    """Worst one after any step of its second half [m]."""
    fastest: float
    """Largest speed of a grain after any step [m/s]."""


def measure_paths(scene: Scene, start: State, longest: int) -> Iterator[PathRow]:
    """Follow the grains from a state on, without its corrections, by steps of all lengths.

    Parameters
    ----------
    scene : Scene
    start : State
    longest : int
        Steps of the scene for which they are followed at most: four, and on while two trajectories of fine
        steps stay together.
    """
    solved = begin_solved(scene, start)
    finest = follow(solved, FINEST, longest).position
    finer = follow(solved, 2.0 * FINEST, longest).position
    apart = np.abs(finer - finest).max(axis=(1, 2))
    together = max(1, int(np.argmax(np.append(apart > APART * scene.radius.min(), True))))
    for fraction in possible_fractions(scene):
        position = follow(solved, fraction, together * COARSEST).position
        yield PathRow(
            scene=scene.name,
            horizon=together * COARSEST * scene.dt,
            dt=scene.dt * fraction,
            error=float(np.abs(position - finest[:together]).max()),
            finest_error=float(apart[:together].max()),
        )


def begin(scene: Scene, state: State) -> Scene:
    """Return the scene that begins where another one is."""
    return scene.replace(position=state.position, velocity=state.velocity)


def begin_solved(scene: Scene, state: State) -> Scene:
    """Return the scene that begins where another one is, and solves every step."""
    return begin(scene, state).replace(
        method="accelerated",
        order="color",
        stop="residual",
        tolerance=SOLVED,
        max_iterations=SOLVED_ITERATIONS,
    )


def possible_fractions(scene: Scene) -> list[float]:
    """Return the fractions of a step in which drag turns no grain round."""
    return [fraction for fraction in FRACTIONS if scene.drag * scene.dt * fraction < scene.mass.min()]


def follow(scene: Scene, fraction: float, horizon: int) -> Path:
    """Follow a scene for so many of its steps, by steps of a fraction of their length."""
    simulation = Simulation(scene, dt=scene.dt * fraction, threads=1)
    fastest = overlap = 0.0
    position = []
    pieces = horizon // COARSEST
    for piece in range(pieces):
        for _ in range(round(COARSEST / fraction)):
            report = simulation.step()
            overlap = max(overlap, report.overlap if 2 * piece >= pieces else 0.0)
            fastest = max(fastest, float(np.hypot(*simulation.velocity.T).max()))
        position.append(simulation.position)
    return Path(np.stack(position), overlap, fastest)


def fitted_order(rows: list[PathRow]) -> float | None:
    """Return p of error = c dt^p, by least squares in the logarithms; None of fewer than two errors."""
    rows = [row for row in rows if row.error > 0.0]
    if len(rows) < 2:
        return None
    return float(np.polyfit(np.log([row.dt for row in rows]), np.log([row.error for row in rows]), 1)[0])
