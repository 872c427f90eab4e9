"""The table of quantities: numbers of a state, each with a name, a unit, a meaning and a function."""

from collections.abc import Callable
from functools import lru_cache, partial
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from warpgrains.analysis import contacts, energy, forces, network, packing, profiles, region_table
from warpgrains.analysis.energy import EnergyBalance, step_energy_balance
from warpgrains.analysis.profiles import Profile
from warpgrains.analysis.region_table import Where
from warpgrains.analysis.walls import wall_forces, wall_places
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.scene.snapshot import Snapshot


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
    weight: str = ""
    """Name of the quantity by which means over time are weighted; empty for plain means."""


def _stress(function: Callable[..., Any], a: int, b: int, meaning: str) -> Quantity:
    """Return the quantity (sigma_ab + sigma_ba) / 2 of the stress, shape (2, 2), that `function` returns."""
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
"""Quantities of a wall. In "force_x:top", the name of the wall follows after the name of the quantity."""

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
"""Names of the quantities in each group, by the name of the group."""

_COLUMNS: dict[str, tuple[str, Callable[[Profile], FloatArray]]] = {
    "low": ("m", lambda own: own.edges[:-1]),
    "high": ("m", lambda own: own.edges[1:]),
    "packing_fraction": ("", attrgetter("packing_fraction")),
    "velocity_along": ("m/s", lambda own: own.velocity[:, 0]),
    "velocity_left": ("m/s", lambda own: own.velocity[:, 1]),
    "spin": ("rad/s", attrgetter("spin")),
    "temperature": ("m2/s2", attrgetter("temperature")),
    "stress_along": ("N/m", lambda own: own.stress[:, 0, 0]),
    "stress_left": ("N/m", lambda own: own.stress[:, 1, 1]),
    "stress_along_left": ("N/m", lambda own: own.stress[:, 0, 1]),
    "stress_left_along": ("N/m", lambda own: own.stress[:, 1, 0]),
}
"""Quantities of a slice by name: the unit, and a function of a `Profile` that returns one value per slice."""
PROFILES = {"height_profile": profiles.height_profile, "radial_profile": profiles.radial_profile}
OF_GRAINS = {"velocity_along", "velocity_left", "spin", "temperature"}
"""Names in `_COLUMNS` of the quantities that are NaN in slices without grains."""


@lru_cache(64)
def of_slices(profile: str, bins: int) -> dict[str, Quantity]:
    """Return the quantities of all slices of a profile with `bins` slices, by name.

    `profile` is one of `PROFILES`. "height_profile:20:spin:0" is the spin in the first of 20 slices.
    """
    function = partial(PROFILES[profile], bins=bins)

    def own(column: str, k: int) -> Quantity:
        unit, values = _COLUMNS[column]
        weight = f"{profile}:{bins}:packing_fraction:{k}" if column in OF_GRAINS else ""
        return Quantity(unit, "", function, lambda found: values(found)[k], weight)

    return {f"{profile}:{bins}:{column}:{k}": own(column, k) for column in _COLUMNS for k in range(bins)}
