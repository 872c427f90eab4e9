"""The part of a recording that does not move: metadata, walls, camera, and what each drawing declares."""

from collections.abc import Iterable
from typing import Protocol

from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

import warpgrains
from warpgrains.scene.scene import Scene
from warpgrains.usd.colors import Frame
from warpgrains.usd.output import RECORDED_BY
from warpgrains.usd.walls import define_walls, half_width

_CAMERA_MARGIN = 1.05  # half-width of the picture, in that of the walls
_FOCAL_LENGTH = 50.0
_APERTURE = 24.0


class Drawing(Protocol):
    """Something that every frame shows: a prim whose values the frames set."""

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim and all that no frame changes."""

    def samples(self, frame: Frame) -> dict[Sdf.Path, object]:
        """Return the value of each attribute that `frame` sets."""


def static_layer(scene: Scene, rate: float, drawings: Iterable[Drawing]) -> Sdf.Layer:
    """Return an anonymous layer with everything that no frame changes, of so many frames a second [1/s]."""
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    stage = Usd.Stage.Open(layer)
    _define_metadata(stage, scene, rate)
    for drawing in drawings:
        drawing.define(stage)
    define_walls(stage, scene.walls)
    _define_camera(stage, half_width(scene.walls, _CAMERA_MARGIN))
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
        RECORDED_BY: {"version": warpgrains.__version__, "name": scene.name, "scene": scene.text}
    }


def _define_camera(stage: Usd.Stage, shown: float) -> None:
    """Define a perspective camera on the z axis: Blender misreads the aperture of an orthographic one."""
    distance = shown * 2.0 * _FOCAL_LENGTH / _APERTURE
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, distance))
    camera.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    camera.CreateFocalLengthAttr(_FOCAL_LENGTH)
    camera.CreateHorizontalApertureAttr(_APERTURE)
    camera.CreateVerticalApertureAttr(_APERTURE)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01 * distance, 10.0 * distance))
