"""Colors of grains, and the ranges of values that they represent."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.drawing.colormaps import COLORS
from warpgrains.drawing.frames import Frame, mobilized, pressure
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.walls import INNER, OUTER

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

LEVELS = 64
"""Number of colors of a scale."""

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear red, green and blue (ITU-R BT.709)
_DARK = 0.18  # luminance of what looks half as bright as white
_CONTRAST = 0.4  # of a mark, in the color or its complement

# Okabe and Ito's colors, which color-blind readers tell apart too.
PALETTE: FloatArray = np.array(
    [
        (0.90, 0.62, 0.00),
        (0.34, 0.71, 0.91),
        (0.00, 0.62, 0.45),
        (0.94, 0.89, 0.26),
        (0.00, 0.45, 0.70),
        (0.84, 0.37, 0.00),
        (0.80, 0.47, 0.65),
    ]
)


class Quantity(NamedTuple):
    """A quantity by which grains are colored, which recordings also hold as numbers."""

    unit: str
    """Empty for a pure number."""
    colormap: str
    extends: str
    """Matplotlib's name of the ends of the scale that values may exceed."""
    ends: Callable[[Scene], tuple[float, float]]
    """Function that returns the values of the first and last color in a scene."""
    values: Callable[[Scene, Frame], FloatArray]
    """Function that returns the value of each grain in a frame, shape (n,)."""
    changes: bool = True
    """Whether frames differ in it."""
    needs_friction: bool = False
    """Whether only scenes with friction have it."""
    needs_contacts: bool = False
    """Whether it follows from the contacts of a frame."""


@dataclass(frozen=True)
class ColorScale:
    """Colors of a quantity, with the same colormap in recordings, pictures, films and windows."""

    quantity: str
    """One of `QUANTITIES`."""
    low: float
    """Value of the first color; smaller values have it too."""
    high: float
    """Value of the last color; larger values have it too."""

    @property
    def label(self) -> str:
        """Name and unit of the quantity; a pure number has none."""
        unit = QUANTITIES[self.quantity].unit
        return f"{self.quantity} [{unit}]" if unit else self.quantity

    def described(self) -> dict[str, str | float]:
        """Return the scale as a recording stores it."""
        unit, name, *_ = QUANTITIES[self.quantity]
        return {"quantity": self.quantity, "unit": unit, "colormap": name, "low": self.low, "high": self.high}

    @classmethod
    def read(cls, described: Mapping[str, Any]) -> Self:
        return cls(described["quantity"], described["low"], described["high"])

    def levels(self, values: FloatArray) -> IndexArray:
        """Return the index into `colors` of each value, shape (n,)."""
        reach = self.high - self.low
        share = np.clip((values - self.low) / reach, 0.0, 1.0) if reach > 0.0 else np.zeros_like(values)
        return np.rint(share * (LEVELS - 1)).astype(np.int64)

    def colors(self) -> FloatArray:
        """Colors from low to high (sRGB), shape (64, 3)."""
        return colormap(QUANTITIES[self.quantity].colormap, np.linspace(0.0, 1.0, LEVELS))


def quantities_of(scene: Scene, has_contacts: bool = True) -> dict[str, Quantity]:
    """Return the quantities that frames of a scene have, with or without contacts, by name."""
    return {
        name: own
        for name, own in QUANTITIES.items()
        if scene.has_friction >= own.needs_friction and has_contacts >= own.needs_contacts
    }


def colorings(scene: Scene) -> tuple[str, ...]:
    return "palette", *quantities_of(scene)


class GrainColors:
    """Colors of the grains of a scene by one of `QUANTITIES`, or the "palette" that distinguishes neighbors.

    Scales depend only on the scene, so that a color means the same in every frame and after a restart.
    `still` holds the index of the color of each grain, shape (n,), where it is constant. Raises InputError
    where `color_by` is unknown, or needs friction that the scene does not have.
    """

    def __init__(self, scene: Scene, color_by: str) -> None:
        quantity = QUANTITIES.get(color_by) if isinstance(color_by, str) else None
        if quantity is not None and quantity.needs_friction and not scene.has_friction:
            raise InputError(f"color_by is {color_by!r}: it needs a scene with friction")
        checks.one_of("color_by", color_by, colorings(scene))
        self._scene = scene
        self.needs_contacts = False
        self.scale: ColorScale | None = None
        self.still: IndexArray | None = None
        if quantity is None:
            self.still, self.colors = np.arange(scene.n) % len(PALETTE), PALETTE
            return
        self.needs_contacts = quantity.needs_contacts
        self.scale = ColorScale(color_by, *quantity.ends(scene))
        self.colors = self.scale.colors()
        if not quantity.changes:
            self.still = self.levels(Frame(scene.position, scene.velocity))

    def levels(self, frame: Frame) -> IndexArray:
        """Return the index of the color of each grain in a frame, shape (n,)."""
        if self.still is not None:
            return self.still
        assert self.scale is not None
        return self.scale.levels(QUANTITIES[self.scale.quantity].values(self._scene, frame))

    def of(self, frame: Frame) -> FloatArray:
        """Return the colors of the grains in a frame (sRGB), shape (n, 3)."""
        return self.colors[self.levels(frame)]


