"""Drawings of walls: flat bands, which pictures, recordings and the page show."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.space.geometry import Circle, left_of

_WALL_SEGMENTS = 256
_END_SEGMENTS = 16  # number of angles in each half of a round end


class Band(NamedTuple):
    """Drawing of a wall: the area between a left and a right line, which have equally many points."""

    first: FloatArray
    """Points of the left line [m], shape (k, 2)."""
    second: FloatArray
    """Points of the right line [m], shape (k, 2)."""
    is_closed: bool
    """Whether both lines are closed, as in a ring."""

    def copied(self, ways: FloatArray) -> Band:
        """Return one band that shows k copies, displaced by `ways` [m], shape (k, 2).

        Lines of no thickness, which are invisible, connect the copies.
        """
        first, second = self.first, self.second
        if self.is_closed:
            first, second = (np.concatenate([line, line[:1]]) for line in (first, second))
        first, second = (np.concatenate([first[:1], line, first[-1:]]) for line in (first, second))
        first, second = ((line + ways[:, np.newaxis]).reshape(-1, 2) for line in (first, second))
        return Band(first, second, is_closed=False)

    @property
    def reach(self) -> float:
        """Largest absolute coordinate of a point [m]."""
        return float(max(np.abs(self.first).max(), np.abs(self.second).max()))

    def outlines(self) -> FloatArray:
        """Return the points of the closed lines that bound the band [m], shape (lines, points, 2).

        A closed band has two such lines, any other band has one.
        """
        if self.is_closed:
            return np.stack([self.first, self.second[::-1]])
        return np.concatenate([self.first, self.second[::-1]])[np.newaxis]


def ring(border: Circle, thickness: float) -> Band:
    """Return the band of this thickness [m] along a circle, on the side of `border` where no grains are."""
    x, y, r, keeps_inside = border
    inner, outer = (r, r + thickness) if keeps_inside else (max(r - thickness, r / 2), r)
    angle = np.arange(_WALL_SEGMENTS) * 2.0 * np.pi / _WALL_SEGMENTS
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    first, second = (radius * circle + (x, y) for radius in (inner, outer))
    return Band(first, second, is_closed=True)


def strip(line: FloatArray, thickness: float) -> Band:
    """Return the band of this thickness [m] about a line of points [m], shape (k, 2), with round ends."""
    along = np.diff(line, axis=0)
    along /= np.hypot(*along.T)[:, np.newaxis]
    along = np.concatenate([along[:1], along[:-1] + along[1:], along[-1:]])
    along *= 0.5 * thickness / np.hypot(*along.T)[:, np.newaxis]
    angle = np.linspace(0.0, 0.5, _END_SEGMENTS)[:, np.newaxis] * np.pi
    ahead, aside = np.sin(angle), np.cos(angle)
    middle = np.concatenate([line[:1] - ahead[::-1] * along[0], line[1:-1], line[-1:] + ahead * along[-1]])
    along = np.concatenate([aside[::-1] * along[0], along[1:-1], aside * along[-1]])
    across = left_of(along)
    return Band(middle + across, middle - across, is_closed=False)
