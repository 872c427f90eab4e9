"""Rectangles with sides along the axes. The command line parses them, without NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Self

if TYPE_CHECKING:
    from warpgrains.base.arrays import FloatArray


class Bounds(NamedTuple):
    """A rectangle with sides along the axes [m]."""

    left: float
    bottom: float
    right: float
    top: float

    @classmethod
    def around(cls, points: FloatArray) -> Self:
        """Return the smallest box that contains points [m], shape (k, 2)."""
        return cls(*points.min(axis=0).tolist(), *points.max(axis=0).tolist())

    def grown(self, across: float, along: float | None = None) -> Self:
        """Return the box grown on each side by `across` [m] along x, and by `along` [m] along y.

        The default of `along` is `across`.
        """
        up = across if along is None else along
        return type(self)(self.left - across, self.bottom - up, self.right + across, self.top + up)

    def covering(self, other: Bounds) -> Self:
        """Return the smallest box that contains this box and another."""
        least = map(min, self[:2], other[:2])
        return type(self)(*least, *map(max, self[2:], other[2:]))

    @property
    def width(self) -> float:
        """Length along x [m]."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Length along y [m]."""
        return self.top - self.bottom

    @property
    def half(self) -> float:
        """Half of the longer side [m]."""
        return max(self.width, self.height) / 2.0

    @property
    def center(self) -> tuple[float, float]:
        """Center of the box [m]."""
        return (self.left + self.right) / 2.0, (self.bottom + self.top) / 2.0
