"""The part of a recording that does not move: stage metadata, grains, walls and camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdPhysics, Vt

import warpgrains

if TYPE_CHECKING:
    from warpgrains.scene import Scene

GRAINS = Sdf.Path("/World/Grains")

_PALETTE = np.array(
    [
        (0.90, 0.62, 0.00),
        (0.34, 0.71, 0.91),
        (0.00, 0.62, 0.45),
        (0.94, 0.89, 0.26),
        (0.00, 0.45, 0.70),
        (0.84, 0.37, 0.00),
        (0.80, 0.47, 0.65),
    ],
    dtype=np.float32,
)  # Okabe and Ito's colours, told apart by colour-blind readers too
_WALL_COLOUR = Gf.Vec3f(0.35, 0.35, 0.38)
_WALL_SEGMENTS = 256
_WALL_THICKNESS = 0.02  # of radius_out
_CAMERA_MARGIN = 1.05  # picture's half-width, of the outer wall's outer radius
_FOCAL_LENGTH = 50.0
_APERTURE = 24.0


def define_stage(scene: Scene, rate: float) -> Usd.Stage:
    """Return an in-memory stage with everything of `scene` that no frame changes.

    Parameters
    ----------
    scene : Scene
        What is recorded.
    rate : float
        Frames per second [1/s]; one frame is one time code.
    """
    stage = Usd.Stage.CreateInMemory()
    _define_metadata(stage, scene, rate)
    _define_grains(stage, np.asarray(scene.radius))
    _define_walls(stage, scene.radius_in, scene.radius_out)
    _define_camera(stage, scene.radius_out)
    return stage


def _define_metadata(stage: Usd.Stage, scene: Scene, rate: float) -> None:
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
    Usd.ModelAPI(world).SetKind(Kind.Tokens.component)
    stage.SetDefaultPrim(world)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    layer = stage.GetRootLayer()
    layer.documentation = f"Recorded by warpgrains {warpgrains.__version__} from the scene:\n\n{scene.text}"
    layer.customLayerData = {
        "warpgrains": {"version": warpgrains.__version__, "name": scene.name, "scene": scene.text}
    }


def _define_grains(stage: Usd.Stage, radius: NDArray[np.float64]) -> None:
    grains = UsdGeom.Points.Define(stage, GRAINS)
    grains.CreateIdsAttr(Vt.Int64Array.FromNumpy(np.arange(len(radius), dtype=np.int64)))
    diameter = (2.0 * radius).astype(np.float32)
    all_equal = bool((diameter == diameter[0]).all())
    grains.CreateWidthsAttr(Vt.FloatArray.FromNumpy(diameter[:1] if all_equal else diameter))
    grains.SetWidthsInterpolation(UsdGeom.Tokens.constant if all_equal else UsdGeom.Tokens.vertex)
    colour = _PALETTE[np.arange(len(radius)) % len(_PALETTE)]
    grains.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(Vt.Vec3fArray.FromNumpy(colour))


def _define_walls(stage: Usd.Stage, radius_in: float, radius_out: float) -> None:
    UsdGeom.Xform.Define(stage, "/World/Walls")
    thickness = _WALL_THICKNESS * radius_out
    _define_ring(stage, "/World/Walls/Outer", radius_out, radius_out + thickness)
    if radius_in > 0:
        _define_ring(stage, "/World/Walls/Inner", max(radius_in - thickness, radius_in / 2), radius_in)


def _define_ring(stage: Usd.Stage, path: str, inner: float, outer: float) -> None:
    """Define the flat ring between two radii [m] in the plane z = 0, made of quadrilaterals facing +z."""
    angle = np.linspace(0.0, 2.0 * np.pi, _WALL_SEGMENTS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    here = np.arange(_WALL_SEGMENTS, dtype=np.int32)
    onward = np.roll(here, -1)
    corners = np.stack([here, here + _WALL_SEGMENTS, onward + _WALL_SEGMENTS, onward], axis=1)
    points = vec3f(np.concatenate([inner * circle, outer * circle]))
    ring = UsdGeom.Mesh.Define(stage, path)
    ring.CreatePointsAttr(points)
    ring.CreateFaceVertexCountsAttr(Vt.IntArray(_WALL_SEGMENTS, 4))
    ring.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(corners.ravel()))
    ring.CreateNormalsAttr(Vt.Vec3fArray(2 * _WALL_SEGMENTS, Gf.Vec3f(0, 0, 1)))
    ring.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    ring.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    ring.CreateDoubleSidedAttr(True)
    ring.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    ring.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set(Vt.Vec3fArray([_WALL_COLOUR]))


def _define_camera(stage: Usd.Stage, radius_out: float) -> None:
    """Define a perspective camera on the z axis: Blender misreads the aperture of an orthographic one."""
    half_width = _CAMERA_MARGIN * (1.0 + _WALL_THICKNESS) * radius_out
    distance = half_width * 2.0 * _FOCAL_LENGTH / _APERTURE
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, distance))
    camera.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    camera.CreateFocalLengthAttr(_FOCAL_LENGTH)
    camera.CreateHorizontalApertureAttr(_APERTURE)
    camera.CreateVerticalApertureAttr(_APERTURE)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01 * distance, 10.0 * distance))


def vec3f(values: NDArray[Any]) -> Vt.Vec3fArray:
    """Return values, shape (n, 2) or (n, 3), as USD's float triples; a missing third component is 0."""
    triples = np.zeros((len(values), 3), dtype=np.float32)
    triples[:, : values.shape[1]] = values
    return Vt.Vec3fArray.FromNumpy(triples)
