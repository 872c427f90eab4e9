"""What the eye gets from numbers: colors of grains, and the speeds and forces they are measured against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpgrains.arrays import FloatArray
from warpgrains.errors import SceneError
from warpgrains.scene.scene import Scene

if TYPE_CHECKING:
    from warpgrains.solver.forces import PairContacts, WallContacts

COLORINGS = ("palette", "radius", "speed", "pressure")


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


class GrainColors:
    """One color per grain: linear red, green and blue in [0, 1], as USD wants them.

    Scales are fixed by the scene, so that a color means the same in every frame and after a restart:
    speed against `speed_scale`, pressure against `pressure_scale`, radius between smallest and largest.

    Parameters
    ----------
    scene : Scene
        What is drawn.
    color_by : str
        "palette" (colors that tell neighbours apart), "radius", "speed" or "pressure".

    Attributes
    ----------
    still : ndarray or None
        The colors that no frame changes, shape (n, 3); None if each frame has its own.

    Raises
    ------
    SceneError
        If `color_by` is none of these.
    """

    def __init__(self, scene: Scene, color_by: str) -> None:
        if color_by not in COLORINGS:
            raise SceneError(f"color by '{color_by}' is unknown; choose {', '.join(COLORINGS)}")
        self._color_by = color_by
        self._radius = radius = scene.radius
        self.still: NDArray[np.float32] | None = None
        if color_by == "palette":
            self.still = _PALETTE[np.arange(len(radius)) % len(_PALETTE)]
        elif color_by == "radius":
            self.still = _on_scale(radius - radius.min(), float(np.ptp(radius)))
        elif color_by == "speed":
            self._largest = speed_scale(scene)
        else:
            self._largest = pressure_scale(scene)

    def of(self, frame: Frame) -> NDArray[np.float32]:
        """Return the colors of one frame, shape (n, 3), where they are not `still`."""
        if self._color_by == "speed":
            return _on_scale(np.hypot(*frame.velocity.T), self._largest)
        return _on_scale(pressure(frame, self._radius), self._largest)


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


def force_scale(scene: Scene) -> float:
    """Return a large contact force [N]: `pressure_scale` over the diameter of a mean grain."""
    return pressure_scale(scene) * 2.0 * float(scene.radius.mean())


def _linear(color: Any) -> NDArray[np.float32]:
    """Return the linear values of sRGB colors, which is what displayColor holds."""
    encoded = np.asarray(color)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


def _on_scale(value: FloatArray, largest: float) -> NDArray[np.float32]:
    """Return the color of each value between 0 and `largest`, which also stands for all beyond it."""
    share = np.clip(value / largest, 0.0, 1.0) if largest > 0.0 else np.zeros_like(value)
    return _SCALE[np.rint(share * (len(_SCALE) - 1)).astype(np.intp)]


# Okabe and Ito's colors, which color-blind readers tell apart too.
_PALETTE = _linear(
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

# Viridis: nine of its colors, from low to high, with 256 steps between them.
_VIRIDIS = np.array(
    [
        (0.27, 0.00, 0.33),
        (0.28, 0.18, 0.48),
        (0.23, 0.32, 0.55),
        (0.17, 0.45, 0.56),
        (0.13, 0.57, 0.55),
        (0.16, 0.68, 0.50),
        (0.37, 0.79, 0.38),
        (0.68, 0.86, 0.19),
        (0.99, 0.91, 0.14),
    ]
)
_STEPS = np.linspace(0.0, len(_VIRIDIS) - 1.0, 256)
_SCALE = _linear(
    np.stack([np.interp(_STEPS, np.arange(len(_VIRIDIS)), channel) for channel in _VIRIDIS.T], axis=1)
)
