"""Forces on walls by name: sums over the contacts of each wall in the last step."""

from typing import NamedTuple

import numpy as np

from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import fields_in_help
from warpgrains.scene.snapshot import Snapshot


@fields_in_help
class WallForce(NamedTuple):
    """Force that grains exert on a wall.

    Examples
    --------
    >>> analysis.wall_forces(simulation)["Outer"]._fields
    ('force', 'torque', 'normal', 'contacts')
    """

    force: FloatArray
    """Force [N], shape (2,)."""
    torque: float
    """Torque, counterclockwise, about the pivot of a wall that turns, or else about the origin [N m]."""
    normal: float
    """Sum of the moduli of the normal forces [N]."""
    contacts: int
    """Number of contacts."""


def wall_forces(of: Snapshot | HasState) -> dict[str, WallForce]:
    """Return the forces of grains on walls by name, see `Scene.wall_names`.

    Walls that share a name, such as the segments of a polyline, or a side and its roughness, count as one
    wall. The forces of all walls on the grains, with gravity and drag, change the momentum of the grains.

    Examples
    --------
    >>> outer = analysis.wall_forces(simulation)["Outer"]
    >>> outer.force.round(3), round(outer.normal, 3), outer.contacts  # 15 grains of 0.1 kg
    (array([ -0.023, -13.562]), 14.154, 10)
    """
    now = snapshot(of)
    loads, names = now.wall_loads, now.scene.wall_names
    index = {name: k for k, name in enumerate(dict.fromkeys(names))}
    which = np.array([index[name] for name in names], np.int64)[loads.wall]
    pivot = np.zeros((len(index), 2))
    for name, wall in zip(names, now.start_scene.walls, strict=True):
        if wall.angular_velocity:
            pivot[index[name]] = wall.pose(now.start_time).place(np.array([wall.about]))[0]

    def sums(values: FloatArray) -> FloatArray:
        return np.bincount(which, values, len(index)).astype(np.float64)

    force = np.stack([sums(component) for component in loads.force.T], axis=1)
    moment = sums(loads.moment) - (pivot[:, 0] * force[:, 1] - pivot[:, 1] * force[:, 0])
    normal, contacts = sums(loads.normal_force), np.bincount(which, minlength=len(index))
    each = zip(force, moment.tolist(), normal.tolist(), contacts.tolist(), strict=True)
    return {name: WallForce(*own) for name, own in zip(index, each, strict=True)}


def wall_places(of: Snapshot | HasState) -> dict[str, FloatArray]:
    """Return present positions of walls by name [m], shape (2,) each.

    The position is the center of a wall, or the point of a line. If walls share a name, that of the first
    wall is returned.

    Examples
    --------
    >>> analysis.wall_places(simulation)["Outer"]
    array([0., 0.])
    """
    now, found = snapshot(of), dict[str, FloatArray]()
    for name, wall in zip(now.scene.wall_names, now.scene.walls, strict=True):
        if name not in found:
            found[name] = np.array(wall.at(now.time).circle[:2])
    return found
