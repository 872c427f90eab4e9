"""A disc that stands fixed inside the annulus, as the host sees it (device: kernels/disc.py)."""

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
        Where it stands [m], two components.
    radius
        Its radius [m].

    Raises
    ------
    InputError
        One of them is not what it must be.

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
        """What a `[[walls]]` table says of it."""
        return {"kind": self.kind, **asdict(self)}

    @property
    def area(self) -> float:
        """Its area [m2]."""
        return float(np.pi) * self.radius**2

    @property
    def numbers(self) -> tuple[float, ...]:
        """What the device knows of it (kernels/disc.py)."""
        return (*self.center, self.radius)

    def ring(self, thickness: float) -> tuple[float, float, tuple[float, float]]:
        """Return inner radius, outer radius and center [m] of the ring that is drawn of it."""
        return max(self.radius - thickness, self.radius / 2), self.radius, self.center

    def side(self, position: FloatArray, radius: FloatArray) -> Side:
        """Return it as seen by grains, see `Scene.side`."""
        away = np.array(self.center) - position
        rho = distance(away)
        with np.errstate(invalid="ignore"):
            return Side(away / rho[:, np.newaxis], rho - (radius + self.radius))
