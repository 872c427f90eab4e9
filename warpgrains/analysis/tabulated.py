"""Grains and contacts of snapshots as columns, for frames of pandas and datasets of xarray."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from warpgrains.analysis.snapshot import Snapshot

TABLES = ("grains", "contacts", "wall_contacts")
UNITS = {
    "time": "s",
    **dict.fromkeys(("x", "y", "radius"), "m"),
    **dict.fromkeys(("vx", "vy"), "m/s"),
    **dict.fromkeys(("force", "tangential_force"), "N"),
    "mass": "kg",
    "spin": "rad/s",
    "angle": "rad",
}


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
