"""Named scalar quantities of a state, for the series of a run and the tables of sweeps."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from inspect import signature
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from warpgrains.analysis import contacts, energy, forces, network, packing, region_table
from warpgrains.analysis.energy import EnergyBalance, require_energy_balance, step_energy_balance
from warpgrains.analysis.region_table import Where, region_of
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.analysis.walls import circle_forces, require_wall, wall_forces, wall_places
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError, NoAreaError
from warpgrains.scene.scene import Scene
from warpgrains.scene.snapshot import Snapshot, Snapshots
from warpgrains.scene.state import first_state
from warpgrains.walls.container import container_of


class Quantity(NamedTuple):
    """A scalar quantity of a snapshot: one element of the result of a function.

    Quantities of the same function share one call.
    """

    unit: str
    """Unit; empty for a dimensionless number."""
    function: Callable[..., Any]
    part: Callable[..., float] = float
    """Function that returns the quantity from the result of `function`. For a quantity of a wall, its second
    argument is the wall's name."""
    of_runs: Callable[[Snapshots], FloatArray] | None = None
    """Function that returns the quantity of m scenes, shape (m,). Only quantities that are columns of the
    results of every sweep have one."""
    meaning: str = ""
    require: Callable[[str, Scene], object] = lambda name, scene: None
    """Function that takes the name of the quantity and a scene. It raises InputError if the scene cannot have
    the quantity without a region."""


def _require_known(name: str, scene: Scene) -> None:
    container_of(scene, 0.0, scene.position).require_known(f"{name}: ", takes_region([name]))


def _require_closed(name: str, scene: Scene) -> None:
    container_of(scene, 0.0, scene.position).closed(f"{name}: ")


def _of_runs(unit: str, of_runs: Callable[[Snapshots], FloatArray], meaning: str) -> Quantity:
    return Quantity(unit, lambda now: of_runs(now.grains).item(), of_runs=of_runs, meaning=meaning)


def _stress(a: int, b: int, sign: float = 1.0) -> Quantity:
    """Return the quantity (sigma_ab + sign sigma_ba) / 2 of the mean stress sigma, see `mean_stress`."""
    part = "component" if sign > 0.0 else "antisymmetric part, (xy - yx) / 2,"
    return Quantity(
        "N/m",
        contacts.mean_stress,
        lambda found: float(0.5 * (found[a, b] + sign * found[b, a])),
        meaning=f"{part} of the mean stress of contacts and kinetic, compression positive",
        require=_require_closed,
    )


def kinetic_stress(of: Snapshot | HasState, region: Where = None) -> FloatArray:
    """Return the kinetic part of `mean_stress` [N/m], shape (2, 2)."""
    return contacts.mean_stress(of, region, "kinetic")


def _kinetic(a: int, b: int) -> Quantity:
    return Quantity(
        "N/m",
        kinetic_stress,
        lambda found: float(found[a, b]),
        meaning="part of the stress that grains carry about their mean velocity",
        require=_require_closed,
    )


def _of_wall(unit: str, function: Callable[..., Any], part: Callable[[Any], float], meaning: str) -> Quantity:
    return Quantity(
        unit,
        function,
        lambda found, wall: float(part(found[wall])),
        meaning=f"{meaning}, of the wall that follows a colon",
        require=require_wall,
    )


def _force(part: str, meaning: str) -> Quantity:
    return Quantity("N", forces.force_statistics, attrgetter(part), meaning=f"{meaning} between grains")


def _circle_force(which: int, meaning: str) -> Quantity:
    one = _of_runs("N", partial(circle_forces, which=which), f"sum of the contact forces on {meaning}")
    return one._replace(require=_require_circle)


def _require_circle(name: str, scene: Scene) -> None:
    if scene.bodies.outer is None:
        raise InputError(f"{name}: the scene is a box; force_x:bottom and so on are the forces on its sides")


def _power(part: str, meaning: str) -> Quantity:
    return Quantity("W", _powers, attrgetter(part), meaning=meaning, require=require_energy_balance)


def _powers(now: Snapshot) -> EnergyBalance:
    """Return the energy balance of the last step, divided by the duration of the step [W]."""
    return EnergyBalance(*(energy / now.scene.dt for energy in step_energy_balance(now)))


def _flow(name: str, column: int, unit: str, meaning: str) -> Quantity:
    def function(now: Snapshot) -> float:
        _require_exchange(name, now.scene)
        rows = getattr(now, name.partition("_")[0])
        return np.nan if rows is None else float(rows[:, column].sum())

    return Quantity(unit, function, meaning=meaning, require=_require_exchange)


