"""Parts of convex polygons between circles, and the areas of discs in them, cut exactly at the border.

The area that a disc shares with a part is the integral (x dy - y dx) / 2 along the border of the shared area
(Green), with the center of the disc as the origin. The border consists of pieces of the disc's circle, of the
edges of the polygon, and of the circles. Each curve is cut where it meets another curve. A piece between two
cuts belongs to the border if its middle lies in the disc and in the part.
"""

from collections.abc import Iterable
from typing import NamedTuple, Self

import numpy as np

from warpgrains.base.arrays import BoolArray, FloatArray, IndexArray
from warpgrains.space.geometry import Circle, cross

TOUCH = 1e-5  # half chord, in radii, below which lines and circles only touch a disc: 1e-15 of its area
ONE_CORNER = 1e-12  # distance of corners that count as one, relative to their largest coordinate
FIXED = np.array([0.0, 1.0, 2.5, 4.1])  # extra cuts [rad], so that no arc has its middle at a touching wall


class Part(NamedTuple):
    """The part of a convex polygon that lies inside of some circles and outside of others."""

    corner: FloatArray
    """Corners of the polygon [m], counter-clockwise, shape (k, 2). For `cut_areas`, there may be one polygon
    for each of n discs, shape (n, k, 2)."""
    circles: tuple[Circle, ...]

    @classmethod
    def of(cls, corner: FloatArray, circles: Iterable[Circle]) -> Self:
        """Return the part of a polygon, corners [m], inside or outside of circles.

        Circles that exclude their inside but do not reach the polygon are omitted.
        """
        low, high = corner.min(axis=0), corner.max(axis=0)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        near = (c for c in circles if c.keeps_inside or (np.abs(middle - c[:2]) <= half + c.radius).all())
        return cls(corner, tuple(near))

    @property
    def along(self) -> FloatArray:
        """Vectors along the edges, from each corner to the next [m], in the shape of `corner`."""
        return _onward(self.corner) - self.corner

    def contains(self, points: FloatArray, margin: float = 0.0) -> BoolArray:
        """Return which points [m], (..., 2), lie in the part or at most `margin` [m] outside, (...,)."""
        corner, along = self.corner, self.along
        if corner.ndim > 2:
            corner, along = corner[:, np.newaxis], along[:, np.newaxis]
        beyond = -margin * np.hypot(along[..., 0], along[..., 1])
        found = np.all(cross(along, points[..., np.newaxis, :] - corner) >= beyond, axis=-1)
        for circle in self.circles:
            grown = circle.radius + (margin if circle.keeps_inside else -margin)
            found &= circle._replace(radius=grown).contains(points)
        return found

    @property
    def edges(self) -> FloatArray:
        """Both ends of each edge of the polygon [m], shape (k, 2, 2)."""
        return np.stack([self.corner, _onward(self.corner)], axis=1)

    def clearance(self, points: FloatArray) -> FloatArray:
        """Return a lower bound of the distance of points from the border [m], < 0 outside, shape (n,)."""
        to, along = points[:, np.newaxis] - self.corner, self.along
        size = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)  # of an edge without length, too
        share = ((to * along).sum(axis=2) / size).clip(0.0, 1.0)
        away = to - share[..., np.newaxis] * along
        nearest = np.hypot(away[..., 0], away[..., 1]).min(axis=1)
        for x, y, radius, _ in self.circles:
            nearest = np.minimum(nearest, np.abs(np.hypot(*(points - (x, y)).T) - radius))
        nearest = np.maximum(nearest * (1.0 - 1e-9) - 1e-12 * np.abs(self.corner).max(), 0.0)
        return np.where(self.contains(points), nearest, -nearest)

    def outermost(self, direction: FloatArray) -> FloatArray:
        """Return points of the part [m], shape (m, 2), among them the farthest along and against `direction`.

        Circles that exclude their inside are ignored.
        """
        outline = self._replace(circles=tuple(circle for circle in self.circles if circle.keeps_inside))
        points = [self.corner]
        for circle in outline.circles:
            middle, radius = np.array(circle[:2]), circle.radius
            angle = np.concatenate(
                [_angles_at(middle, radius, np.array(one[:2]), one.radius) for one in outline.circles]
            )
            met = middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)[np.isfinite(angle)]
            ends = middle + radius * np.array([-direction, direction])
            points += [outline.crossings(circle), met, ends]
        found = np.concatenate(points)
        return found[outline.contains(found, margin=1e-9 * np.abs(self.corner).max())]

    def areas(self, center: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the areas of discs inside the part [m2], shape (n,)."""
        area, (within, cut) = np.zeros(len(radius)), self._within_and_cut(center, radius)
        area[within] = np.pi * radius[within] ** 2
        area[cut] = self.cut_areas(center[cut], radius[cut])
        return area

    def _within_and_cut(self, center: FloatArray, radius: FloatArray) -> tuple[IndexArray, IndexArray]:
        """Return the indices of the discs with centers inside, and of those that the border may cut."""
        low, high, reach = self.corner.min(axis=0), self.corner.max(axis=0), radius[:, np.newaxis]
        near = np.flatnonzero(((center + reach > low) & (center - reach < high)).all(axis=1))
        apart = self.clearance(center[near])
        return near[apart > 0.0], near[np.abs(apart) <= radius[near]]

    def cut_areas(self, center: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the areas of discs inside the part [m2], shape (n,), by the integral along the border.

        `areas` returns the same, and calls this function only for discs that the border may cut.
        """
        start, along = self.corner - center[:, np.newaxis], self.along
        inside = [_roots(start, along, radius[:, np.newaxis])]
        area = 0.5 * radius**2 * self._cut_angles(center, radius, inside[0])
        inside += [np.broadcast_to(self._fractions(circle), start.shape) for circle in self.circles]
        cuts = np.concatenate([np.broadcast_to([0.0, 1.0], start.shape), *inside], axis=2)
        cut = np.sort(np.minimum(np.fmax(cuts, 0.0), 1.0), axis=2)  # NaN becomes 0
        middle, kept = 0.5 * (cut[:, :, 1:] + cut[:, :, :-1]), True
        for between, is_kept in zip(inside, [True, *(one.keeps_inside for one in self.circles)], strict=True):
            kept &= ((middle > between[..., :1]) & (middle < between[..., 1:])) == is_kept
        point = start[:, :, np.newaxis] + cut[..., np.newaxis] * along[..., np.newaxis, :]
        area += 0.5 * (cross(point[:, :, :-1], point[:, :, 1:]) * kept).sum(axis=(1, 2))
        for circle in self.circles:
            away = np.abs(np.hypot(*(center - circle[:2]).T) - circle.radius)
            near = np.flatnonzero(away < radius)
            if not len(near):
                continue
            part = self if self.corner.ndim == 2 else self._replace(corner=self.corner[near])
            area[near] += part._along_circle(circle, center[near], radius[near])
        return area

    def angles(self, center: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the total angle of the arcs of each disc's circle inside the part [rad], shape (n,)."""
        angle, (within, cut) = np.zeros(len(radius)), self._within_and_cut(center, radius)
        angle[within] = 2.0 * np.pi
        t = _roots(self.corner - center[cut, np.newaxis], self.along, radius[cut, np.newaxis])
        angle[cut] = self._cut_angles(center[cut], radius[cut], t)
        return angle

    def _cut_angles(self, center: FloatArray, radius: FloatArray, t: FloatArray) -> FloatArray:
        """Return the total angle of the arcs of each disc's circle inside the part [rad], shape (n,).

        The circles meet the lines of the k edges at the fractions t, shape (n, k, 2), see `_fractions`.
        """
        start = self.corner - center[:, np.newaxis]
        met = start[:, :, np.newaxis] + t[..., np.newaxis] * self.along[..., np.newaxis, :]
        angle = np.arctan2(met[..., 1], met[..., 0])  # beyond the ends of edges, too: more cuts are harmless
        cuts = [
            np.broadcast_to(FIXED, (len(center), len(FIXED))),
            angle.reshape(len(center), 2 * self.corner.shape[-2]),
        ]
        cuts += [_angles_at(center, radius, np.array(circle[:2]), circle.radius) for circle in self.circles]
        begin, end, middle = _arcs(np.concatenate(cuts, axis=1))
        points = center[:, np.newaxis] + radius[:, np.newaxis, np.newaxis] * middle
        return np.asarray(((end - begin) * self.contains(points)).sum(axis=1))

    def _along_circle(self, circle: Circle, center: FloatArray, radius: FloatArray) -> FloatArray:
        """Return the integral along the arcs of a circle inside the polygon and each disc [m2], shape (n,).

        See the head of the module; the center of the disc is the origin.
        """
        middle_of, rho = np.array(circle[:2]), circle.radius
        others = tuple(other for other in self.circles if other != circle and other.meets(circle))
        cuts = [FIXED, self._crossing_angles(circle)]
        cuts += [_angles_at(middle_of, rho, np.array(other[:2]), other.radius) for other in others]
        common = np.concatenate([np.broadcast_to(own, (len(center), own.shape[-1])) for own in cuts], axis=1)
        # from the cuts of the discs' circles, so that both cuts agree where a disc just touches the circle
        of_disc = _angles_at(center, radius, middle_of, rho)
        to_cut = np.stack([np.cos(of_disc), np.sin(of_disc)], axis=-1) * radius[:, np.newaxis, np.newaxis]
        own = np.arctan2(*np.moveaxis(to_cut + (center - middle_of)[:, np.newaxis], -1, 0)[::-1])
        begin, end, middle = _arcs(np.concatenate([common, own], axis=1))
        points = middle_of + rho * middle
        away = np.hypot(*np.moveaxis(points - center[:, np.newaxis], -1, 0))
        kept = self._replace(circles=others).contains(points) & (away <= radius[:, np.newaxis])
        to = middle_of - center
        turned = to[:, :1] * (np.sin(end) - np.sin(begin)) - to[:, 1:] * (np.cos(end) - np.cos(begin))
        area: FloatArray = 0.5 * ((rho**2 * (end - begin) + rho * turned) * kept).sum(axis=1)
        return area if circle.keeps_inside else -area

    def _crossing_angles(self, circle: Circle) -> FloatArray:
        """Return the angles on a circle at which it meets the lines of the k edges [rad].

        The shape is (2 k,), or (n, 2 k) for n polygons. NaN for a line that the circle does not meet.
        """
        t = self._fractions(circle)
        met = (self.corner - circle[:2])[..., np.newaxis, :] + t[..., np.newaxis] * self.along[
            ..., np.newaxis, :
        ]
        return np.asarray(np.arctan2(met[..., 1], met[..., 0])).reshape(*t.shape[:-2], 2 * t.shape[-2])

    def crossings(self, circle: Circle) -> FloatArray:
        """Return the points at which the lines of the edges meet a circle [m], shape (m, 2)."""
        t = self._fractions(circle)
        edge, which = np.nonzero(np.isfinite(t))
        return self.corner[edge] + t[edge, which, np.newaxis] * self.along[edge]

    def _fractions(self, circle: Circle) -> FloatArray:
        """Return both fractions t of each of k edges at which its line meets a circle, shape (..., k, 2).

        The point is corner + t (next corner - corner). NaN if the line does not meet the circle.
        """
        return _roots(self.corner - circle[:2], self.along, np.array(circle.radius))


def _onward(corner: FloatArray) -> FloatArray:
    """Return the next corner of each corner of polygons, shape (..., k, 2), in a tenth of np.roll's time."""
    return np.concatenate([corner[..., 1:, :], corner[..., :1, :]], axis=-2)


def distinct(corner: FloatArray) -> FloatArray:
    """Return the corners of a polygon, (k, 2), without those that equal the next corner up to rounding."""
    apart = np.hypot(*(_onward(corner) - corner).T)
    return corner[apart > ONE_CORNER * np.abs(corner).max(initial=0.0)]


def clip(corner: FloatArray, normal: FloatArray, level: float) -> FloatArray:
    """Cut a convex polygon with the half plane normal . x <= level [m], |normal| = 1; return its corners."""
    beyond = corner @ normal - level
    if not (beyond > 0.0).any():
        return corner
    found = []
    for p, q, a, b in zip(corner, _onward(corner), beyond, [*beyond[1:], *beyond[:1]], strict=True):
        if a <= 0.0:
            found.append(p)
        if (a <= 0.0) != (b <= 0.0):
            cut = p + a / (a - b) * (q - p)
            found.append(cut + (level - cut @ normal) * normal)  # exact if the normal is along an axis
    return np.array(found).reshape(-1, 2)


def _arcs(cut: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Divide n circles into arcs at the angles `cut` [rad], shape (n, k); NaN is taken as 0.

    Return begin and end of the arcs [rad], shape (n, k), and the unit vectors to their middles, (n, k, 2).
    """
    begin = np.sort(np.where(np.isnan(cut), 0.0, cut) % (2.0 * np.pi), axis=1)
    end = np.append(begin[:, 1:], np.full((len(begin), 1), 2.0 * np.pi), axis=1)
    middle = 0.5 * (begin + end)
    return begin, end, np.stack([np.cos(middle), np.sin(middle)], axis=-1)


def _angles_at(
    center: FloatArray, radius: FloatArray | float, other: FloatArray, other_radius: FloatArray | float
) -> FloatArray:
    """Return both angles on circles about `center` at which they meet circles about `other` [rad], (..., 2).

    NaN if they do not meet or only touch.
    """
    to = center - other
    rho, towards = np.hypot(to[..., 0], to[..., 1]), np.arctan2(to[..., 1], to[..., 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.arccos((other_radius**2 - rho**2 - radius**2) / (2.0 * rho * radius))
        half = np.where(np.sin(half) > TOUCH, half, np.nan)
    return np.stack([towards - half, towards + half], axis=-1)


def _roots(start: FloatArray, along: FloatArray, radius: FloatArray) -> FloatArray:
    """Return both t with |start + t along| = radius, shape (..., 2); NaN if there are none."""
    a, b = (along**2).sum(axis=-1), (start * along).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.sqrt(b**2 - a * ((start**2).sum(axis=-1) - radius**2))
        half = np.where(half > TOUCH * radius * np.sqrt(a), half, np.nan)
        return np.stack([(-b - half) / a, (-b + half) / a], axis=-1)
