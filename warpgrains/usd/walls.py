"""The walls of a recording: flat rings about the origin."""

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from warpgrains.drawing.rings import WALL_COLOR, rings
from warpgrains.scene.walls import Annulus
from warpgrains.usd.looks import bind_look, set_kind

WALLS = Sdf.Path("/World/Walls")

_SEGMENTS = 256


def define_walls(stage: Usd.Stage, walls: Annulus) -> None:
    """Author the prims of the walls, outside the space that they leave to the grains."""
    set_kind(UsdGeom.Xform.Define(stage, WALLS).GetPrim(), "subcomponent")
    for name, (inner, outer) in rings(walls).items():
        _define_ring(stage, WALLS.AppendChild(name), inner, outer)


def reach_of(walls: Annulus) -> float:
    """Return how far from the origin the walls reach, as thick as they are drawn [m]."""
    return max(outer for _, outer in rings(walls).values())


def read_walls(stage: Usd.Stage) -> list[tuple[float, float]]:
    """Return inner and outer radius of each wall, as thick as it is drawn [m]."""
    walls = stage.GetPrimAtPath(WALLS).GetChildren()
    points = [np.array(wall.GetAttribute("points").Get(), dtype=np.float64) for wall in walls]
    return [(float(rho.min()), float(rho.max())) for rho in (np.hypot(*ring[:, :2].T) for ring in points)]


def _define_ring(stage: Usd.Stage, path: Sdf.Path, inner: float, outer: float) -> None:
    """Define the flat ring between two radii [m] in the plane z = 0, made of quadrilaterals facing +z."""
    angle = np.linspace(0.0, 2.0 * np.pi, _SEGMENTS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    here = np.arange(_SEGMENTS, dtype=np.int32)
    onward = np.roll(here, -1)
    corners = np.stack([here, here + _SEGMENTS, onward + _SEGMENTS, onward], axis=1)
    places = np.zeros((2 * _SEGMENTS, 3), dtype=np.float32)
    places[:, :2] = np.concatenate([inner * circle, outer * circle])
    points = Vt.Vec3fArray.FromNumpy(places)
    ring = UsdGeom.Mesh.Define(stage, path)
    ring.CreatePointsAttr(points)
    ring.CreateFaceVertexCountsAttr(Vt.IntArray(_SEGMENTS, 4))
    ring.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(corners.ravel()))
    ring.CreateNormalsAttr(Vt.Vec3fArray(2 * _SEGMENTS, Gf.Vec3f(0, 0, 1)))
    ring.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    ring.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    ring.CreateDoubleSidedAttr(True)
    ring.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    bind_look(ring.GetPrim(), np.array(WALL_COLOR))
