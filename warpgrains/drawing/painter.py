"""Contents of pictures of a scene, which every program that draws it shows."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, reduce
from math import hypot
from typing import TYPE_CHECKING

from warpgrains.arrays import FloatArray
from warpgrains.drawing.chains import Chains, ChainScale, chains_of
from warpgrains.drawing.colors import ColorScale, GrainColors
from warpgrains.drawing.shapes import drawn_walls
from warpgrains.drawing.views import view_of
from warpgrains.scene.band import Band
from warpgrains.scene.box import Box
from warpgrains.scene.extent import box_of_discs

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.snapshot import Snapshot


class Painter:
    """Colors and force chains of the snapshots of a scene, and the rectangle to show.

    `largest` is the force of a chain of full width [N], by default estimated from the scene. Divided by the
    diameter of a mean grain, it is the pressure of the last color. `frame` is the rectangle to show, by
    default the extent of the scene.
    """

    def __init__(
        self,
        scene: Scene,
        color_by: str,
        forces: bool,
        largest: float | None = None,
        frame: str | None = None,
    ) -> None:
        self.scene, self.colors = scene, GrainColors(scene, color_by)
        self.chain_scale = ChainScale.of(scene) if forces else None
        if largest is not None:
            self.chain_scale = self.chain_scale and replace(self.chain_scale, force=largest)
            if color_by == "pressure":
                self.colors.scale = ColorScale(color_by, 0.0, largest / (2.0 * float(scene.radius.mean())))
        self.view, self._is_framed = view_of(scene, frame), frame is not None

    @property
    def needs_contacts(self) -> bool:
        return self.chain_scale is not None or self.colors.needs_contacts

    @cached_property
    def walls(self) -> dict[str, Band]:
        """The walls as drawn, by name."""
        return drawn_walls(self.scene)

    @property
    def has_free_corners(self) -> bool:
        """Whether nothing is drawn in the corners, because they are outside of the outer wall."""
        return hypot(*self.view[:2]) > 1.3 * self.walls["Outer"].reach

    def color(self, now: Snapshot) -> FloatArray:
        """Return the colors of the grains (sRGB), shape (n, 3)."""
        return self.colors.of(now)

    def chains(self, now: Snapshot) -> Chains | None:
        return None if self.chain_scale is None else chains_of(self.chain_scale, now)

    def show_all(self, *snapshots: Snapshot) -> None:
        """Widen the rectangle to contain all grains of snapshots, unless it was given."""
        if not self._is_framed:
            boxes = [box_of_discs(now.position, now.scene.radius) for now in snapshots]
            self.view = reduce(Box.covering, boxes, self.view)
