"""What the eye gets from numbers: colors of grains, and the range of numbers they stand for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.drawing.colormaps import PALETTE, colormap
from warpgrains.scene import checks

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.forces import PairContacts, WallContacts

UNITS = {"radius": "m", "speed": "m/s", "pressure": "N/m"}
"""The quantities that grains are colored by."""
COLORMAPS = {"radius": "plasma", "speed": "viridis", "pressure": "cividis"}
COLORINGS = ("palette", *UNITS)
LEVELS = 64
"""Colors between the ends of a scale."""


@dataclass(frozen=True)
class Frame:
    """One moment of a run, as it is drawn."""

    position: FloatArray
    """[m], shape (n, 2)."""
    velocity: FloatArray
    """[m/s], shape (n, 2)."""
    contacts: PairContacts | None = None
    """Forces between grains; None, as those with walls, where nothing that is drawn needs them."""
    wall_contacts: WallContacts | None = None

    def forces(self) -> tuple[PairContacts, WallContacts]:
        """Return the contacts between grains and with the walls; ValueError where they are missing."""
        if self.contacts is None or self.wall_contacts is None:
            raise ValueError("a frame drawn with forces or pressure needs contacts and wall_contacts")
        return self.contacts, self.wall_contacts


@dataclass(frozen=True)
class ColorScale:
    """Which colors a quantity has: one colormap a quantity, in recordings, pictures, films and windows."""

    quantity: str
    """One of `UNITS`."""
    low: float
    """The value of the first color; all below it have it too."""
    high: float
    """The value of the last color; all beyond it have it too."""

    @property
    def label(self) -> str:
        """What to write beside it."""
        return f"{self.quantity} [{UNITS[self.quantity]}]"

    @property
    def colormap(self) -> str:
        """Name of its colormap."""
        return COLORMAPS[self.quantity]

    def described(self) -> dict[str, str | float]:
        """Return what a recording says of it."""
        unit = {"unit": UNITS[self.quantity], "colormap": self.colormap}
        return {"quantity": self.quantity, **unit, "low": self.low, "high": self.high}

    @classmethod
    def read(cls, described: Mapping[str, Any]) -> Self:
        """Return the scale that a recording describes."""
        return cls(described["quantity"], described["low"], described["high"])

    def levels(self, values: FloatArray) -> IndexArray:
        """Return which of the `colors` each value has, shape (n,)."""
        reach = self.high - self.low
        share = np.clip((values - self.low) / reach, 0.0, 1.0) if reach > 0.0 else np.zeros_like(values)
        return np.rint(share * (LEVELS - 1)).astype(np.int64)

    def colors(self) -> FloatArray:
        """Return its colors from low to high (sRGB), shape (64, 3)."""
        return colormap(self.colormap, np.linspace(0.0, 1.0, LEVELS))


class GrainColors:
    """Which of a few colors each grain has.

    Scales are fixed by the scene, so that a color means the same in every frame and after a restart:
    speed against `speed_scale`, pressure against `pressure_scale`, radius between smallest and largest.

    Parameters
    ----------
    scene : Scene
        What is drawn.
    color_by : str
        "speed", "pressure", "radius", or "palette": colors that mean nothing and tell neighbours apart.

    Attributes
    ----------
    scale : ColorScale or None
        What the colors stand for; None for the palette.
    colors : ndarray
        All there are (sRGB), shape (k, 3).
    still : ndarray or None
        Which of them each grain has in every frame, shape (n,); None if each frame has its own.

    Raises
    ------
    SceneError
        If `color_by` is none of these.
    """

    def __init__(self, scene: Scene, color_by: str) -> None:
        checks.one_of("color_by", color_by, COLORINGS)
        self._radius = radius = scene.radius
        self.scale: ColorScale | None = None
        self.still: IndexArray | None = None
        if color_by == "palette":
            self.still, self.colors = np.arange(len(radius)) % len(PALETTE), PALETTE
            return
        if color_by == "radius":
            self.scale = ColorScale(color_by, float(radius.min()), float(radius.max()))
            self.still = self.scale.levels(radius)
        else:
            largest = speed_scale(scene) if color_by == "speed" else pressure_scale(scene)
            self.scale = ColorScale(color_by, 0.0, largest)
        self.colors = self.scale.colors()

    def levels(self, frame: Frame) -> IndexArray:
        """Return which of the colors each grain has in a frame, shape (n,)."""
        if self.scale is None or self.still is not None:
            assert self.still is not None
            return self.still
        return self.scale.levels(quantity(self.scale.quantity, frame, self._radius))

    def of(self, frame: Frame) -> FloatArray:
        """Return the colors of a frame (sRGB), shape (n, 3)."""
        return self.colors[self.levels(frame)]


def quantity(name: str, frame: Frame, radius: FloatArray) -> FloatArray:
    """Return one of the quantities in `UNITS` of each grain, shape (n,)."""
    if name == "radius":
        return radius
    return np.hypot(*frame.velocity.T) if name == "speed" else pressure(frame, radius)


def pressure(frame: Frame, radius: FloatArray) -> FloatArray:
    """Return the sum of the forces on each grain over its circumference [N/m], shape (n,).

    It is the mean of the two principal stresses that the contacts exert on the disc.
    """
    contacts, wall_contacts = frame.forces()
    both = np.concatenate([contacts.pair[:, 0], contacts.pair[:, 1]])
    total = np.bincount(both, weights=np.tile(contacts.force, 2), minlength=len(radius))
    return (total + np.abs(wall_contacts.force)) / (2.0 * np.pi * radius)


def speed_scale(scene: Scene) -> float:
    """Return the speed [m/s] a grain can be expected to reach: falling across, or as thrown at the start."""
    thrown = float(np.hypot(*scene.velocity.T).max())
    gravity = float(np.hypot(*scene.gravity))
    falling = np.sqrt(2.0 * gravity * scene.walls.depth)
    if scene.drag > 0.0:
        falling = min(falling, gravity * float(scene.mass.max()) / scene.drag)
    return max(thrown, float(falling))


def pressure_scale(scene: Scene) -> float:
    """Return a large pressure [N/m]: all grains' weight resting on a quarter of the outer wall's width.

    Without gravity: a mean grain stopped within one step from the scene's speed, or else from its own
    radius a step.
    """
    weight = float(scene.mass.sum() * np.hypot(*scene.gravity))
    if weight > 0.0:
        return weight / (scene.walls.depth / 2.0)
    radius = float(scene.radius.mean())
    stopping = float(scene.mass.mean()) * (speed_scale(scene) or radius / scene.dt) / scene.dt
    return stopping / (2.0 * np.pi * radius)
