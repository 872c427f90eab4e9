"""Jammed packings: grains without gravity in an outer wall under a pressure, until they rest."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from warpgrains.analysis.network import rattlers
from warpgrains.analysis.packing import global_packing_fraction
from warpgrains.analysis.profiles import radial_profile
from warpgrains.analysis.snapshot import snapshot
from warpgrains.described import fields_in_help
from warpgrains.errors import InputError
from warpgrains.scene.annulus import OUTER
from warpgrains.scene.energy import TOLERANCES, kinetic_energy
from warpgrains.scene.scene import SceneLike, as_scene
from warpgrains.scene.snapshot import Snapshot
from warpgrains.shown import Shown, number_of
from warpgrains.simulation.simulation import Simulation
from warpgrains.simulation.until import TEST_INTERVAL, EndCriterion
from warpgrains.solver.statistics import Summary

ENERGY = 1e-8  # largest kinetic energy at rest, in pressure times area, or that at `TOLERANCES` if larger
BALANCE = 1e-3  # largest relative difference of the forces of the outer wall from 2 pi R p at rest
HELD = 10  # tests in a row that the grains must rest
WEAK = 1e-4  # force of contacts that do not count, in mean forces
WALL_LAYER = 4.0  # depth of the grains that a wall orders, in mean diameters
RINGS = 50  # of the profile from which the fraction of the bulk is taken


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
    """Radius of the outer wall [m]."""
    fraction: float
    """Fraction of the area between the walls that grains fill. Walls order the grains next to them, which
    fill less."""
    bulk_fraction: float
    """The same at least 4 mean diameters from the circles; NaN if less than 4 diameters remain there."""
    contacts: float
    """Contacts of a grain that is no rattler: twice the contacts of the grains that carry, those with walls
    included, per grain. Without friction it is 4, but for terms of order 1 / n, where forces follow from
    balance alone."""
    rattlers: int
    """Grains that carry no loads, see `analysis.rattlers`."""
    pressure: float
    """Sum of the forces of the outer wall per length of the circle [N/m]."""
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
        given = self.simulation.scene.pressure
        bulk = f", {self.bulk_fraction:.4f} away from walls" if np.isfinite(self.bulk_fraction) else ""
        return {
            "scene": f"{self.simulation.scene.name}, {number_of(self.simulation.scene.n, 'grain')}",
            "steps": f"{self.run.steps}, {'at' if self.at_rest else 'not at'} rest",
            "outer radius": f"{self.radius:.6g} m",
            "packing fraction": f"{self.fraction:.4f}{bulk}",
            "contacts": f"{self.contacts:.3f} a grain, without {self.rattlers} rattlers",
            "pressure": f"{self.pressure:.6g} N/m of contacts, {given:g} N/m given",
            "forces": f"mean {self.mean_force:.3e} N, largest {self.largest_force:.3e} N",
            "not converged": number_of(self.run.unconverged, "step"),
            "worst overlap": f"{self.run.overlap:.2e} m",
        }


def compress(
    scene: SceneLike, pressure: float | None = None, duration: float | None = None, progress: bool = False
) -> Packing:
    """Compress grains without gravity by a pressure on the outer wall until they rest.

    Parameters
    ----------
    scene : Scene, path or str
        Loose grains. Its gravity is set to 0, and its outer wall to "tangent".
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
        steps apart, the forces of the outer wall added up to 2 pi R p within 0.1 %, and the kinetic energy of
        grains and wall, without rotation, was at most 1e-8 of p times the area, or that of 30 tolerances.

    Raises
    ------
    InputError
        There is no pressure, it is not positive, nothing holds it, the scene has segments or arcs, or another
        argument is invalid. The method "exact" is refused.

    Examples
    --------
    >>> packing = wg.compress(wg.Scene.load("jamming", "grains.count=60"))
    >>> packing.at_rest, packing.simulation.scene.pressure
    (True, 1.0)
    """
    scene = as_scene("scene", scene)
    pressure = scene.pressure if pressure is None else pressure
    if pressure is None:
        raise InputError("pressure is missing: give it, or domain.pressure in the scene")
    thin = [wall for wall in scene.walls if wall.border is None]
    if thin:
        raise InputError(f"the scene has {thin[0].one()}: the outer wall would shrink through it")
    scene = scene.replace(pressure=pressure, gravity=(0.0, 0.0), wall="tangent")
    if scene.pressure is None or scene.pressure <= 0.0:
        raise InputError(f"pressure is {scene.pressure} N/m: it must be positive to compress grains")
    if scene.n == 1 and scene.radius_in == 0.0 and not scene.walls:
        raise InputError("compress: the scene has one grain, which cannot hold a circle around it")
    simulation, rest = Simulation(scene), EndCriterion(_is_at_rest, (HELD - 1) * TEST_INTERVAL, "rest")
    run = simulation.run(duration=duration, until=rest, progress=progress)
    return _packing(simulation, run)


def _is_at_rest(simulation: Simulation) -> bool:
    scene, state = simulation.scene, simulation.state()
    assert state.driven is not None
    assert scene.pressure is not None
    radius, speed = state.driven[OUTER]
    wall = 0.5 * speed**2 / scene.bodies.drives[OUTER].inverse_mass
    # without rotation: a rattler without drag on its spin never stops turning
    energy = wall + float(kinetic_energy(scene.mass, scene.radius, state.velocity, 0.0))
    least = 0.5 * float(scene.mass.sum()) * (TOLERANCES * scene.tolerance) ** 2
    excess = _wall_pressure(simulation) / scene.pressure - 1.0
    return abs(excess) <= BALANCE and energy <= max(ENERGY * scene.pressure * np.pi * radius**2, least)


def _wall_pressure(simulation: Simulation) -> float:
    """Return the forces of the outer wall per length of its circle [N/m]."""
    contacts = simulation.wall_contacts()
    force = contacts.force[contacts.wall[:, 1] == OUTER].sum()
    return float(force / (2.0 * np.pi * simulation.present_scene.radius_out))


def _packing(simulation: Simulation, run: Summary) -> Packing:
    now = snapshot(simulation)
    force = now.force if len(now.force) else np.array([np.nan])
    contacts, loose = carrying_contacts(now)
    return Packing(
        simulation=simulation,
        at_rest=run.met,
        radius=now.scene.radius_out,
        fraction=global_packing_fraction(now),
        bulk_fraction=_bulk_fraction(now),
        contacts=contacts,
        rattlers=loose,
        pressure=_wall_pressure(simulation),
        mean_force=float(force.mean()),
        largest_force=float(force.max()),
        run=run,
    )


def carrying_contacts(now: Snapshot) -> tuple[float, int]:
    """Return the contacts a grain, above 1e-4 of the mean force, without rattlers; and their number."""
    least = WEAK * float(now.force.mean()) if len(now.force) else np.nan
    loose = rattlers(now, least)
    between = ~loose[now.pair[now.force >= least]].any(axis=1)
    at_walls = ~loose[now.wall[now.wall_force >= least, 0]]
    held = int((~loose).sum())
    contacts = 2.0 * float(between.sum() + at_walls.sum())
    return contacts / held if held else 0.0, int(loose.sum())


def _bulk_fraction(now: Snapshot) -> float:
    """Return the packing fraction of the rings that are far from the circles; NaN if these are few."""
    profile, scene = radial_profile(now, RINGS), now.scene
    layer = WALL_LAYER * 2.0 * float(scene.radius.mean())
    inner, outer, _ = scene.annulus.without_layer(layer)
    if outer - inner < layer:
        return float("nan")
    low, high = profile.edges[:-1], profile.edges[1:]
    space = np.where((low >= inner) & (high <= outer), high**2 - low**2, 0.0)
    return float(profile.packing_fraction @ space / space.sum())
