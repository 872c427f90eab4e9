"""The shapes that stand for a grain of radius 1 m."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, Vt

from warpgrains.arrays import FloatArray

_SEGMENTS = 64  # of a circle about z: its polygon lacks 0.16 % of the disc
_RINGS = 16  # of a sphere, from pole to pole
_RIM = 0.88  # where the rim of a disc begins, in radii
_SLOPE = 2.0  # of the rim: shading draws a line between grains that touch


@dataclass(frozen=True)
class Shape:
    """A mesh of polygons with as many corners each as `counts` says."""

    points: FloatArray
    """[m], shape (v, 3)."""
    corners: NDArray[np.int64]
    """Of all polygons, one after the other, counter-clockwise from outside."""
    counts: NDArray[np.int64]
    is_smooth: bool

    @property
    def height(self) -> float:
        """How far it reaches towards the viewer [m]."""
        return float(self.points[:, 2].max())

    def define(self, stage: Usd.Stage, path: str) -> UsdGeom.Mesh:
        """Author the mesh."""
        mesh = UsdGeom.Mesh.Define(stage, path)
        points = Vt.Vec3fArray.FromNumpy(self.points.astype(np.float32))
        mesh.CreatePointsAttr(points)
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(self.counts.astype(np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(self.corners.astype(np.int32)))
        normals = self.points if self.is_smooth else np.repeat(self._face_normals(), self.counts, axis=0)
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32)))
        tokens = UsdGeom.Tokens
        mesh.SetNormalsInterpolation(tokens.vertex if self.is_smooth else tokens.faceVarying)
        mesh.CreateSubdivisionSchemeAttr(tokens.none)
        mesh.CreateDoubleSidedAttr(not self.is_smooth)
        mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
        return mesh

    def _face_normals(self) -> FloatArray:
        first = np.cumsum(self.counts) - self.counts
        a, b, c = (self.points[self.corners[first + corner]] for corner in range(3))
        normal = np.cross(b - a, c - a)
        return normal / np.linalg.norm(normal, axis=1)[:, np.newaxis]


def disc() -> Shape:
    """Return a disc that faces +z, with a sloping rim."""
    height = _SLOPE * (1.0 - _RIM)
    points = np.concatenate([_circle(_RIM, height), _circle(1.0, 0.0)])
    top = np.arange(_SEGMENTS)
    rim = _bands(top[np.newaxis] + np.array([[0], [_SEGMENTS]]))
    counts = np.concatenate([[_SEGMENTS], np.full(len(rim), 4)])
    return Shape(points, np.concatenate([top, rim.ravel()]), counts, is_smooth=False)


def sphere() -> Shape:
    """Return a sphere."""
    polar = np.linspace(0.0, np.pi, _RINGS + 1)[1:-1]
    rings = [_circle(np.sin(angle), np.cos(angle)) for angle in polar]
    points = np.concatenate([*rings, [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]])
    number = np.arange((_RINGS - 1) * _SEGMENTS).reshape(_RINGS - 1, _SEGMENTS)
    north, south = number.size, number.size + 1
    onward = np.roll(number, -1, axis=1)
    caps = np.concatenate(
        [
            np.stack([np.full(_SEGMENTS, north), number[0], onward[0]], axis=1),
            np.stack([np.full(_SEGMENTS, south), onward[-1], number[-1]], axis=1),
        ]
    )
    sides = _bands(number)
    counts = np.concatenate([np.full(len(caps), 3), np.full(len(sides), 4)])
    return Shape(points, np.concatenate([caps.ravel(), sides.ravel()]), counts, is_smooth=True)


def _circle(radius: float, height: float) -> FloatArray:
    angle = np.arange(_SEGMENTS) * 2.0 * np.pi / _SEGMENTS
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(_SEGMENTS, height)], axis=1)


def _bands(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the quadrilaterals between rings of points, numbered from top to bottom, shape (k, 4)."""
    onward = np.roll(number, -1, axis=1)
    corners = [number[:-1], number[1:], onward[1:], onward[:-1]]
    return np.stack(corners, axis=-1).reshape(-1, 4)
