"""Jammed packings: walls under a pressure compress grains without gravity until the grains rest."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from warpgrains.analysis.network import rattlers
from warpgrains.analysis.packing import packing_fraction
from warpgrains.analysis.snapshot import snapshot
from warpgrains.analysis.walls import wall_forces
from warpgrains.base import checks
from warpgrains.base.described import fields_in_help
from warpgrains.base.errors import InputError
from warpgrains.base.shown import Shown, number_of
from warpgrains.scene.energy import TOLERANCES, kinetic_energy
from warpgrains.scene.scene import Scene, SceneLike, as_scene
from warpgrains.scene.snapshot import Snapshot
from warpgrains.scene.sources import require_closed
from warpgrains.simulation.simulation import Simulation
from warpgrains.simulation.until import TEST_INTERVAL, EndCriterion
from warpgrains.solver.statistics import Summary
from warpgrains.walls.box import Box
from warpgrains.walls.container import container_of
from warpgrains.walls.line import Line
from warpgrains.walls.rim import Rim

ENERGY = 1e-8  # largest kinetic energy at rest, in pressure times area, or that at `TOLERANCES` if larger
BALANCE = 1e-3  # largest relative difference between contact forces and pressure times length at rest
HELD = 10  # number of successive tests at which the grains must be at rest
WEAK = 1e-4  # force below which contacts do not count, in mean forces
WALL_LAYER = 4.0  # depth of the layer of grains that a wall orders, in mean diameters


@fields_in_help
@dataclass(frozen=True, repr=False)
class Packing(Shown):
    """Result of `compress`.

    Examples
    --------
    >>> packing = wg.compress(wg.Scene.load("jamming", "grains.count=60"))
    >>> f"{packing.contacts:.1f} contacts a grain, {packing.pressure:.2f} N/m"
    '4.0 contacts a grain, 1.00 N/m'
    """

    simulation: Simulation = field(repr=False)
    """The simulation at the end, which can be continued, saved and drawn."""
    at_rest: bool
    """Whether the grains came to rest, see `compress`."""
    radius: float
    """Radius of the outer wall [m]; NaN in a box."""
    lengths: tuple[float, float] | None
    """Lengths of the box along x and y [m]; None in an annulus."""
    fraction: float
    """Fraction of the area between the walls that grains fill. It is smaller near walls, which order the
    grains."""
    bulk_fraction: float
    """Fraction at distances of at least 4 mean diameters from walls; NaN if less than 4 diameters remain."""
    contacts: float
    """Twice the number of contacts of grains that are not rattlers, contacts with walls included, per such
    grain. Without friction it is 4 plus terms of order 1 / n if the balance of forces determines all forces.
    """
    rattlers: int
    """Grains that carry no loads, see `analysis.rattlers`."""
    pressure: float
    """Sum of the forces of contacts on the walls under pressure, per length of these walls [N/m]."""
    mean_force: float
    """Mean force of contacts between grains [N]; NaN without contacts."""
    largest_force: float
    """Largest force of contacts between grains [N]; NaN without contacts."""
    run: Summary = field(repr=False)
    """Summary of the run: steps, residuals, overlaps."""

    def results(self) -> dict[str, Any]:
        """Return the numbers by name, as ``warpgrains compress --json`` prints them, None instead of NaN."""
        own = {key: value for key, value in vars(self).items() if key not in ("simulation", "run")}
        return {key: None if value != value else value for key, value in (own | self.run.results()).items()}

    def summary(self) -> dict[str, str]:
        """Return the lines that describe the packing, by name."""
        _, force, length = _load(self.simulation)
        size = {"outer radius": f"{self.radius:.6g} m"}
        if self.lengths is not None:
            size = {"box": f"{self.lengths[0]:.6g} m by {self.lengths[1]:.6g} m"}
        bulk = f", {self.bulk_fraction:.4f} away from walls" if np.isfinite(self.bulk_fraction) else ""
        return {
            "scene": f"{self.simulation.scene.name}, {number_of(self.simulation.scene.n, 'grain')}",
            "steps": f"{self.run.steps}, {'at' if self.at_rest else 'not at'} rest",
            **size,
            "packing fraction": f"{self.fraction:.4f}{bulk}",
            "contacts": f"{self.contacts:.3f} a grain, without {self.rattlers} rattlers",
            "pressure": f"{self.pressure:.6g} N/m of contacts, {force / length:g} N/m given",
            "forces": f"mean {self.mean_force:.3e} N, largest {self.largest_force:.3e} N",
            "not converged": number_of(self.run.unconverged, "step"),
            "worst overlap": f"{self.run.overlap:.2e} m",
        }


def compress(
    scene: SceneLike, pressure: float | None = None, duration: float | None = None, progress: bool = False
) -> Packing:
    """Compress grains without gravity by a pressure on the outer wall, or sides of a box, until they rest.

    Parameters
    ----------
    scene : Scene, path or str
        Loose grains. Its gravity is set to 0, and its outer wall to "tangent". In a box, the sides move that
        have a pressure.
    pressure : float, optional
        Pressure [N/m]; by default that of the scene.
    duration : float, optional
        Longest simulated time [s]; by default the scene's.
    progress : bool
        Whether to show a progress bar on standard error.

    Returns
    -------
    Packing
        Fraction, contacts and forces, and the simulation. Its `at_rest` is True if, at ten tests in a row, 10
        steps apart, the forces of the walls under pressure p added up to p times their length within 0.1 %,
        and the kinetic energy of grains and walls, without rotation, was at most 1e-8 of p times the area, or
        that at a speed of 30 tolerances.

    Raises
    ------
    InputError
        There is no pressure, it is not positive, nothing holds it, the scene has segments or arcs, or another
        argument is invalid.

    Examples
    --------
    >>> packing = wg.compress(wg.Scene.load("jamming", "grains.count=60"))
    >>> packing.at_rest, packing.simulation.scene.pressure
    (True, 1.0)
    """
    scene = as_scene("scene", scene)
    require_closed(scene, "compress")
    box = scene.domain
    sides = box.sides if box else ()
    if thin := [wall for wall in scene.walls if wall.border is None and wall.name not in sides]:
        which = "a side" if box else "the outer wall"
        raise InputError(f"the scene has {thin[0].one()}: {which} would move through it")
    if box:
        scene = _under_pressure(scene, box, pressure)
    else:
        pressure = scene.pressure if pressure is None else pressure
        if pressure is None:
            raise InputError("pressure is missing: give it, or domain.pressure in the scene")
        pressure = checks.positive("pressure", pressure)
        scene = scene.replace(pressure=pressure, gravity=(0.0, 0.0), wall="tangent")
        if scene.n == 1 and len(scene.walls) == 1:
            raise InputError("compress: the scene has one grain, which cannot hold a circle around it")
    simulation, rest = Simulation(scene), EndCriterion(_is_at_rest, (HELD - 1) * TEST_INTERVAL, "rest")
    run = simulation.run(duration=duration, until=rest, progress=progress)
    return _packing(simulation, run)


def _under_pressure(scene: Scene, box: Box, pressure: float | None) -> Scene:
    """Return the scene without gravity, with `pressure` [N/m] on those sides of the box that have a pressure.

    If `pressure` is None, the sides keep their pressures. Raises InputError if no side has one.
    """
    pressed = {name: own for name in box.sides if (own := getattr(box, name)) and "pressure" in own}
    if not pressed:
        raise InputError(
            "no side of the box has a pressure: give pressure and mass to one that is not periodic, such as"
            " domain.top"
        )
    if pressure is not None:
        changes: dict[str, Any] = {name: {**own, "pressure": pressure} for name, own in pressed.items()}
        box = replace(box, **changes)
    for name in pressed:
        checks.positive(f"pressure on {name}", getattr(box, name)["pressure"])
    return scene.replace(domain=box, gravity=(0.0, 0.0))


def _load(simulation: Simulation) -> tuple[float, float, float]:
    """Return (contact force [N], pressure times length [N], length [m]), summed over walls under pressure."""
    scene, found = simulation.present_scene, wall_forces(simulation)
    force = given = whole = 0.0
    for name, wall in zip(scene.wall_names, scene.walls, strict=True):
        if not isinstance(wall, Line | Rim) or wall.pressure is None:
            continue
        if isinstance(wall, Line):
            length, pressing = scene.bodies.pressed_length(wall), -float(found[name].force @ wall.normal)
        else:
            length, pressing = 2.0 * np.pi * wall.radius, found[name].normal
        force, given, whole = force + pressing, given + wall.pressure * length, whole + length
    return force, given, whole


def _is_at_rest(simulation: Simulation) -> bool:
    scene, (force, given, length) = simulation.scene, _load(simulation)
    assert simulation.driven is not None
    inverse_mass = np.array([wall.drive.inverse_mass if wall.drive else 0.0 for wall in scene.walls])
    is_driven, speed = inverse_mass > 0.0, simulation.driven[:, 1]
    # without rotation: a rattler without drag on its spin never stops turning
    energy = float(kinetic_energy(scene.mass, scene.radius, simulation.velocity, 0.0))
    energy += float((0.5 * speed[is_driven] ** 2 / inverse_mass[is_driven]).sum())
    least = 0.5 * float(scene.mass.sum()) * (TOLERANCES * scene.tolerance) ** 2
    area = simulation.present_scene.space_at(simulation.time).area
    most = max(ENERGY * given / length * area, least)
    return bool(abs(force / given - 1.0) <= BALANCE and energy <= most)


def _lengths(simulation: Simulation) -> tuple[float, float]:
    """Return width and height of the container [m]."""
    container = container_of(simulation.present_scene, simulation.time, simulation.position)
    width, height = np.ptp(container.region.outer_box, axis=0).tolist()
    return width, height


def _packing(simulation: Simulation, run: Summary) -> Packing:
    now = snapshot(simulation)
    force = now.force if len(now.force) else np.array([np.nan])
    contacts, loose = carrying_contacts(now)
    pressing, _, length = _load(simulation)
    outer = now.scene.bodies.outer
    return Packing(
        simulation=simulation,
        at_rest=run.met,
        radius=float("nan") if outer is None else outer.radius,
        lengths=_lengths(simulation) if outer is None else None,
        fraction=packing_fraction(now),
        bulk_fraction=_bulk_fraction(now),
        contacts=contacts,
        rattlers=loose,
        pressure=pressing / length,
        mean_force=float(force.mean()),
        largest_force=float(force.max()),
        run=run,
    )


def carrying_contacts(now: Snapshot) -> tuple[float, int]:
    """Return (contacts per grain as in `Packing.contacts`, number of rattlers).

    Contacts with less than 1e-4 of the mean force do not count.
    """
    least = WEAK * float(now.force.mean()) if len(now.force) else np.nan
    loose = rattlers(now, least)
    between = ~loose[now.pair[now.force >= least]].any(axis=1)
    at_walls = ~loose[now.wall[now.wall_force >= least, 0]]
    held = int((~loose).sum())
    contacts = 2.0 * float(between.sum() + at_walls.sum())
    return contacts / held if held else 0.0, int(loose.sum())


def _bulk_fraction(now: Snapshot) -> float:
    """Return the packing fraction at least WALL_LAYER mean diameters from circles and sides.

    It is NaN if the space that is left is narrower than this distance.
    """
    layer = WALL_LAYER * 2.0 * float(now.scene.radius.mean())
    bulk = now.container.region.without_layer(layer)
    near, far = bulk.ring
    widths = np.ptp(bulk.outer_box, axis=0)[~bulk.period.repeats]
    is_small = not bulk.cells or min([far - near, *widths]) < layer
    return float("nan") if is_small else packing_fraction(now, bulk)
