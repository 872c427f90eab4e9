"""Force chains: one band per contact, whose width is proportional to the force."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.arrays import BoolArray, FloatArray, IntArray
from warpgrains.drawing.colorings import pressure_scale
from warpgrains.scene.geometry import left_of, pair_normals
from warpgrains.scene.snapshot import Snapshot

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

CHAIN_COLOR = (0.78, 0.10, 0.12)
"""Color of force chains (sRGB), distinct from the colors of all scales."""


@dataclass(frozen=True)
class Chains:
    ends: FloatArray
    """Both ends of each segment [m], shape (m, 2, 2)."""
    width: FloatArray
    """Width of each segment [m], shape (m,): proportional to the force, at most the smallest radius."""
    force: FloatArray
    """Normal force of each contact [N], shape (m,)."""
    tangential_force: FloatArray
    """Tangential force of each contact [N], shape (m,), see `PairContacts`; 0 without friction."""
    pair: IntArray
    """Grains i < j of each segment, shape (m, 2); j is -1 for the outer wall, -2 for the inner one, and -3,
    -4, ... for those of `Scene.walls`."""

    def corners(self) -> FloatArray:
        """Return the corners of each band [m], counter-clockwise, shape (m, 4, 2)."""
        start, end = self.ends[:, 0], self.ends[:, 1]
        along = end - start
        length = np.hypot(*along.T)[:, np.newaxis]
        across = left_of(along) / np.where(length > 0.0, length, 1.0)
        side = 0.5 * self.width[:, np.newaxis] * across
        return np.stack([start - side, end - side, end + side, start + side], axis=1)


@dataclass(frozen=True)
class ChainScale:
    """Linear scale from forces to widths of bands."""

    force: float
    """Force with the full width [N]; larger forces have it too."""
    width: float
    """Full width [m], the smallest radius, so that grains stay visible."""

    @classmethod
    def of(cls, scene: Scene) -> ChainScale:
        """Return the scale of a scene: a large pressure in it times the diameter of a mean grain."""
        return cls(pressure_scale(scene) * 2.0 * float(scene.radius.mean()), float(scene.radius.min()))

    def described(self) -> dict[str, str | float]:
        """Return the scale as a recording stores it: the force [N] and its width [m]."""
        return {"unit": "N", "force": self.force, "width": self.width}

    @classmethod
    def read(cls, described: Mapping[str, Any]) -> ChainScale:
        return cls(described["force"], described["width"])


def chains_of(scale: ChainScale, now: Snapshot) -> Chains:
    """Return a band from center to center or wall for each contact, in the direction of its force."""
    pair = with_walls(now.pair, now.wall)
    force = np.concatenate([now.force, now.wall_force])
    tangential = np.concatenate([now.tangential_force, now.wall_tangential_force])
    normal = contact_normals(now, pair)
    ends = contact_ends(now, pair, normal)
    if now.scene.has_friction:
        ends = _turned(now.scene.radius[pair[:, 0]], normal, ends, np.stack([force, tangential], axis=1))
    total = np.hypot(force, tangential)
    return Chains(ends, np.minimum(total / scale.force, 1.0) * scale.width, force, tangential, pair)


def _turned(radius: FloatArray, normal: FloatArray, ends: FloatArray, force: FloatArray) -> FloatArray:
    """Return segments turned about contact points into forces (normal > 0, tangential) [N], (m, 2, 2)."""
    radius = radius[:, np.newaxis]
    size = np.maximum(np.hypot(*force.T), np.finfo(np.float64).tiny)[:, np.newaxis]
    along, across = (force / size).T[:, :, np.newaxis]
    direction = along * normal + across * left_of(normal)
    contact = ends[:, 0] + radius * normal
    beyond = ((ends[:, 1] - contact) * normal).sum(axis=1, keepdims=True)
    return np.stack([contact - radius * direction, contact + beyond * direction], axis=1)


def with_walls(pair: IntArray, wall: IntArray) -> IntArray:
    """Return contacts in the form of `Chains.pair`: pairs first, then walls."""
    at_wall = np.stack([wall[:, 0], -1 - wall[:, 1]], axis=1)
    return np.concatenate([pair, at_wall]).astype(np.int32)


def pairs_and_walls(pair: IntArray) -> tuple[BoolArray, IntArray, IntArray]:
    """Return which contacts of `Chains.pair` are pairs, these, and the others as grain and wall, (m, 2)."""
    between = pair[:, 1] >= 0
    grain, code = pair[~between].T
    return between, pair[between], np.stack([grain, -1 - code], axis=1)


def contact_normals(now: Snapshot, pair: IntArray) -> FloatArray:
    """Return unit vectors from each grain to the other one or into its wall, shape (m, 2)."""
    between, pairs, wall = pairs_and_walls(pair)
    normal = np.zeros(pair.shape)
    normal[between] = pair_normals(now.position, *pairs.T)
    normal[~between], _ = now.scene.wall_frames(now.position, wall, time=now.time)
    return normal


def contact_ends(now: Snapshot, pair: IntArray, normal: FloatArray) -> FloatArray:
    """Return the ends of contacts [m], (m, 2, 2): a grain's center, and the other center or wall point."""
    (i, j), center = pair.T, now.position
    foot = center[i] + now.scene.radius[i, np.newaxis] * normal
    return np.stack([center[i], np.where(j[:, np.newaxis] >= 0, center[np.maximum(j, 0)], foot)], axis=1)
