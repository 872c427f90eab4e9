"""An arc inside the domain. This is the host's side; kernels/walls/arc.py is the device's."""

from math import cos, dist, pi, sin
from typing import ClassVar

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, Indices
from warpgrains.base.described import described
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import Side, distance, hollow_normals, left_of
from warpgrains.walls.band import Band, strip
from warpgrains.walls.wall import Wall, kind_of_wall

_POINTS = 64  # number of points in the drawing of an arc


@kind_of_wall
class Arc(Wall):
    """A part of a circle that grains touch from both sides and round its ends.

    Parameters
    ----------
    {fields}

    Raises
    ------
    InputError
        A value is invalid.

    Examples
    --------
    >>> bowl = wg.Arc(center=(0.0, 0.0), radius=1.0, from_angle=-2.5, to_angle=-0.5)
    >>> grain = {"position": [[0.3, 0.0]], "radius": 0.1, "mass": 0.1}
    >>> wg.Scene(**grain, radius_out=2.0, walls=[bowl]).walls[0]
    Arc(center=(0.0, 0.0), radius=1.0, from_angle=-2.5, to_angle=-0.5)
    """

    kind: ClassVar[str] = "arc"
    kind_number: ClassVar[int] = 3
    center: tuple[float, float] = described("Center [m], two components.", check=checks.vector)
    radius: float = described("Radius [m].", check=checks.positive)
    from_angle: float = described("Angle from the x axis at which it begins [rad].", check=checks.number)
    to_angle: float = described("Angle at which it ends, counterclockwise [rad].", check=checks.number)

    def __post_init__(self) -> None:
        super().__post_init__()
        begin, end = self.from_angle, self.to_angle
        if not begin < end < begin + 2.0 * pi:
            raise InputError(
                f"to_angle of an arc is {end} rad: it must be greater than from_angle, {begin} rad, by less"
                " than a turn"
            )

    @property
    def numbers(self) -> tuple[float, ...]:
        middle, half = 0.5 * (self.from_angle + self.to_angle), 0.5 * (self.to_angle - self.from_angle)
        return (*self.center, self.radius, cos(middle), sin(middle), cos(half))

    @property
    def circle(self) -> tuple[float, float, float]:
        """Center and radius of the circle of which the arc is a part [m]."""
        return (*self.center, self.radius)

    @property
    def middle(self) -> tuple[float, float]:
        return self.center

    def farthest(self, point: tuple[float, float]) -> float:
        return dist(self.center, point) + self.radius

    def side(self, position: FloatArray, radius: FloatArray) -> Side:
        away, end = position - self.center, self.end_of(position)
        rho = distance(away)[:, np.newaxis]
        away, rho = np.where(rho > 0.0, away, self.numbers[3:5]), np.where(rho > 0.0, rho, 1.0)
        foot = self.center + away * (self.radius / rho)
        return Side.at(np.where(end[:, np.newaxis] < 0, foot, self.ends[end]), position, radius)

    def end_of(self, position: FloatArray) -> Indices:
        _, _, _, mx, my, c = self.numbers
        x, y = (position - self.center).T
        end = np.where(mx * y - my * x < 0.0, 0, 1)
        return np.where(x * mx + y * my >= distance(position - self.center) * c, -1, end)

    @property
    def ends(self) -> FloatArray:
        cx, cy, r, mx, my, c = self.numbers
        s = float(np.sqrt(1.0 - c * c))
        return np.array([(cx + r * (c * mx - t * my), cy + r * (c * my + t * mx)) for t in (-s, s)])

    @property
    def inwards(self) -> FloatArray:
        return left_of(self.ends - self.center) / np.array([[self.radius], [-self.radius]])

    def hollow_radii(self, position: FloatArray) -> FloatArray:
        is_inside = distance(position - self.center) < self.radius
        at_face = np.where(is_inside, self.radius, -self.radius)
        return np.where(self.end_of(position) < 0, at_face, 0.0)

    def face_normals(self, point: FloatArray, position: FloatArray) -> FloatArray:
        return hollow_normals(self.center, self.radius, point, position)

    def drawn(self, thickness: float) -> Band:
        """Return the drawing of the arc, centered on it and `thickness` / 2 [m] thick.

        A circle, which grains touch from one side only, is drawn `thickness` [m] thick.
        """
        angle = np.linspace(self.from_angle, self.to_angle, _POINTS)
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return strip(self.center + self.radius * circle, 0.5 * thickness)
