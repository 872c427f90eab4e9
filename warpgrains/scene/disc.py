"""A fixed disc inside the annulus. This is the host's side; kernels/disc.py is the device's."""

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.scene import checks
from warpgrains.scene.geometry import distance
from warpgrains.scene.walls import Side


@dataclass(frozen=True)
class Disc:
    """A fixed disc that grains touch from outside.

    Parameters
    ----------
    center
        Center [m], two components.
    radius
        Radius [m].

    Raises
    ------
    InputError
        The center or the radius is invalid.

    Examples
    --------
    >>> disc = wg.Disc(center=(0.0, -1.0), radius=0.2)
    >>> grain = {"position": [[0.3, 0.0]], "radius": 0.1, "mass": 0.1}
    >>> wg.Scene(**grain, radius_out=2.0, walls=[disc]).walls
    (Disc(center=(0.0, -1.0), radius=0.2),)
    """

    kind: ClassVar[str] = "disc"
    kind_number: ClassVar[int] = 1
    center: tuple[float, float]
    radius: float

    def __post_init__(self) -> None:
        vars(self)["center"] = checks.vector("center of a disc", self.center)
        vars(self)["radius"] = checks.positive("radius of a disc", self.radius)

    @property
    def table(self) -> dict[str, Any]:
        """Keys and values of the disc in a `[[walls]]` table of a scene file."""
        return {"kind": self.kind, **asdict(self)}

    @property
    def area(self) -> float:
        """Area of the disc [m2]."""
        return float(np.pi) * self.radius**2

    @property
    def numbers(self) -> tuple[float, ...]:
        """Numbers that the kernels need: center and radius (kernels/disc.py)."""
        return (*self.center, self.radius)

    def ring(self, thickness: float) -> tuple[float, float, tuple[float, float]]:
        """Return the inner radius, outer radius and center [m] of the ring that pictures show."""
        return max(self.radius - thickness, self.radius / 2), self.radius, self.center

    def side(self, position: FloatArray, radius: FloatArray) -> Side:
        """Return normals and gaps of grains at the disc, see `Scene.side`."""
        away = np.array(self.center) - position
        rho = distance(away)
        with np.errstate(invalid="ignore"):
            return Side(away / rho[:, np.newaxis], rho - (radius + self.radius))
