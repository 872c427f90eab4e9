"""The grains of a recording: `UsdGeom.Points`, or instances of a sphere for viewers that draw no points."""

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from warpgrains.scene.scene import Scene
from warpgrains.usd.colors import Frame, GrainColors
from warpgrains.usd.values import covering_extent, triples, vec3f

GRAINS = Sdf.Path("/World/Grains")

_VELOCITIES = GRAINS.AppendProperty("velocities")
_EXTENT = GRAINS.AppendProperty("extent")
_COLOR = GRAINS.AppendProperty("primvars:displayColor")


class GrainPoints:
    """Grains as points with a width; `widths` are diameters."""

    _position = GRAINS.AppendProperty("points")

    def __init__(self, scene: Scene, colors: GrainColors) -> None:
        self._diameter = (2.0 * scene.radius).astype(np.float32)
        self._half_width = self._diameter.astype(np.float64) / 2.0
        self._colors = colors

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim and all that no frame changes."""
        grains = UsdGeom.Points.Define(stage, GRAINS)
        diameter = self._diameter
        all_equal = bool((diameter == diameter[0]).all())
        grains.CreateWidthsAttr(Vt.FloatArray.FromNumpy(diameter[:1] if all_equal else diameter))
        grains.SetWidthsInterpolation(UsdGeom.Tokens.constant if all_equal else UsdGeom.Tokens.vertex)
        grains.CreateIdsAttr(_ids(len(diameter)))
        grains.CreatePointsAttr()
        grains.CreateVelocitiesAttr()
        self._define_rest(stage)

    def samples(self, frame: Frame) -> dict[Sdf.Path, object]:
        """Return the value of each attribute that `frame` sets."""
        shown = triples(frame.position)
        sampled: dict[Sdf.Path, object] = {
            self._position: Vt.Vec3fArray.FromNumpy(shown),
            _VELOCITIES: vec3f(frame.velocity),
            _EXTENT: covering_extent(shown, self._half_width),
        }
        if self._colors.still is None:
            sampled[_COLOR] = Vt.Vec3fArray.FromNumpy(self._colors.of(frame))
        return sampled

    def _define_rest(self, stage: Usd.Stage) -> None:
        grains = UsdGeom.Boundable(stage.GetPrimAtPath(GRAINS))
        grains.CreateExtentAttr()
        color = UsdGeom.PrimvarsAPI(grains).CreatePrimvar(
            "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex
        )
        if self._colors.still is not None:
            color.Set(Vt.Vec3fArray.FromNumpy(self._colors.still))


class GrainSpheres(GrainPoints):
    """Grains as instances of one sphere of radius 1, scaled."""

    _position = GRAINS.AppendProperty("positions")

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim, the sphere and all that no frame changes."""
        grains = UsdGeom.PointInstancer.Define(stage, GRAINS)
        sphere = UsdGeom.Sphere.Define(stage, GRAINS.AppendChild("Sphere"))
        sphere.CreateRadiusAttr(1.0)
        sphere.CreateExtentAttr([(-1, -1, -1), (1, 1, 1)])
        count = len(self._diameter)
        grains.CreatePrototypesRel().SetTargets([sphere.GetPath()])
        grains.CreateProtoIndicesAttr(Vt.IntArray(count, 0))
        scales = np.repeat(self._half_width.astype(np.float32)[:, np.newaxis], 3, axis=1)
        grains.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(scales))
        grains.CreateIdsAttr(_ids(count))
        grains.CreatePositionsAttr()
        grains.CreateVelocitiesAttr()
        self._define_rest(stage)


def _ids(count: int) -> Vt.Int64Array:
    return Vt.Int64Array.FromNumpy(np.arange(count, dtype=np.int64))
