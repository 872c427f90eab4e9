"""Error of trajectories over dt, and overlap of runs of equal work with longer or shorter steps.

Both show how to spend a given number of iterations per simulated time: on few long or on many short steps.
"""

from collections.abc import Iterator
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import SimulationError
from warpgrains.report.rows import ACCURATE, COSTS, SCHEMES, SECOND_ORDER, SWEEPING, FrontierRow, PathRow
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.simulation.simulation import Simulation

COARSEST = 4  # longest time step tried, in those of the scene
FRACTIONS = (4.0, 2.0, 1.0, 1 / 2, 1 / 4, 1 / 8, 1 / 16)  # time steps, in those of the scene
FINEST = 1 / 64  # time step of the reference trajectory
DIVERGED = 0.01  # in smallest radii: difference of the two finest trajectories at which the comparison ends
SOLVED = 1e-9  # m/s; residual of every step
SOLVED_ITERATIONS = 20_000


class Path(NamedTuple):
    """The result of `follow`: the trajectories of all grains, and numbers of the run."""

    position: FloatArray
    """Positions after every four time steps of the scene [m], shape (k, n, 2)."""
    overlap: float
    """Worst overlap after any step of the second half of the run [m]."""
    fastest: float
    """Largest speed of a grain at the times of `position` [m/s]."""
    cpu_time: float
    """CPU time of all steps [s]."""


def measure_paths(scene: Scene, start: State, longest: int) -> Iterator[PathRow]:
    """Simulate a scene from a state in all time steps of `FRACTIONS`, by both schemes; yield a row for each.

    The corrections of the state are not used. All simulations have the same duration, four to `longest` time
    steps of the scene. They end before those with the two finest time steps differ by 1 % of the smallest
    radius.
    """
    solved = begin_solved(scene, start)
    finest = follow(solved, FINEST, longest, SCHEMES[SECOND_ORDER]).position
    finer = follow(solved, 2.0 * FINEST, longest, SCHEMES[SECOND_ORDER]).position
    difference = np.abs(finer - finest).max(axis=(1, 2))
    together = max(1, int(np.argmax(np.append(difference > DIVERGED * scene.radius.min(), True))))
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
                finest_error=float(difference[:together].max()),
                cpu_time=cpu_time,
            )


def measure_frontier(scene: Scene, start: State, horizon: int) -> Iterator[FrontierRow]:
    """Run a scene at each of `COSTS`, with every time step and method; yield a row for each run.

    A cost is a number of iterations per time step of the scene. Runs start from the positions and velocities
    of a state, and last `horizon` time steps of the scene. The order of contacts is "color".
    """
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
                outer = scene.bodies.outer
                is_tangent = outer is not None and not outer.is_round
                yield FrontierRow(
                    scene=scene.name,
                    method=method,
                    horizon=horizon * scene.dt,
                    cost=cost,
                    dt=dt,
                    iterations=iterations,
                    overlap=overlap,
                    wall_floor=(fastest * dt) ** 2 / (2.0 * scene.reach) * is_tangent,
                )


def begin(scene: Scene, state: State) -> Scene:
    """Return a scene that starts at the positions and velocities of a state."""
    return scene.replace(position=state.position, velocity=state.velocity)


def begin_solved(scene: Scene, state: State) -> Scene:
    """Return a scene that starts as that of `begin`, and whose steps are solved to a residual of 1e-9 m/s."""
    return begin(scene, state).replace(**ACCURATE, tolerance=SOLVED, max_iterations=SOLVED_ITERATIONS)


def possible_fractions(scene: Scene, scheme: str) -> list[float]:
    """Return those `FRACTIONS` of the scene's time step with which drag does not reverse velocities.

    `scheme` is that of `Scene`. In the leapfrog scheme, drag never reverses velocities.
    """
    longest = np.inf if scheme == "leapfrog" else scene.mass.min()
    return [fraction for fraction in FRACTIONS if scene.drag * scene.dt * fraction < longest]


def follow(scene: Scene, fraction: float, horizon: int, changes: dict[str, Any] | None = None) -> Path:
    """Simulate a scene with the fields `changes`, in time steps of `fraction` dt.

    dt is the time step of the scene. The simulation lasts `horizon` dt, a multiple of 4 dt.
    """
    simulation = Simulation(scene, dt=scene.dt * fraction, threads=1, **(changes or {}))
    fastest = overlap = cpu_time = 0.0
    position = []
    chunks = horizon // COARSEST
    for chunk in range(chunks):
        begun = process_time()
        statistics = simulation.advance(round(COARSEST / fraction))
        cpu_time += process_time() - begun
        overlap = max(overlap, statistics.overlap if 2 * chunk >= chunks else 0.0)
        fastest = max(fastest, float(np.hypot(*simulation.velocity.T).max()))
        position.append(simulation.position)
    return Path(np.stack(position), overlap, fastest, cpu_time)