def _require_exchange(name: str, scene: Scene) -> None:
    if not scene.exchanges_grains:
        raise InputError(f"{name}: the scene has no sources or sinks")


QUANTITIES = {
    "kinetic_energy": _of_runs(
        "J", energy.kinetic_energies, "sum of m v^2 / 2, and with friction of I w^2 / 2"
    ),
    "potential_energy": _of_runs("J", energy.potential_energies, "sum of -m g . x, 0 at the origin"),
    "contact_power": _power("contact_loss", "power that contacts dissipate, in the last step"),
    "drag_power": _power("drag_loss", "power that drag dissipates, in the last step"),
    "friction_power": _power("friction_loss", "part of `contact_power` due to friction"),
    "wall_power": _power("wall_work", "power of walls that rotate or move, in the last step"),
    "outer_wall_force": _circle_force(1, "the outer wall"),
    "inner_wall_force": _circle_force(0, "the inner wall"),
    "pile_height": Quantity(
        "m",
        packing.pile_height,
        of_runs=packing.pile_heights,
        meaning="highest point of a grain above the lowest point of the container",
        require=_require_known,
    ),
    "packing_fraction": Quantity(
        "",
        packing.packing_fraction,
        of_runs=packing.packing_fractions,
        meaning="share of the region that grains fill, by default of the container below the mean height",
        require=_require_known,
    ),
    "coordination_number": Quantity(
        "", network.coordination_number, meaning="mean number of contacts of a grain, walls included"
    ),
    "rattlers": Quantity(
        "",
        network.rattlers,
        lambda found: float(np.count_nonzero(found)),
        meaning="number of grains that their contacts do not hold",
    ),
    "pressure": Quantity(
        "N/m",
        contacts.pressure,
        meaning="half the trace of the mean stress, of contacts and kinetic",
        require=_require_closed,
    ),
    "stress_xx": _stress(0, 0),
    "stress_xy": _stress(0, 1),
    "stress_yy": _stress(1, 1),
    "stress_antisymmetric": _stress(0, 1, -1.0),
    "kinetic_stress_xx": _kinetic(0, 0),
    "kinetic_stress_xy": _kinetic(0, 1),
    "kinetic_stress_yy": _kinetic(1, 1),
    "force_x:WALL": _of_wall("N", wall_forces, lambda own: own.force[0], "force of the grains along x"),
    "force_y:WALL": _of_wall("N", wall_forces, lambda own: own.force[1], "force of the grains along y"),
    "torque:WALL": _of_wall(
        "N m", wall_forces, lambda own: own.torque, "torque about its pivot or the origin"
    ),
    "position_x:WALL": _of_wall("m", wall_places, lambda own: own[0], "place along x"),
    "position_y:WALL": _of_wall("m", wall_places, lambda own: own[1], "place along y"),
    "mean_force": _force("mean", "mean of the forces"),
    "largest_force": _force("largest", "largest force"),
    "force_deviation": _force("deviation", "standard deviation of the forces"),
    "grain_count": Quantity(
        "", region_table.grain_count, meaning="number of grains in the region, or of all"
    ),
    "grain_mass": Quantity("kg", region_table.grain_mass, meaning="mass of these grains"),
    "inflow_count": _flow("inflow_count", 1, "", "number of grains that sources have added so far"),
    "outflow_count": _flow("outflow_count", 0, "", "number of grains that sinks have taken so far"),
    "outflow_mass": _flow("outflow_mass", 1, "kg", "mass of these grains"),
    "mean_speed": Quantity("m/s", energy.mean_speed, meaning="mean speed of the grains"),
    "largest_speed": Quantity("m/s", energy.largest_speed, meaning="speed of the fastest grain"),
    "granular_temperature": Quantity(
        "m2/s2", energy.granular_temperature, meaning="mean square of a component of v - <v>"
    ),
}
"""All quantities by name; powers and forces are those of the last step. WALL is the name of a wall."""
OF_WALLS = {name.removesuffix("WALL") for name in QUANTITIES if name.endswith(":WALL")}

