"""The part of a recording that does not move: metadata, walls, camera, and what each drawing declares."""

from collections.abc import Iterable
from typing import Protocol

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, Vt

import warpgrains
from warpgrains.scene.scene import Scene
from warpgrains.usd.colors import Frame
from warpgrains.usd.values import vec3f

_WALL_COLOR = Gf.Vec3f(0.1, 0.1, 0.12)
_WALL_SEGMENTS = 256
_WALL_THICKNESS = 0.02  # of radius_out
_CAMERA_MARGIN = 1.05  # half-width of the picture, of the outer radius of the outer wall
_FOCAL_LENGTH = 50.0
_APERTURE = 24.0


class Drawing(Protocol):
    """Something that every frame shows: a prim whose values the frames set."""

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim and all that no frame changes."""

    def samples(self, frame: Frame) -> dict[Sdf.Path, object]:
        """Return the value of each attribute that `frame` sets."""


def static_layer(scene: Scene, rate: float, drawings: Iterable[Drawing]) -> Sdf.Layer:
    """Return an anonymous layer with everything that no frame changes.

    Parameters
    ----------
    scene : Scene
        What is recorded.
    rate : float
        Frames per second [1/s]; one frame is one time code.
    drawings : iterable of Drawing
        What the frames show.
    """
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    stage = Usd.Stage.Open(layer)
    _define_metadata(stage, scene, rate)
    for drawing in drawings:
        drawing.define(stage)
    _define_walls(stage, scene.radius_in, scene.radius_out)
    _define_camera(stage, scene.radius_out)
    return layer


def _define_metadata(stage: Usd.Stage, scene: Scene, rate: float) -> None:
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
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


def _define_walls(stage: Usd.Stage, radius_in: float, radius_out: float) -> None:
    UsdGeom.Xform.Define(stage, "/World/Walls")
    thickness = _WALL_THICKNESS * radius_out
    _define_ring(stage, "/World/Walls/Outer", radius_out, radius_out + thickness)
    if radius_in > 0:
        _define_ring(stage, "/World/Walls/Inner", max(radius_in - thickness, radius_in / 2), radius_in)


def _define_ring(stage: Usd.Stage, path: str, inner: float, outer: float) -> None:
    """Define the flat ring between two radii [m] in the plane z = 0, made of quadrilaterals facing +z."""
    angle = np.linspace(0.0, 2.0 * np.pi, _WALL_SEGMENTS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
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
    ring.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set(Vt.Vec3fArray([_WALL_COLOR]))


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