def speed_scale(scene: Scene) -> float:
    """Return a speed [m/s] of grains: at the start, by a fall across the domain, a force, or a wall."""
    thrown = float(np.hypot(*scene.velocity.T).max())
    gravity = float(np.hypot(*scene.gravity))
    falling = np.sqrt(2.0 * gravity * scene.annulus.depth)
    if scene.drag > 0.0:
        falling = min(falling, gravity * float(scene.mass.max()) / scene.drag)
    out, inside = (scene.surface_speed(wall) for wall in (OUTER, INNER))
    mass = float(scene.mass.sum())
    pressed = np.sqrt(2.0 * abs(scene.pressure or 0.0) * scene.area / mass)
    found = [thrown, float(falling), float(pressed), abs(out), abs(inside)]
    for wall in scene.walls:
        rim = wall.border.radius if wall.border is not None and scene.has_friction else 0.0
        found.append(wall.motion.largest_speed(wall.farthest(wall.motion.pivot) + rim))
        if wall.drive is not None:
            inverse_mass, force, *_ = wall.drive
            found.append(sqrt(2.0 * abs(force) * scene.annulus.diameter / (1.0 / inverse_mass + mass)))
    return max(found)


def spin_scale(scene: Scene) -> float:
    """Return the spin [rad/s] that many grains reach: rolling at half of `speed_scale`, or at the start."""
    return max(float(np.abs(scene.spin_at_start).max()), 0.5 * speed_scale(scene) / scene.typical_radius)


def pressure_scale(scene: Scene) -> float:
    """Return a large pressure [N/m]: the weight of all grains on a quarter of the outer diameter.

    It is at least four times the pressure on a driven wall. Without these, it is that on a mean grain that is
    stopped within one step from the scene's largest speed, or if that is zero, from a radius per step.
    """
    weight = float(scene.mass.sum() * np.hypot(*scene.gravity))
    driven = [abs(wall.drive[1]) / (2.0 * wall.circle[2]) for wall in scene.walls if wall.drive is not None]
    given = 4.0 * max([abs(scene.pressure or 0.0), *driven])
    if weight > 0.0 or given > 0.0:
        return max(given, weight / (scene.annulus.depth / 2.0))
    radius = float(scene.radius.mean())
    stopping = float(scene.mass.mean()) * (speed_scale(scene) or radius / scene.dt) / scene.dt
    return stopping / (2.0 * np.pi * radius)


QUANTITIES = {
    "radius": Quantity(
        "m",
        "plasma",
        "neither",
        lambda scene: (float(scene.radius.min()), float(scene.radius.max())),
        lambda scene, frame: scene.radius,
        changes=False,
    ),
    "speed": Quantity(
        "m/s",
        "viridis",
        "max",
        lambda scene: (0.0, speed_scale(scene)),
        lambda scene, frame: np.hypot(*frame.velocity.T),
    ),
    "pressure": Quantity(
        "N/m",
        "cividis",
        "max",
        lambda scene: (0.0, pressure_scale(scene)),
        lambda scene, frame: pressure(frame, scene.radius),
        needs_contacts=True,
    ),
    "spin": Quantity(
        "rad/s",
        "managua",
        "both",
        lambda scene: (-spin_scale(scene), spin_scale(scene)),
        lambda scene, frame: frame.rotation()[0],
        needs_friction=True,
    ),
    "mobilized": Quantity(
        "",
        "magma",
        "neither",
        lambda scene: (0.0, 1.0),
        lambda scene, frame: mobilized(scene, *frame.forces()),
        needs_friction=True,
        needs_contacts=True,
    ),
}
"""The quantities by name."""


def colormap(name: str, share: FloatArray) -> FloatArray:
    """Return the sRGB colors at shares of the range, shape (n,), as an array of shape (n, 3), in [0, 1]."""
    known = np.array([[channel / 255.0 for channel in bytes.fromhex(word)] for word in COLORS[name].split()])
    place = np.clip(share, 0.0, 1.0) * (len(known) - 1.0)
    return np.stack([np.interp(place, np.arange(len(known)), channel) for channel in known.T], axis=1)


def mark_color(color: FloatArray) -> FloatArray:
    """Return the colors (sRGB) of marks on grains of some colors (sRGB), shape (n, 3): darker, or lighter."""
    is_bright = linear(color) @ _LUMINANCE > _DARK
    return np.where(is_bright[..., np.newaxis], _CONTRAST * color, 1.0 - _CONTRAST * (1.0 - color))


def linear(encoded: FloatArray) -> NDArray[np.float32]:
    """Return the linear values of sRGB colors, as displayColor holds them."""
    values = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return values.astype(np.float32)


def encoded(linear: FloatArray) -> FloatArray:
    """Return the sRGB colors of linear values, as screens need them."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1.0 / 2.4) - 0.055)