GROUPS = {
    "energy": ("kinetic_energy", "potential_energy", "contact_power", "drag_power"),
    "walls": ("outer_wall_force", "inner_wall_force"),
    "packing": ("pile_height", "packing_fraction"),
    "coordination": ("coordination_number", "rattlers"),
    "stress": ("pressure", "stress_xx", "stress_xy", "stress_yy"),
    "kinetic": ("kinetic_stress_xx", "kinetic_stress_xy", "kinetic_stress_yy"),
    "force": ("mean_force", "largest_force", "force_deviation"),
    "friction": ("friction_power", "wall_power", "stress_antisymmetric"),
    "grains": ("grain_count", "grain_mass"),
    "flow": ("inflow_count", "outflow_count", "outflow_mass"),
    "speed": ("mean_speed", "largest_speed", "granular_temperature"),
}
"""Names of groups of quantities."""

SWEEP_QUANTITIES = {name: found.of_runs for name, found in QUANTITIES.items() if found.of_runs is not None}
"""Quantities that are columns of every sweep's results: functions that return those of m scenes, by name."""

_TAKE_REGION = {name for name, one in QUANTITIES.items() if "region" in signature(one.function).parameters}


def find(name: str) -> Quantity:
    """Return the quantity of a name, such as "kinetic_energy" or "force_x:top"; InputError if it is unknown.

    Examples
    --------
    >>> analysis.find("force_x:top").unit
    'N'
    """
    kind, colon, wall = name.partition(":")
    if colon and wall and kind + colon in OF_WALLS:
        one = QUANTITIES[f"{kind}:WALL"]
        return one._replace(part=partial(one.part, wall=wall))
    return QUANTITIES[checks.one_of("quantity", name, [*GROUPS, *QUANTITIES])]


def names_of(wanted: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of quantities that names of quantities and groups denote, each once, in order.

    A single text may hold several names, separated by commas.
    """
    found: dict[str, None] = {}
    for given in wanted.split(",") if isinstance(wanted, str) else wanted:
        name = checks.text("quantity", given).strip()
        if name not in GROUPS:
            find(name)
        found |= dict.fromkeys(GROUPS.get(name, (name,)))
    return tuple(found)


def require_quantities(names: Iterable[str], scene: Scene, region: Mapping[str, Any] | None = None) -> None:
    """Raise InputError if a scene cannot have one of these quantities, or the region, at its start.

    For a region below the surface of a pile, which is not known yet, the surface is taken at the height
    `Scene.reach`.
    """
    if region is not None:
        to_surface = {"below": scene.reach} if region.get("below") == "surface" else {}
        region_of(snapshot(scene, first_state(scene)), {**region, **to_surface})
    for name in names:
        if region is None or name not in _TAKE_REGION:
            find(name).require(name, scene)


def _possible(scene: Scene, region: Where) -> Iterator[str]:
    """Yield the names of the quantities that a scene can have, except quantities of single walls."""
    for name, one in QUANTITIES.items():
        if name.endswith(":WALL"):
            continue
        try:
            if region is None or name not in _TAKE_REGION:
                one.require(name, scene)
        except InputError:
            continue
        yield name


def takes_region(names: Iterable[str]) -> bool:
    """Return whether one of these quantities takes a region."""
    return not _TAKE_REGION.isdisjoint(names)


def quantities(
    of: Snapshot | HasState, names: str | Iterable[str] | None = None, region: Where = None
) -> dict[str, float]:
    """Return quantities by name, in the units of `QUANTITIES`.

    Parameters
    ----------
    names : str or iterable of str, optional
        Names of quantities, or of `GROUPS`, as of `Series`. By default all quantities that the scene can
        have, except those of single walls.
    region : mapping, optional
        Region of packing fraction, coordination number, stresses and forces between grains, see `region_of`.
        Other quantities are those of all grains.

    Returns
    -------
    dict
        Values by name; NaN if the area that a quantity needs is unknown or 0, see `NoAreaError`.

    Raises
    ------
    InputError
        A name is unknown, the scene cannot have a quantity, or the region is invalid.

    Examples
    --------
    >>> analysis.quantities(simulation, ["rattlers", "packing_fraction"])["rattlers"]
    3.0
    """
    now = snapshot(of)
    wanted = _possible(now.scene, region) if names is None else names_of(names)
    found: dict[Callable[..., Any], Any] = {}
    values = {}
    for name in wanted:
        one = find(name)
        if ":" in name:
            one.require(name, now.scene)
        try:
            if one.function not in found:
                where = {"region": region} if name in _TAKE_REGION else {}
                found[one.function] = one.function(now, **where)
            values[name] = one.part(found[one.function])
        except NoAreaError:
            values[name] = np.nan
    return values
