"""An infinite straight wall. This is the host's side; kernels/walls/line.py is the device's."""

from math import hypot, inf
from typing import Any, ClassVar, Self

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import described
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import ROUNDING, Side
from warpgrains.walls.band import Band, strip
from warpgrains.walls.wall import Drive, InfiniteWall, StraightWall, kind_of_wall

Vector = tuple[float, float]


def _direction(field: str, value: Any) -> Vector:
    x, y = checks.vector(field, value)
    if not 0.0 < (length := hypot(x, y)) < inf:
        raise InputError(f"{field} is ({x}, {y}): it must have a direction")
    return x / length, y / length


@kind_of_wall
class Line(InfiniteWall, StraightWall):
    """An infinite straight wall, with all grains on one side of it.

    A line may have a force, a velocity along itself and friction at the same time.

    Parameters
    ----------
    {fields}

    Raises
    ------
    InputError
        A value is invalid.

    Examples
    --------
    >>> floor = wg.Line(point=(0.0, -1.0), normal=(0.0, 1.0), length=4.0)
    >>> grain = {"position": [[0.0, 0.5]], "radius": 0.1, "mass": 0.1}
    >>> wg.Scene(**grain, radius_out=2.0, walls=[floor]).walls[0]
    Line(point=(0.0, -1.0), normal=(0.0, 1.0), length=4.0)
    """

    kind: ClassVar[str] = "line"
    kind_number: ClassVar[int] = 4
    point: Vector = described("A point of the line [m], two components.", check=checks.vector)
    normal: Vector = described("Direction from the line to the grains, two components.", check=_direction)
    length: float = described(
        "Length of the part about the point that pictures show [m].", check=checks.positive
    )
    pressure: float | None = described(
        "Pressure that drives the line along its normal [N/m], instead of a force: on the part between two"
        " lines at right angles to it, where they are, or else on `length`.",
        check=checks.number,
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.force is not None and self.pressure is not None:
            raise InputError("pressure of a line is given, and a force: give one")
        across = abs(float(np.dot(self.velocity, self.normal)))
        if self.drive is not None and across > ROUNDING * hypot(*self.velocity):
            raise InputError(
                f"velocity of a line is {self.velocity}: it must be along the line, which a force drives"
            )

    @property
    def across(self) -> Vector:
        return self.normal

    @property
    def drive(self) -> Drive | None:
        if self.pressure is None or self.mass is None:
            return super().drive
        return Drive(1.0 / self.mass, pressure=self.pressure, length=self.length, direction=self.normal)

    def bounds(self, other: "Line") -> bool:
        """Return whether the line is perpendicular to `other`, so that it bounds the length of `other`."""
        return bool(abs(np.dot(self.normal, other.normal)) <= ROUNDING)

    @property
    def along(self) -> Vector:
        """Unit vector along the line, with the grains to the left."""
        return self.normal[1], -self.normal[0]

    @property
    def numbers(self) -> tuple[float, ...]:
        return (*self.point, *self.normal)

    @property
    def speed(self) -> float:
        """Speed of the line along its normal [m/s]: motion along the line does not change its place."""
        return abs(float(np.dot(self.velocity, self.normal)))

    def side(self, position: FloatArray, radius: FloatArray) -> Side:
        (x, y), (nx, ny) = (position - self.point).T, self.normal
        return Side(np.tile(-np.array(self.normal), (len(position), 1)), x * nx + y * ny - radius)

    def face_normals(self, point: FloatArray, position: FloatArray) -> FloatArray:
        return np.tile(-np.array(self.normal), (len(position), 1))

    def at(self, time: float) -> Self:
        moved, (x, y), (nx, ny) = super().at(time), self.point, self.normal
        if moved is self:
            return self
        way = (moved.point[0] - x) * nx + (moved.point[1] - y) * ny
        point = x + way * nx, y + way * ny
        return moved.changed({"point": point})  # motion along the line does not change its place

    def drawn(self, thickness: float) -> Band:
        behind = np.array(self.point) - 0.5 * thickness * np.array(self.normal)
        return strip(behind + 0.5 * self.length * np.outer((-1.0, 1.0), self.along), thickness)
