"""Grains and contacts of snapshots as columns, for frames of pandas and datasets of xarray."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from warpgrains.analysis.snapshot import Snapshot

TABLES = ("grains", "contacts", "wall_contacts")
UNITS = {"position": "m", "velocity": "m/s", "radius": "m", "mass": "kg", "spin": "rad/s", "angle": "rad"}


def columns_of(now: Snapshot, table: str) -> dict[str, Any]:
    """Return a table of a snapshot as columns by name."""
    m = len(now.pair)
    if table == "grains":
        (x, y), (vx, vy) = now.position.T, now.velocity.T
        columns = {"x": x, "y": y, "vx": vx, "vy": vy, "radius": now.scene.radius, "mass": now.scene.mass}
        return columns | {"spin": now.spin, "angle": now.angle}
    if table == "contacts":
        names, ends, normal = ("i", "j"), now.pair, now.normal
        force, tangential = now.force, now.tangential_force
    else:
        names, ends, normal = ("grain", "wall"), now.wall, now.loads.normal[2 * m :]
        force, tangential = now.wall_force, now.wall_tangential_force
    columns = dict(zip((*names, "normal_x", "normal_y"), (*ends.T, *normal.T), strict=True))
    return {**columns, "force": force, "tangential_force": tangential}


def contact_arrays(now: Snapshot) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return normals, forces and tangential forces of contacts, those with walls after those of pairs."""
    return (
        np.concatenate([now.normal, now.loads.normal[2 * len(now.pair) :]]),
        np.concatenate([now.force, now.wall_force]),
        np.concatenate([now.tangential_force, now.wall_tangential_force]),
    )


def contact_variables(
    pair: IntArray, normal: FloatArray, force: FloatArray, tangential: FloatArray | None
) -> dict[str, Any]:
    """Return contacts as variables of a dataset along the dimension `contact`, see `Recording.to_xarray`."""
    found: dict[str, Any] = {
        "contact_grain": ("contact", pair[:, 0]),
        "contact_other": ("contact", pair[:, 1]),
        "contact_normal": (("contact", "component"), normal),
        "contact_force": ("contact", force, {"units": "N"}),
    }
    if tangential is not None:
        found["contact_tangential_force"] = ("contact", tangential, {"units": "N"})
    return found


def grain_variables(arrays: Mapping[str, FloatArray]) -> dict[str, Any]:
    """Return arrays of grains, at one time or along a first axis of times, as variables of a dataset."""
    variables: dict[str, Any] = {}
    for name, array in arrays.items():
        dims = ("grain", "component") if name in ("position", "velocity") else ("grain",)
        times = ("time",) * (array.ndim - len(dims))
        variables[name] = ((*times, *dims), array, {"units": UNITS[name]})
    return variables


def dataset_variables(now: Snapshot, pair: IntArray) -> dict[str, Any]:
    """Return grains and contacts of a snapshot as variables of a dataset."""
    grains = {"position": now.position, "velocity": now.velocity}
    grains |= {"radius": now.scene.radius, "mass": now.scene.mass}
    if now.scene.has_friction:
        grains |= {"spin": now.spin, "angle": now.angle}
    normal, force, tangential = contact_arrays(now)
    shown = tangential if now.scene.has_friction else None
    return grain_variables(grains) | contact_variables(pair, normal, force, shown)
