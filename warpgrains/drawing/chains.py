"""Force chains: one band per contact, whose width is proportional to the force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray, FloatArray, IndexArray, IntArray
from warpgrains.drawing.colorings import pressure_scale
from warpgrains.space.geometry import Period, left_of

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.snapshot import Snapshot

CHAIN_COLOR = (0.78, 0.10, 0.12)
"""Color of force chains (sRGB), distinct from the colors of all scales."""


class ChainScale(NamedTuple):
    """Scale of force chains: the width of a band is proportional to the force, up to a largest width."""

    force: float
    """Force [N] from which on bands have the full width."""
    width: float
    """Full width of a band [m]: the smallest radius, so that grains stay visible."""

    @classmethod
    def of(cls, scene: Scene) -> ChainScale:
        """Return the scale of a scene.

        The full width is the smallest radius. The force with this width is `pressure_scale` times the mean
        diameter.
        """
        return cls(pressure_scale(scene) * 2.0 * float(scene.radius.mean()), float(scene.radius.min()))

    def described(self) -> dict[str, str | float]:
        """Return the scale as a recording stores it: the force [N] and its width [m]."""
        return {"unit": "N", **self._asdict()}

    @classmethod
    def read(cls, described: Mapping[str, Any]) -> ChainScale:
        """Return the scale that a recording stores. Raises InputError if it is damaged."""
        return cls(*(checks.positive(f"{name} of forces", described[name]) for name in cls._fields))


class Chains(NamedTuple):
    """Bands that show the contacts of a snapshot: m of them, first one for each contact of `all_contacts`.

    A band that leaves a periodic box is cut at the side. Its part beyond the side is moved into the box and
    is a further band at the end, see `cut`.
    """

    corners: FloatArray
    """Corners of each band [m], counter-clockwise, shape (m, 4, 2)."""
    width: FloatArray
    """Width of each band [m], shape (m,)."""
    contact: IndexArray
    """Contact that each band shows, as an index into `all_contacts`, shape (m,)."""


def chains_of(scale: ChainScale, now: Snapshot) -> Chains:
    """Return a band for each contact, from the center of a grain to the center of the other, or to the wall.

    With friction, a band is turned about the contact point into the direction of the total force. Bands are
    cut where they leave a periodic box.
    """
    pair, force, tangential = all_contacts(now)
    start, end, normal = contact_lines(now, pair)
    if now.scene.has_friction:
        start, end = _turned(now.scene.radius[pair[:, :1]], normal, (start, end), (force, tangential))
    start, end, contact = cut(now.scene.period, start, end)
    width = (np.minimum(np.hypot(force, tangential) / scale.force, 1.0) * scale.width)[contact]
    along = end - start
    length = np.hypot(*along.T)[:, np.newaxis]
    side = 0.5 * width[:, np.newaxis] * (left_of(along) / np.where(length > 0.0, length, 1.0))
    return Chains(np.stack([start - side, end - side, end + side, start + side], axis=1), width, contact)


def cut(cell: Period, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Cut lines from `start` to `end` [m] where they leave a periodic box, and move all pieces into it.

    Returns
    -------
    Starts and ends of the k pieces [m], shape (k, 2) each, and the index of the line from which each piece is
    cut, shape (k,). The pieces at the starts of all lines come first, in the order of the lines.
    """
    start, end, line = start.copy(), end.copy(), np.arange(len(start))
    for d in np.flatnonzero(cell.repeats).tolist():
        low, period = cell.low[d], cell.lengths[d]
        away = period * np.floor((start[:, d] - low) / period)
        start[:, d] -= away
        end[:, d] -= away
        cells = np.floor((end[:, d] - low) / period)
        leaves = np.flatnonzero(cells)
        side = low + period * (cells[leaves] > 0.0)
        share = (side - start[leaves, d]) / (end[leaves, d] - start[leaves, d])
        met = start[leaves] + share[:, np.newaxis] * (end - start)[leaves]
        back = np.zeros_like(met)
        back[:, d] = -period * cells[leaves]
        start, beyond = np.concatenate([start, met + back]), end[leaves] + back
        end[leaves] = met
        end, line = np.concatenate([end, beyond]), np.concatenate([line, line[leaves]])
    return start, end, line


def _turned(
    radius: FloatArray, normal: FloatArray, ends: tuple[FloatArray, ...], force: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray]:
    """Turn segments along contacts about the contact points, so that they point along the total force.

    `ends` holds their starts and ends [m], shape (m, 2) each, and `force` the normal and the tangential
    forces [N]. `radius` [m], shape (m, 1), and `normal` are those of the grain at which a segment starts.
    Returns the new starts and ends.
    """
    size = np.maximum(np.hypot(*force), np.finfo(np.float64).tiny)[:, np.newaxis]
    along, across = (part[:, np.newaxis] / size for part in force)
    direction = along * normal + across * left_of(normal)
    contact = ends[0] + radius * normal
    beyond = ((ends[1] - contact) * normal).sum(axis=1, keepdims=True)
    return contact - radius * direction, contact + beyond * direction


def all_contacts(now: Snapshot) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return partners and forces of all contacts, first those of two grains, then those with walls.

    Returns
    -------
    Partners (i, j), shape (m, 2): grains i < j, or grain i and j = -1 - k at wall k of `Scene.walls`. Then
    the normal and the tangential forces [N], shape (m,) each.
    """
    at_wall = np.stack([now.wall[:, 0], -1 - now.wall[:, 1]], axis=1)
    force = np.concatenate([now.force, now.wall_force])
    tangential = np.concatenate([now.tangential_force, now.wall_tangential_force])
    return np.concatenate([now.pair, at_wall]).astype(np.int32), force, tangential


def pairs_and_walls(pair: IntArray) -> tuple[BoolArray, IntArray, IntArray]:
    """Split contacts of `all_contacts` into pairs of grains and contacts with walls.

    Returns
    -------
    A mask of the contacts of two grains, shape (m,); these contacts (i, j), shape (p, 2); and those with
    walls as (grain, wall), shape (m - p, 2).
    """
    between = pair[:, 1] >= 0
    grain, code = pair[~between].T
    return between, pair[between], np.stack([grain, -1 - code], axis=1)


def contact_lines(now: Snapshot, pair: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the starts [m], ends [m] and unit normals of lines along contacts, shape (m, 2) each.

    `pair` holds the partners (i, j) as in `all_contacts`. A line starts at the center of grain i. It ends at
    the nearest image of the center of j, or where grain i touches the wall.
    """
    between, pairs, wall = pairs_and_walls(pair)
    normal, (i, j), center = np.zeros(pair.shape), pair.T, now.position
    normal[between], _ = now.scene.pair_frames(center, pairs)
    normal[~between], _ = now.scene.wall_frames(center, wall, time=now.time)
    foot = center[i] + now.scene.radius[i, np.newaxis] * normal
    other = center[np.maximum(j, 0)]
    other = center[i] + now.scene.period.nearest(other - center[i]) if now.scene.period else other
    return center[i], np.where(between[:, np.newaxis], other, foot), normal
