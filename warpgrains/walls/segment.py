"""A straight wall inside the domain. This is the host's side; kernels/walls/segment.py is the device's."""

from math import dist
from typing import ClassVar

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, Indices
from warpgrains.base.described import described
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import SMALLEST, Side, left_of
from warpgrains.walls.band import Band, strip
from warpgrains.walls.wall import StraightWall, kind_of_wall


@kind_of_wall
class Segment(StraightWall):
    """A straight wall without thickness that grains touch from both sides and round its ends.

    The keys of its ends in a scene file are `from` and `to`.

    Parameters
    ----------
    {fields}

    Raises
    ------
    InputError
        A value is invalid, or both ends are the same point.

    Examples
    --------
    >>> slope = wg.Segment(start=(-1.0, 0.5), end=(1.0, -0.5))
    >>> grain = {"position": [[0.0, 0.5]], "radius": 0.1, "mass": 0.1}
    >>> wg.Scene(**grain, radius_out=2.0, walls=[slope]).walls[0]
    Segment(start=(-1.0, 0.5), end=(1.0, -0.5))
    """

    kind: ClassVar[str] = "segment"
    kind_number: ClassVar[int] = 2
    start: tuple[float, float] = described("One end [m], two components.", key="from", check=checks.vector)
    end: tuple[float, float] = described("The other end [m], two components.", key="to", check=checks.vector)

    def __post_init__(self) -> None:
        super().__post_init__()
        if dist(self.start, self.end) < SMALLEST:
            raise InputError(f"both ends of a segment are {self.end}: they must be two points")
        if self.force is not None and self.moves:
            raise InputError("velocity of a segment is given, and a force: a wall has only one of them")

    @property
    def numbers(self) -> tuple[float, ...]:
        return (*self.start, *self.end)

    @property
    def circle(self) -> tuple[float, float, float]:
        return (*self.middle, self.farthest(self.middle))

    @property
    def middle(self) -> tuple[float, float]:
        return 0.5 * (self.start[0] + self.end[0]), 0.5 * (self.start[1] + self.end[1])

    @property
    def widths(self) -> tuple[float, float]:
        return abs(self.end[0] - self.start[0]), abs(self.end[1] - self.start[1])

    def farthest(self, point: tuple[float, float]) -> float:
        return max(dist(self.start, point), dist(self.end, point))

    def side(self, position: FloatArray, radius: FloatArray) -> Side:
        along = np.subtract(self.end, self.start)
        return Side.at(self.start + self._share(position)[:, np.newaxis] * along, position, radius)

    def _share(self, position: FloatArray) -> FloatArray:
        """Return t in [0, 1], shape (n,), of the points start + t (end - start) nearest to positions."""
        (dx, dy), (x, y) = np.subtract(self.end, self.start), (position - self.start).T
        share: FloatArray = np.clip((x * dx + y * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        return share

    def end_of(self, position: FloatArray) -> Indices:
        share = self._share(position)
        return np.where(share == 0.0, 0, np.where(share == 1.0, 1, -1))

    @property
    def ends(self) -> FloatArray:
        return np.array([self.start, self.end])

    @property
    def inwards(self) -> FloatArray:
        along = np.subtract(self.end, self.start) / dist(self.start, self.end)
        return np.array([along, -along])

    def face_normals(self, point: FloatArray, position: FloatArray) -> FloatArray:
        left = left_of(self.inwards[:1])
        is_left = (self.side(position, np.zeros(len(position))).normal * left).sum(axis=1) > 0.0
        return np.where(is_left[:, np.newaxis], left, -left)

    @property
    def across(self) -> tuple[float, float]:
        x, y = np.subtract(self.end, self.start) / dist(self.start, self.end)
        return -float(y), float(x)

    def drawn(self, thickness: float) -> Band:
        return strip(np.array([self.start, self.end]), 0.5 * thickness)
