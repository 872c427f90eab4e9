"""Contents of a picture of a scene, the same for every program that draws it."""

from __future__ import annotations

from functools import cached_property, reduce
from math import hypot
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.drawing.chains import Chains, ChainScale, chains_of
from warpgrains.drawing.colorings import speed_scale
from warpgrains.drawing.colors import GrainColors, is_dark
from warpgrains.drawing.extent import box_of_discs, extent_of
from warpgrains.drawing.kinds import color_of, frame_of
from warpgrains.drawing.looks import Look
from warpgrains.drawing.shapes import drawn_walls, moved_walls
from warpgrains.space.bounds import Bounds
from warpgrains.walls.band import Band

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.snapshot import Snapshot


_THICKNESS = 0.014  # of walls, in half of the longer side of the view
_HOT = np.array((0.87, 0.33, 0.04))  # color of the fastest grains of the palette (sRGB)
_HEAT = 0.7  # exponent of the speed; below 1, slow grains differ in color
_MARGIN = 0.04  # about the extent, in half of its longer side: walls are drawn outside of the grains' space


class Painter:
    """Contents of pictures of a scene in a look: colors of grains, force chains, walls, and the view.

    The view is the rectangle of the plane that a picture shows [m].
    """

    def __init__(self, scene: Scene, look: Look) -> None:
        self.scene, self.look = scene, look
        self.colors = GrainColors(scene, look.color_by, look.colors, look.range)
        is_heated = look.color_by == "palette" and look.colors is None
        self.top_speed = speed_scale(scene) if is_heated else 0.0
        """Speed of fully orange grains [m/s]; 0 if colors do not depend on the speed."""
        self.chain_scale = ChainScale.of(scene) if look.forces else None
        self.view = _view_of(scene) if look.frame is None else frame_of("frame", look.frame)
        self.thickness = _THICKNESS * self.view.half
        """Thickness of walls [m]."""

    @property
    def needs_contacts(self) -> bool:
        return self.chain_scale is not None or self.colors.needs_contacts

    @cached_property
    def walls(self) -> dict[str, Band]:
        """The walls as drawn, by name."""
        return drawn_walls(self.scene, self.thickness)

    def moved_walls(self, now: Scene, time: float) -> dict[str, Band]:
        """Return the mobile walls as drawn at a time [s], by name, see `shapes.moved_walls`."""
        return moved_walls(self.scene, now, time, self.thickness)

    @property
    def has_free_corners(self) -> bool:
        """True if the corners of the view are outside of the outer wall, so that nothing is drawn there."""
        return "Outer" in self.walls and hypot(*self.view[:2]) > 1.3 * self.walls["Outer"].reach

    @property
    def background(self) -> tuple[float, float, float]:
        """Color of the background (sRGB)."""
        return color_of("background", self.look.background)

    @property
    def ink(self) -> str:
        """Color of texts, which contrasts with the background."""
        return "white" if is_dark(np.array(self.background)) else "black"

    def color(self, now: Snapshot) -> FloatArray:
        """Return the colors of the grains (sRGB), shape (n, 3)."""
        return self.heated(self.colors.of(now), np.hypot(*now.velocity.T))

    def heated(self, color: FloatArray, speed: FloatArray) -> FloatArray:
        """Return the colors of grains at speeds [m/s] (sRGB), shape (n, 3), from their colors at rest.

        With the default palette, colors turn orange with speed. With other colors, the result is `color`.
        """
        if self.top_speed == 0.0:
            return color
        share = np.clip(speed / self.top_speed, 0.0, 1.0)[:, np.newaxis] ** _HEAT
        return (1.0 - share) * color + share * _HOT

    def chains(self, now: Snapshot) -> Chains | None:
        return None if self.chain_scale is None else chains_of(self.chain_scale, now)

    def show_all(self, *snapshots: Snapshot) -> None:
        """Widen the view to contain all grains of snapshots.

        A view that the look gives stays as it is. In periodic directions, it always shows one period.
        """
        if self.look.frame is None:
            period = self.scene.period
            boxes = [
                box_of_discs(period.wrapped(now.position), np.outer(now.scene.radius, ~period.repeats))
                for now in snapshots
            ]
            self.view = reduce(Bounds.covering, boxes, self.view)


def _view_of(scene: Scene) -> Bounds:
    """Return the rectangle about what grains can touch and, except at periodic sides, a margin [m]."""
    extent = extent_of(scene)
    return extent.grown(*(_MARGIN * extent.half * ~scene.period.repeats).tolist())
