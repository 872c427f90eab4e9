"""What a recording shows: the grains and force chains of every frame, and what stands still around them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Protocol

from pxr import Sdf, Usd, UsdGeom, UsdPhysics

import warpgrains
from warpgrains.drawing.colors import Frame
from warpgrains.frame_log import Arrays
from warpgrains.scene.document import parameters_text
from warpgrains.usd.looks import CAMERA, define_looks, set_kind
from warpgrains.usd.output import RECORDED_BY
from warpgrains.usd.walls import define_walls, reach_of

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene


class Drawing(Protocol):
    """Something that every frame shows: a prim whose values the frames set."""

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim and all that no frame changes."""

    def samples(self, frame: Frame) -> Arrays:
        """Return the value of each attribute that `frame` sets."""


def static_layer(
    scene: Scene, rate: float, drawings: Iterable[Drawing], scales: Mapping[str, dict[str, str | float]]
) -> Sdf.Layer:
    """Return an anonymous layer with everything that no frame changes, of so many frames a second [1/s].

    The scales of what is drawn stand in the layer's own data, beside the scene.
    """
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    stage = Usd.Stage.Open(layer)
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
    stage.SetDefaultPrim(world)
    set_kind(world, "component")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    version = warpgrains.__version__
    layer.documentation = f"Recorded by warpgrains {version} from the scene:\n\n{scene.text}"
    layer.customLayerData = {
        RECORDED_BY: {
            "version": version,
            "name": scene.name,
            "scene": scene.text,
            "parameters": parameters_text(scene),
            **scales,
        },
        "cameraSettings": {"boundCamera": str(CAMERA)},  # Omniverse looks through it
    }
    define_looks(stage, reach_of(scene.walls))
    for drawing in drawings:
        drawing.define(stage)
    define_walls(stage, scene.walls)
    return layer
