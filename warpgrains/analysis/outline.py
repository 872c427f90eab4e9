"""Areas between straight edges and circles, cut exactly at their intersections.

A shape is the part of a polygon that lies inside of some circles and outside of others. Its border is cut
where edges and circles meet. A piece between two cuts belongs to the border of the shape if its midpoint lies
in all others. The area is the integral (x dy - y dx) / 2 along these pieces (Green).

The polygon may be several, as an array of directed edges, shape (e, 2, 2), counter-clockwise about each.
"""

from collections.abc import Iterable

import numpy as np

from warpgrains.arrays import BoolArray, FloatArray, IndexArray
from warpgrains.scene.geometry import Circle


def edges_of(corner: FloatArray) -> FloatArray:
    """Return the edges of a polygon, shape (k, 2, 2), from its corners, shape (k, 2)."""
    return np.stack([corner, np.roll(corner, -1, axis=0)], axis=1)


def signed_area(edges: FloatArray) -> float:
    """Return the area of polygons [m2]: positive if their corners are in counter-clockwise order."""
    return float(0.5 * _cross(edges[:, 0], edges[:, 1]).sum())


def clip(corner: FloatArray, normal: FloatArray, level: float) -> FloatArray:
    """Return the part of a polygon with normal . x <= level (Sutherland and Hodgman, 1974), shape (k, 2).

    The normal is a unit vector, shape (2,).

    If that are several parts, they are connected by edges that run back and forth, so that areas and windings
    are right.
    """
    beyond = corner @ normal - level
    onward, beyond_onward = np.roll(corner, -1, axis=0), np.roll(beyond, -1)
    found = []
    for p, q, a, b in zip(corner, onward, beyond, beyond_onward, strict=True):
        if a <= 0.0:
            found.append(p)
        if (a <= 0.0) != (b <= 0.0):
            cut = p + a / (a - b) * (q - p)
            found.append(cut + (level - cut @ normal) * normal)  # exact if the normal is along an axis
    return np.array(found).reshape(-1, 2)


def crosses_itself(corner: FloatArray) -> bool:
    """Return whether two edges of a polygon that share no corner meet."""
    edges, count = edges_of(corner), len(corner)
    i, j = np.triu_indices(count, 2)
    apart = (j - i) < count - 1
    (a, b), (c, d) = edges[i[apart]].swapaxes(0, 1), edges[j[apart]].swapaxes(0, 1)
    straddles = _cross(b - a, c - a) * _cross(b - a, d - a) <= 0.0
    straddled = _cross(d - c, a - c) * _cross(d - c, b - c) <= 0.0
    boxes = (np.minimum(a, b) <= np.maximum(c, d)) & (np.minimum(c, d) <= np.maximum(a, b))
    return bool((straddles & straddled & boxes.all(axis=1)).any())


def windings(edges: FloatArray, points: FloatArray) -> IndexArray:
    """Return how often the polygons go around points, shape (..., 2) to (...,): 0 outside."""
    x, y = points[..., 0].ravel(), points[..., 1].ravel()
    count = np.zeros(x.shape, np.int64)
    for (x0, y0), (x1, y1) in edges.tolist():
        beside = np.flatnonzero((y >= min(y0, y1)) & (y < max(y0, y1)))
        left = (x1 - x0) * (y[beside] - y0) - (x[beside] - x0) * (y1 - y0)
        if y1 > y0:
            count[beside] += left > 0.0
        else:
            count[beside] -= left < 0.0
    return count.reshape(points.shape[:-1])


def area_of(edges: FloatArray, circles: Iterable[Circle]) -> float:
    """Return the area [m2] of the part of polygons that lies on the kept side of all circles."""
    circles = list(dict.fromkeys(circles))
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    cuts = [np.broadcast_to([0.0, 1.0], (len(edges), 2))]
    cuts += [np.nan_to_num(_crossings(edges, circle)).clip(0.0, 1.0) for circle in circles]
    cut = np.sort(np.concatenate(cuts, axis=1), axis=1)
    point = start[:, np.newaxis] + cut[..., np.newaxis] * along[:, np.newaxis]
    p, q = point[:, :-1], point[:, 1:]
    straight = 0.5 * _cross(p, q)[_in_all(circles, 0.5 * (p + q))].sum()
    return float(straight + sum(_along_circle(edges, circle, circles) for circle in circles))


