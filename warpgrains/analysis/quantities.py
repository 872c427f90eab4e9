"""Named scalar quantities of a state, for the series of a run and the tables of sweeps."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from inspect import signature
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from warpgrains.analysis import contacts, energy, forces, network, packing, region_table
from warpgrains.analysis.energy import EnergyBalance, step_energy_balance
from warpgrains.analysis.region_table import Where
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.analysis.walls import wall_forces, wall_places
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError, NoAreaError
from warpgrains.scene.scene import Scene
from warpgrains.scene.snapshot import Snapshot
from warpgrains.scene.state import first_state


class Quantity(NamedTuple):
    """A scalar quantity of a snapshot: one element of the result of a function.

    Quantities of the same function share one call.
    """

    unit: str
    """Unit; empty for a dimensionless number."""
    meaning: str
    function: Callable[..., Any]
    """Function of a snapshot and, if it has a parameter `region`, of a region. It raises InputError if the
    scene cannot have the quantity."""
    part: Callable[[Any], Any] = float
    """Function that returns the quantity from the result of `function`."""


def _stress(function: Callable[..., Any], a: int, b: int, meaning: str) -> Quantity:
    """Return the symmetric part (sigma_ab + sigma_ba) / 2 of a stress as a quantity."""
    return Quantity("N/m", meaning, function, lambda found: 0.5 * (found[a, b] + found[b, a]))


_MEAN = "component of the mean stress of contacts and kinetic, compression positive"
_KINETIC = "part of the stress that grains carry about their mean velocity"
_kinetic = partial(contacts.mean_stress, part="kinetic")


def _powers(now: Snapshot) -> EnergyBalance:
    """Return the energy balance of the last step, divided by the duration of the step [W]."""
    return EnergyBalance(*(energy / now.scene.dt for energy in step_energy_balance(now)))


def _power(part: str, meaning: str) -> Quantity:
    return Quantity("W", meaning, _powers, attrgetter(part))


def _force(part: str, meaning: str) -> Quantity:
    return Quantity("N", f"{meaning} between grains", forces.force_statistics, attrgetter(part))


def _speeds(now: Snapshot) -> FloatArray:
    return np.hypot(*now.velocity.T)


def _masses(now: Snapshot, region: Where = None) -> FloatArray:
    """Return the masses of the grains with centers in a region, or of all grains [kg]."""
    return now.scene.mass if region is None else now.scene.mass[region_table.grains_in(now, region)]


def _flow(table: str, column: int, unit: str, meaning: str) -> Quantity:
    def function(now: Snapshot) -> float:
        if not now.scene.exchanges_grains:
            raise InputError("the scene has no sources or sinks")
        rows = getattr(now, table)
        return np.nan if rows is None else float(rows[:, column].sum())

    return Quantity(unit, meaning, function)


QUANTITIES = {
    "kinetic_energy": Quantity(
        "J", "sum of m v^2 / 2, and with friction of I w^2 / 2", energy.kinetic_energy
    ),
    "potential_energy": Quantity("J", "sum of -m g . x, 0 at the origin", energy.potential_energy),
    "contact_power": _power("contact_loss", "power that contacts dissipate, in the last step"),
    "drag_power": _power("drag_loss", "power that drag dissipates, in the last step"),
    "friction_power": _power("friction_loss", "part of `contact_power` due to friction"),
    "wall_power": _power("wall_work", "power of walls that rotate or move, in the last step"),
    "packing_fraction": Quantity(
        "", "fraction of the container, or of the region, that grains fill", packing.packing_fraction
    ),
    "pile_packing_fraction": Quantity(
        "",
        "fraction that grains fill of the container below their mean height",
        packing.pile_packing_fraction,
    ),
    "pile_height": Quantity(
        "m", "highest point of a grain above the lowest point of the container", packing.pile_height
    ),
    "coordination_number": Quantity(
        "", "mean number of contacts of a grain, walls included", network.coordination_number
    ),
    "rattlers": Quantity(
        "",
        "number of grains that their contacts do not hold",
        network.rattlers,
        np.count_nonzero,
    ),
    "pressure": Quantity(
        "N/m", "half the trace of the mean stress, of contacts and kinetic", contacts.pressure
    ),
    "stress_xx": _stress(contacts.mean_stress, 0, 0, _MEAN),
    "stress_xy": _stress(contacts.mean_stress, 0, 1, _MEAN),
    "stress_yy": _stress(contacts.mean_stress, 1, 1, _MEAN),
    "stress_antisymmetric": Quantity(
        "N/m",
        "antisymmetric part, (xy - yx) / 2, of the mean stress",
        contacts.mean_stress,
        lambda found: 0.5 * (found[0, 1] - found[1, 0]),
    ),
    "kinetic_stress_xx": _stress(_kinetic, 0, 0, _KINETIC),
    "kinetic_stress_xy": _stress(_kinetic, 0, 1, _KINETIC),
    "kinetic_stress_yy": _stress(_kinetic, 1, 1, _KINETIC),
    "mean_force": _force("mean", "mean of the forces"),
    "largest_force": _force("largest", "largest force"),
    "force_deviation": _force("deviation", "standard deviation of the forces"),
    "grain_count": Quantity("", "number of grains in the region, or of all", _masses, len),
    "grain_mass": Quantity("kg", "mass of these grains", _masses, np.sum),
    "inflow_count": _flow("inflow", 1, "", "number of grains that sources have added so far"),
    "outflow_count": _flow("outflow", 0, "", "number of grains that sinks have taken so far"),
    "outflow_mass": _flow("outflow", 1, "kg", "mass of these grains"),
    "mean_speed": Quantity("m/s", "mean speed of the grains", _speeds, np.mean),
    "largest_speed": Quantity("m/s", "speed of the fastest grain", _speeds, np.max),
    "granular_temperature": Quantity(
        "m2/s2", "mean square of a component of v - <v>", energy.granular_temperature
    ),
}
"""Quantities by name, except those of a wall; powers and forces are those of the last step."""

OF_WALLS = {
    "force_x": Quantity("N", "force of the grains on a wall along x", wall_forces, lambda own: own.force[0]),
    "force_y": Quantity("N", "force of the grains on a wall along y", wall_forces, lambda own: own.force[1]),
    "normal_force": Quantity(
        "N", "sum of the normal forces of the grains on a wall", wall_forces, attrgetter("normal")
    ),
    "torque": Quantity(
        "N m",
        "torque of the grains on a wall about its pivot or the origin",
        wall_forces,
        attrgetter("torque"),
    ),
    "position_x": Quantity("m", "place of a wall along x", wall_places, lambda own: own[0]),
    "position_y": Quantity("m", "place of a wall along y", wall_places, lambda own: own[1]),
}
"""Quantities of a wall, whose name follows a colon, such as "force_x:top"."""

GROUPS = {
    "energy": ("kinetic_energy", "potential_energy", "contact_power", "drag_power"),
    "packing": ("packing_fraction",),
    "pile": ("pile_packing_fraction", "pile_height"),
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

_TAKE_REGION = {name for name, one in QUANTITIES.items() if "region" in signature(one.function).parameters}


def find(name: str) -> Quantity:
    """Return the quantity of a name, such as "kinetic_energy" or "force_x:top"; InputError if it is unknown.

    Examples
    --------
    >>> analysis.find("force_x:top").unit
    'N'
    """
    kind, _, wall = name.partition(":")
    if wall and kind in OF_WALLS:
        one = OF_WALLS[kind]
        return one._replace(part=lambda found: one.part(_of_wall(found, wall)))
    known = [*GROUPS, *QUANTITIES, *(f"{kind}:WALL" for kind in OF_WALLS)]
    return QUANTITIES[checks.one_of("quantity", name, known)]


def _of_wall(found: Mapping[str, Any], wall: str) -> Any:
    if wall not in found:
        raise InputError(f"the scene has no wall {wall!r}; it has {', '.join(found) or 'none'}")
    return found[wall]


def names_of(wanted: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of quantities that names of quantities and groups denote, each once, in order.

    A single text may hold several names, separated by commas.
    """
    found: dict[str, None] = {}
    for name in map(str.strip, wanted.split(",") if isinstance(wanted, str) else wanted):
        if name not in GROUPS:
            find(name)
        found |= dict.fromkeys(GROUPS.get(name, (name,)))
    return tuple(found)


