"""Quantities by name: finding them, and measuring several of a state at once."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from inspect import signature
from typing import Any

import numpy as np

from warpgrains.analysis.quantity_table import GROUPS, OF_WALLS, PROFILES, QUANTITIES, Quantity, of_slices
from warpgrains.analysis.region_table import Where, region_of
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.base import checks
from warpgrains.base.errors import InputError, NoAreaError
from warpgrains.scene.scene import Scene
from warpgrains.scene.snapshot import Snapshot
from warpgrains.scene.state import first_state


@lru_cache(4096)
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
    if (slices := _slices(name)) and name in slices:
        return slices[name]
    known = [*GROUPS, *QUANTITIES, *(f"{own}:WALL" for own in OF_WALLS), *(f"{own}:BINS" for own in PROFILES)]
    return QUANTITIES[checks.one_of("quantity", name, known)]


def _slices(name: str) -> dict[str, Quantity]:
    """Return the quantities of all slices of the profile with which a name begins, by name.

    "height_profile:20" has 20 slices. The result is {} if the name does not begin with a profile.
    """
    profile, _, rest = name.partition(":")
    bins = rest.partition(":")[0]
    return of_slices(profile, int(bins)) if profile in PROFILES and bins.isdecimal() and len(bins) < 4 else {}


def _of_wall(found: Mapping[str, Any], wall: str) -> Any:
    if wall not in found:
        raise InputError(f"the scene has no wall {wall!r}; it has {', '.join(found) or 'none'}")
    return found[wall]


def names_of(wanted: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of quantities, each once, with every name of a group replaced by those of its members.

    A single text may hold several names, separated by commas. "height_profile:20" is the group of all
    quantities of 20 slices. After a quantity follows its `Quantity.weight`, if it has one.
    """
    found: dict[str, None] = {}
    for given in wanted.split(",") if isinstance(wanted, str) else wanted:
        name = checks.text("quantity", given).strip()
        group = GROUPS.get(name) or (_slices(name) if name.count(":") == 1 else ())
        if not group:
            group = name, find(name).weight
        found |= dict.fromkeys(filter(None, group))
    return tuple(found)


@lru_cache
def _takes_region(function: Callable[..., Any]) -> bool:
    return "region" in signature(function).parameters


def require_effect(region: Any, names: Iterable[str]) -> None:
    """Raise InputError if a region is given, not None, and none of these quantities takes a region."""
    if region is not None and not any(_takes_region(find(name).function) for name in names):
        raise InputError(f"region has no effect on {', '.join(names)}")


def require_quantities(names: Sequence[str], scene: Scene, region: Mapping[str, Any] | None = None) -> None:
    """Raise InputError if a scene cannot have one of these quantities, or the region, at its start.

    For a region below the surface of a pile, which is not known yet, the surface is taken at the height
    `Scene.reach`.
    """
    if not names:
        return
    now = snapshot(scene, first_state(scene))
    if region is not None:
        region = {**region, "below": scene.reach} if region.get("below") == "surface" else region
        region_of(now, region)
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
                where = {"region": region} if _takes_region(one.function) else {}
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