def _along_circle(edges: FloatArray, circle: Circle, circles: list[Circle]) -> float:
    """Return the integral (x dy - y dx) / 2 along the parts of a circle that bound the shape [m2]."""
    center, r = np.array(circle[:2]), circle.radius
    t = _crossings(edges, circle)
    edge, which = np.nonzero((t >= 0.0) & (t <= 1.0))
    met = edges[edge, 0] + t[edge, which, np.newaxis] * (edges[edge, 1] - edges[edge, 0]) - center
    others = [other for other in circles if other != circle]
    # fixed cuts: the midpoint of a circle that only touches an edge must not be where it touches
    cuts = [np.array([0.0, 1.0, 2.5, 4.1]), np.arctan2(met[:, 1], met[:, 0])]
    cuts += [angles_at(center[np.newaxis], r, other)[0] for other in others]
    start = np.sort(np.nan_to_num(np.concatenate(cuts)) % (2.0 * np.pi))
    end = np.append(start[1:], 2.0 * np.pi)
    middle = 0.5 * (start + end)
    points = center + r * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    kept = (windings(edges, points) > 0) & _in_all(others, points)
    turned = np.stack([np.sin(end) - np.sin(start), np.cos(start) - np.cos(end)], axis=1) @ center
    area = 0.5 * (r**2 * (end - start) + r * turned)[kept].sum()
    return float(area if circle.keeps_inside else -area)


def angles_at(center: FloatArray, r: float, circle: Circle) -> FloatArray:
    """Return the angles at which circles of radius r [m] meet another, shape (n, 2); NaN if they do not."""
    to = center - np.array(circle[:2])
    rho, towards = np.sqrt(to[:, 0] * to[:, 0] + to[:, 1] * to[:, 1]), np.arctan2(to[:, 1], to[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.arccos((circle.radius**2 - rho**2 - r**2) / (2.0 * rho * r))
    return np.stack([towards - half, towards + half], axis=1)


def angles_at_edges(center: FloatArray, r: float, edges: FloatArray) -> FloatArray:
    """Return the angles at which circles of radius r [m] meet edges, shape (n, k), filled up with NaN.

    k is the largest number of them about one center.
    """
    start, along = edges[:, 0] - center[:, np.newaxis], edges[:, 1] - edges[:, 0]
    t = _roots(start, along, r)
    row, edge, which = np.nonzero((t >= 0.0) & (t <= 1.0))
    met = start[row, edge] + t[row, edge, which, np.newaxis] * along[edge]
    count = np.bincount(row, minlength=len(center))
    angle = np.full((len(center), count.max(initial=0)), np.nan)
    angle[row, np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)] = np.arctan2(*met.T[::-1])
    return angle


def distance_to_edges(edges: FloatArray, points: FloatArray) -> FloatArray:
    """Return the distance of points [m], shape (n, 2), from the nearest edge, shape (n,)."""
    nearest = np.full(len(points), np.inf)
    for start, end in edges:
        along, to = end - start, points - start
        size = along @ along
        t = np.clip(to @ along / size, 0.0, 1.0) if size > 0.0 else np.zeros(len(points))
        nearest = np.minimum(nearest, np.hypot(*(to - t[:, np.newaxis] * along).T))
    return nearest


def _crossings(edges: FloatArray, circle: Circle) -> FloatArray:
    """Return where lines along edges meet a circle, as fractions of the edges, (e, 2); NaN if nowhere."""
    return _roots(edges[:, 0] - np.array(circle[:2]), edges[:, 1] - edges[:, 0], circle.radius)


def _roots(start: FloatArray, along: FloatArray, r: float) -> FloatArray:
    """Return both t with |start + t along| = r, shape (..., 2); NaN if there are none."""
    a, b = (along**2).sum(axis=-1), (start * along).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.sqrt(b**2 - a * ((start**2).sum(axis=-1) - r**2))
        return np.stack([(-b - half) / a, (-b + half) / a], axis=-1)


def _in_all(circles: Iterable[Circle], points: FloatArray) -> BoolArray:
    kept = np.ones(points.shape[:-1], bool)
    for circle in circles:
        kept &= circle.contains(points)
    return kept


def _cross(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
