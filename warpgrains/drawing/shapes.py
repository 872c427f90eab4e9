"""Meshes of a grain of radius 1 m and of walls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpgrains.base.arrays import BoolArray, FloatArray
from warpgrains.walls.band import Band
from warpgrains.walls.row import Row

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.walls.wall import Wall

WALL_COLOR = (0.35, 0.35, 0.35)
"""Color of walls (sRGB)."""

_SEGMENTS = 64  # per circle about z; the polygon lacks 0.16 % of the disc's area
_RINGS = 16  # of a sphere, from pole to pole
_RIM = 0.88  # inner radius of the rim of a disc, in radii
_SLOPE = 2.0  # slope of the rim; its shading separates grains that touch
_MARKED = 2  # segments of a circle in the mark of a mesh, which shows the angle of a grain
_LINE = 0.06  # half of the width of a drawn mark, in radii


@dataclass(frozen=True)
class Shape:
    """A mesh of polygons: v points and p polygons, which have c corners in all."""

    points: FloatArray
    """Points [m], shape (v, 3)."""
    counts: NDArray[np.int64]
    """Number of corners of each polygon, shape (p,)."""
    corners: NDArray[np.int64]
    """Index of the point at each corner, polygon by polygon, counter-clockwise from outside, shape (c,)."""
    marked: BoolArray | None = None
    """Mask of the polygons that form the mark, which shows rotation, shape (p,); None without a mark."""
    is_round: bool = False
    """Whether the mesh is a sphere of radius 1 m, which is shaded smoothly."""

    @property
    def normals(self) -> FloatArray:
        """Normals of the polygons, shape (p, 3); for a sphere those of the points, shape (v, 3)."""
        if self.is_round:
            return self.points
        first = np.cumsum(self.counts) - self.counts
        corner = self.points[self.corners] - np.repeat(self.points[self.corners[first]], self.counts, axis=0)
        onward = np.arange(1, len(corner) + 1)
        onward[first + self.counts - 1] = first
        area = np.add.reduceat(np.cross(corner, corner[onward]), first)
        size = np.linalg.norm(area, axis=1)[:, np.newaxis]
        return np.where(size > 0.0, area / np.where(size > 0.0, size, 1.0), (0.0, 0.0, 1.0))

    @property
    def height(self) -> float:
        """Extent towards the viewer [m]."""
        return float(self.points[:, 2].max())


def disc(is_marked: bool = False) -> Shape:
    """Return the mesh of a disc of radius 1 m that faces +z, with a sloping rim.

    If `is_marked`, a narrow sector at angle 0 is the mark, which shows rotation.
    """
    height = _SLOPE * (1.0 - _RIM)
    points = np.concatenate([_circle(_SEGMENTS, _RIM, height), _circle(_SEGMENTS, 1.0, 0.0)])
    top = np.arange(_SEGMENTS)
    rim = _bands(top[np.newaxis] + np.array([[0], [_SEGMENTS]]))
    sectors, marked = [top], None
    if is_marked:
        ends = np.array([-_MARKED // 2, _MARKED // 2, _SEGMENTS // 2, _SEGMENTS - _MARKED // 2])
        arcs = [np.arange(*arc) % _SEGMENTS for arc in zip(ends, ends[1:] + 1, strict=False)]
        sectors = [np.insert(arc, 0, len(points)) for arc in arcs]
        points = np.append(points, [(0.0, 0.0, height)], axis=0)
        marked = np.concatenate([[True, False, False], _in_mark()])
    counts = np.concatenate([[len(sector) for sector in sectors], np.full(len(rim), 4)])
    corners = np.concatenate([*sectors, rim.ravel()])
    return Shape(points, counts, corners, marked)


def sphere(is_marked: bool = False) -> Shape:
    """Return the mesh of a sphere of radius 1 m with poles on the z axis.

    If `is_marked`, a narrow lune from pole to pole at angle 0 is the mark, which shows rotation.
    """
    polar = np.linspace(0.0, np.pi, _RINGS + 1)[1:-1]
    rings = [_circle(_SEGMENTS, np.sin(angle), np.cos(angle)) for angle in polar]
    points = np.concatenate([*rings, [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]])
    number = np.arange((_RINGS - 1) * _SEGMENTS).reshape(_RINGS - 1, _SEGMENTS)
    north, south = np.full((2, _SEGMENTS), [[number.size], [number.size + 1]])
    onward = np.roll(number, -1, axis=1)
    caps = [(north, number[0], onward[0]), (south, onward[-1], number[-1])]
    triangles = np.concatenate([np.stack(cap, axis=1) for cap in caps])
    sides = _bands(number)
    counts = np.repeat([3, 4], [len(triangles), len(sides)])
    marked = np.tile(_in_mark(), len(counts) // _SEGMENTS) if is_marked else None
    corners = np.concatenate([triangles.ravel(), sides.ravel()])
    return Shape(points, counts, corners, marked, is_round=True)


SHAPES: dict[str, Callable[..., Shape] | None] = {"points": None, "discs": disc, "spheres": sphere}
"""Functions that return the mesh of a grain, by the value of `draw_as`; None where grains are points."""


def mark() -> FloatArray:
    """Return the corners of the mark of a disc of radius 1 at angle 0, shape (4, 2): a thin rectangle."""
    return np.array([(0.0, -_LINE), (1.0 - _LINE, -_LINE), (1.0 - _LINE, _LINE), (0.0, _LINE)])


def marks(position: FloatArray, radius: FloatArray, angle: FloatArray) -> FloatArray:
    """Return the corners [m] of the marks of discs that have turned by angles [rad], shape (n, 4, 2)."""
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, np.newaxis]
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    x, y = mark().T[:, :, np.newaxis]
    return position[:, np.newaxis] + radius[:, np.newaxis, np.newaxis] * (x * along + y * across)


def wall_mesh(band: Band, height: float = 0.0) -> Shape:
    """Return the mesh of the band that draws a wall.

    Without a height, it lies in the plane z = 0 and faces +z. With a height [m], it is a body from z =
    -height to z = height. Between copies in a periodic box the band has no width, and there the mesh has no
    faces.
    """
    lines = [(band.first, height), (band.second, height), (band.second, -height), (band.first, -height)]
    lines = lines[: 4 if height > 0.0 else 2]
    points = np.concatenate([np.insert(line, 2, z, axis=1) for line, z in lines])
    number = np.arange(len(points)).reshape(len(lines), -1)
    around = [0, 1, 2, 3, 0] if height > 0.0 else [0, 1]
    is_wide = (band.first != band.second).any(axis=1)
    has_faces = is_wide | np.roll(is_wide, -1)
    has_faces[-1] &= band.is_closed
    faces = _bands(number[around]).reshape(-1, len(is_wide), 4)[:, has_faces]
    return Shape(points, np.full(faces.size // 4, 4), faces.ravel())


def drawn_walls(scene: Scene, thickness: float) -> dict[str, Band]:
    """Return the bands that draw the walls of a scene at its start, by name.

    They have a thickness [m], which lies outside of the space of the grains.
    """
    own = ((number, wall) for number, wall in enumerate(scene.walls_at(scene.time)) if wall.image is None)
    return _by_name(scene, {number: _drawn(scene, wall, thickness) for number, wall in own})


def moved_walls(scene: Scene, now: Scene, time: float, thickness: float) -> dict[str, Band]:
    """Return the bands that draw the mobile walls of a scene at a time [s], by name.

    Walls with prescribed motions are where they are at that time. Walls that a force drives are where the
    scene `now` has them. For `thickness`, see `drawn_walls`.
    """
    own = ((number, wall) for number, wall in now.mobile_walls.items() if wall.image is None)
    return _by_name(scene, {number: _drawn(scene, wall.at(time), thickness) for number, wall in own})


def _drawn(scene: Scene, wall: Wall, thickness: float) -> Band:
    """Return the band that draws a wall; in a periodic box, with its periodic images."""
    if isinstance(wall, Row):
        return wall.drawn_about(scene.space_at(scene.time).outer_box.mean(axis=0))
    band, (x, y, reach) = wall.drawn(thickness), wall.circle
    if not scene.period or reach == np.inf:
        return band
    center = np.array([[x, y]])
    ways = scene.period.images(center, np.array([reach]))[0] - center
    most = 2 ** int(
        np.count_nonzero(scene.period.repeats)
    )  # a mesh has the same number of points at all times
    return band.copied(np.concatenate([ways, np.tile(ways[:1], (most - len(ways), 1))]))


def _by_name(scene: Scene, drawn: dict[int, Band]) -> dict[str, Band]:
    """Replace the numbers of walls, the keys of `drawn`, by names such as "Outer" or "Segment0".

    If the scene gives a wall its name, its number is added, because several walls may share a given name.
    """
    given = [f"_{k}" if wall.name else "" for k, wall in enumerate(scene.walls)]
    return {scene.wall_names[number] + given[number]: wall for number, wall in drawn.items()}


def _in_mark() -> BoolArray:
    """Return a mask of the 64 segments of a circle: those that belong to the mark of a grain."""
    return np.asarray((np.arange(_SEGMENTS) + _MARKED // 2) % _SEGMENTS < _MARKED)


def _circle(segments: int, radius: float, height: float) -> FloatArray:
    angle = np.arange(segments) * 2.0 * np.pi / segments
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(segments, height)], axis=1)


def _bands(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the quadrilaterals between successive rings of points, as point indices, shape (k, 4).

    `number` holds the indices of the points, a row for each ring, shape (rings, points of a ring).
    """
    onward = np.roll(number, -1, axis=1)
    corners = [number[:-1], number[1:], onward[1:], onward[:-1]]
    return np.stack(corners, axis=-1).reshape(-1, 4)