def require_effect(region: Any, names: Iterable[str]) -> None:
    """Raise InputError if a region is given, not None, and none of these quantities takes a region."""
    if region is not None and _TAKE_REGION.isdisjoint(names):
        raise InputError(f"region has no effect on {', '.join(names)}")


def require_quantities(names: Iterable[str], scene: Scene, region: Mapping[str, Any] | None = None) -> None:
    """Raise InputError if a scene cannot have one of these quantities, or the region, at its start.

    For a region below the surface of a pile, which is not known yet, the surface is taken at the height
    `Scene.reach`.
    """
    now = snapshot(scene, first_state(scene))
    if region is not None:
        region = {**region, "below": scene.reach} if region.get("below") == "surface" else region
        region_table.region_of(now, region)
    for _, value in _measured(now, names, region):
        if isinstance(value, InputError):
            raise value


def _measured(now: Snapshot, names: Iterable[str], region: Where) -> Iterator[tuple[str, float | InputError]]:
    """Yield names of quantities with their values, or with the errors of those that cannot be measured."""
    found: dict[Callable[..., Any], Any] = {}
    for name in names:
        one = find(name)
        try:
            if one.function not in found:
                where = {"region": region} if name in _TAKE_REGION else {}
                found[one.function] = one.function(now, **where)
            yield name, float(one.part(found[one.function]))
        except InputError as error:
            yield name, type(error)(f"{name}: {error}")


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
    >>> analysis.quantities(simulation, ["rattlers", "pile_packing_fraction"])["rattlers"]
    3.0
    """
    values = {}
    for name, value in _measured(snapshot(of), QUANTITIES if names is None else names_of(names), region):
        if not isinstance(value, InputError):
            values[name] = value
        elif names is not None:
            if not isinstance(value, NoAreaError):
                raise value
            values[name] = np.nan
    return values
