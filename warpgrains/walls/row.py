"""Equal discs in an infinite row. This is the host's side; kernels/walls/row.py is the device's."""

from math import hypot
from typing import ClassVar

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import described
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import Side, left_of
from warpgrains.walls.band import Band
from warpgrains.walls.wall import InfiniteWall, Wall, kind_of_wall

_POINTS = 16  # number of points in each half of the drawing of a disc
MOST_SHOWN = 1e5  # largest number of discs of a row in pictures
_ROUNDED = 1e-9  # tolerance of places, in steps

Vector = tuple[float, float]


@kind_of_wall
class Row(InfiniteWall):
    """An infinite row of equal discs with equal spacing. A grain touches only the nearest disc of the row.

    A second row must have its discs in the middle between those of the first, so that no grain touches two
    discs of one row. If a line that a force drives has the same name, the row moves with the line. The key
    `roughness` of a side of a box makes such rows.

    Parameters
    ----------
    {fields}

    Raises
    ------
    InputError
        A value is invalid, or discs overlap.

    Examples
    --------
    >>> walls = [wg.Row(point=(x, -1.0), spacing=(0.2, 0.0), radius=0.05, length=4.0) for x in (0.0, 0.1)]
    >>> grain = {"position": [[0.0, 0.5]], "radius": 0.1, "mass": 0.1}
    >>> wg.Scene(**grain, radius_out=2.0, walls=walls).walls[1]
    Row(point=(0.1, -1.0), spacing=(0.2, 0.0), radius=0.05, length=4.0)
    """

    kind: ClassVar[str] = "row"
    kind_number: ClassVar[int] = 5
    takes_joints: ClassVar[bool] = False
    point: Vector = described("Center of one of the discs [m], two components.", check=checks.vector)
    spacing: Vector = described(
        "Way from a center to the next [m], two components, at least a diameter long.", check=checks.vector
    )
    radius: float = described("Radius of the discs [m].", check=checks.positive)
    length: float = described(
        "Length of the part about the point that pictures show [m].", check=checks.positive
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not hypot(*self.spacing) >= 2.0 * self.radius:
            raise InputError(
                f"spacing of a row is {self.spacing}: discs of radius {self.radius} m would overlap; it must"
                f" be at least {2.0 * self.radius} m long"
            )
        if self.length > MOST_SHOWN * hypot(*self.spacing):
            raise InputError(
                f"length of a row is {self.length} m: it must be at most {MOST_SHOWN:g} times"
                f" {hypot(*self.spacing)} m"
            )

    @property
    def numbers(self) -> tuple[float, ...]:
        return (*self.point, *self.spacing, self.radius)

    def side(self, position: FloatArray, radius: FloatArray) -> Side:
        (x, y), (dx, dy) = (position - self.point).T, self.spacing
        discs = np.rint((x * dx + y * dy) / (dx * dx + dy * dy))[:, np.newaxis]
        return Side.at(self.point + discs * self.spacing, position, radius + self.radius)

    def discs_about(self, middle: Vector) -> FloatArray:
        """Return the centers [m], shape (k, 2), of the discs that are within `length` / 2 of `middle`.

        Discs that reach partly into this range count.
        """
        point, step, half = np.array(self.point), np.array(self.spacing), 0.5 * self.length + self.radius
        way = float((point - middle) @ step) / hypot(*step)
        first, last = np.ceil((-half - way) / hypot(*step)), np.floor((half - way) / hypot(*step))
        return np.asarray(point + np.arange(first, last + 1.0)[:, np.newaxis] * step)

    def fills_gaps_of(self, other: Wall) -> bool:
        """Return whether `other` is an equal row, and these discs lie in the middle between its discs."""
        if not isinstance(other, Row) or (self.spacing, self.radius, self.motion_numbers) != (
            other.spacing,
            other.radius,
            other.motion_numbers,
        ):
            return False
        way = np.subtract(self.point, other.point) / hypot(*self.spacing)
        along = np.array(self.spacing) / hypot(*self.spacing)
        steps = float(way @ along) - 0.5
        return (
            abs(steps - round(steps)) < _ROUNDED
            and abs(float(way @ left_of(along[np.newaxis])[0])) < _ROUNDED
        )

    def drawn(self, thickness: float) -> Band:
        return self.drawn_about(self.point)

    def drawn_about(self, middle: Vector) -> Band:
        """Return the drawing of the discs that are within `length` / 2 of `middle` [m]."""
        angle = np.linspace(np.pi, 0.0, _POINTS)
        along = self.radius * np.outer(np.cos(angle), self.spacing) / hypot(*self.spacing)
        across = (
            self.radius * np.outer(np.sin(angle), left_of(np.array([self.spacing]))) / hypot(*self.spacing)
        )
        disc = Band(along + across, along - across, is_closed=False)
        centers = self.discs_about(middle)
        most = int((self.length + 2.0 * self.radius) / hypot(*self.spacing)) + 1
        return disc.copied(np.concatenate([centers, np.tile(centers[-1:], (most - len(centers), 1))]))
