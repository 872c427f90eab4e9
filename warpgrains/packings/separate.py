"""Separation of overlapping grains, such as those of a soft-sphere program, without giving them speeds."""

from dataclasses import dataclass, field, fields, replace
from typing import Any

from warpgrains.base import checks
from warpgrains.base.described import fields_in_help
from warpgrains.base.errors import SimulationError
from warpgrains.base.shown import Shown, number_of
from warpgrains.base.warp_start import find_device
from warpgrains.scene.scene import Scene, SceneLike, as_scene
from warpgrains.scene.state import first_state
from warpgrains.solver.advance import advance
from warpgrains.solver.engine import Engine
from warpgrains.solver.failures import infeasible_grains
from warpgrains.solver.sizes import Sizes
from warpgrains.solver.statistics import named
from warpgrains.solver.tuning import threads_for
from warpgrains.space.geometry import distance
from warpgrains.walls.line import Line
from warpgrains.walls.wall import StraightWall, Wall

LEAST = 1e-9  # smallest default bound on the overlaps, in smallest radii
MOST_STEPS = 50  # one or two are usual, because a step at a concave wall leaves overlaps of second order
ITERATIONS = 10_000  # largest number of iterations of a step


@fields_in_help
@dataclass(frozen=True, repr=False)
class Separation(Shown):
    """Result of `separate`.

    Examples
    --------
    >>> overlapping = wg.Scene(position=[[0.5, 0.0], [0.69, 0.0]], radius=0.1, mass=0.1, radius_out=2.0)
    >>> separation = wg.separate(overlapping)
    >>> f"{separation.shift:.4f} m", separation.overlap < 1e-8
    ('0.0050 m', True)
    """

    scene: Scene = field(repr=False)
    """The scene with the positions of the separated grains."""
    shift: float
    """Largest distance by which a grain was moved [m]."""
    overlap: float
    """Largest remaining overlap [m]."""
    steps: int
    """Number of steps done."""

    def summary(self) -> dict[str, str]:
        """Return the lines that describe the separation, by name."""
        return {
            "scene": f"{self.scene.name}, {number_of(self.scene.n, 'grain')}",
            "largest shift": f"{self.shift:.2e} m",
            "worst overlap": f"{self.overlap:.2e} m",
            "steps": f"{self.steps}",
        }


def separate(scene: SceneLike, overlap: float | None = None) -> Separation:
    """Move grains apart that overlap each other or a wall at the start of a scene.

    In a simulation, a step turns an overlap into a lasting speed, overlap / dt. This function only changes
    positions: it does steps from rest without gravity, and discards the velocities. These steps minimize the
    sum of squared displacements, weighted by the areas of the grains, so that neighbors stay neighbors.

    Parameters
    ----------
    scene : Scene, path or str
        Scene whose grains are moved. Velocities, spins, walls and all settings remain unchanged.
    overlap : float, optional
        Largest overlap to leave [m]; by default dt times the tolerance, which steps of the scene leave too,
        or 1e-9 smallest radii if that is larger.

    Raises
    ------
    InputError
        An argument is invalid.
    SimulationError
        Grains cannot be moved apart.

    Examples
    --------
    >>> grown = wg.Scene.load("polydisperse").replace(radius=0.02)
    >>> wg.separate(grown).scene.count_overlaps().pairs
    0
    """
    scene = as_scene("scene", scene)
    if overlap is None:
        overlap = max(scene.dt * scene.tolerance, LEAST * scene.smallest_radius)
    overlap = checks.positive("overlap", overlap)
    resting = Scene(
        position=scene.position,
        radius=scene.radius,
        mass=(scene.radius / scene.smallest_radius) ** 2,
        radius_in=scene.radius_in,
        radius_out=scene.radius_out,
        domain=scene.domain and replace(scene.domain, left=None, right=None, bottom=None, top=None),
        walls=[_at_rest(wall.at(scene.time)) for wall in scene.written_walls],
        gravity=(0.0, 0.0),
        dt=1.0,
        tolerance=overlap,
        method="accelerated",
        max_iterations=ITERATIONS,
        order=scene.order,
    )
    start, device = first_state(resting), find_device("cpu")
    threads = threads_for(resting, device)
    engine = Engine([resting], device, Sizes.first([resting], threads, device))
    (loaded,) = engine.scenes
    for step in range(1, MOST_STEPS + 1):
        engine.submit([1])
        advance([engine], threads)
        for error in engine.last_steps.errors.values():
            raise error
        report = engine.last_steps.report(0)
        if not report.converged and (wedged := infeasible_grains(engine.records, 0)):
            raise SimulationError(
                f"{named(wedged)} cannot be moved apart: they overlap too much, or do not fit"
            )
        if report.overlap <= overlap:
            shift = float(distance(loaded.position - scene.position).max())
            return Separation(scene.replace(position=loaded.position), shift, report.overlap, step)
        loaded.replace_state(replace(start, position=loaded.position))
    left = f"{report.overlap:.1e} m after {MOST_STEPS} steps"
    raise SimulationError(f"grains cannot be moved apart: they overlap by {left}")


def _at_rest(wall: Wall) -> Wall:
    """Return a wall of the same shape, with defaults for motion, forces and laws of contacts.

    Lines keep their names, by which a box knows its sides.
    """
    shared = {"pressure", *(own.name for own in fields(StraightWall))}
    shared -= {"name"} if isinstance(wall, Line) else set()
    changes: dict[str, Any] = {own.name: own.default for own in fields(wall) if own.name in shared}
    return replace(wall, **changes)
