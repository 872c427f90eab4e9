"""What a recording shows: the grains and force chains of every frame, and what stands still around them."""

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, Vt

import warpgrains
from warpgrains.scene.scene import Scene
from warpgrains.scene.walls import outward
from warpgrains.usd.colors import Frame, GrainColors, force_scale
from warpgrains.usd.output import RECORDED_BY
from warpgrains.usd.walls import define_walls, half_width

GRAINS = Sdf.Path("/World/Grains")
FORCES = Sdf.Path("/World/Forces")

_FORCE_COLOR = Gf.Vec3f(0.6, 0.01, 0.02)
_CAMERA_MARGIN = 1.05  # half-width of the picture, in that of the walls
_FOCAL_LENGTH = 50.0
_APERTURE = 24.0
_INFINITY = np.float32(np.inf)


class Drawing(Protocol):
    """Something that every frame shows: a prim whose values the frames set."""

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim and all that no frame changes."""

    def samples(self, frame: Frame) -> dict[Sdf.Path, object]:
        """Return the value of each attribute that `frame` sets."""


class GrainPoints:
    """Grains as `UsdGeom.Points`; their `widths` are diameters."""

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
        grains.CreateIdsAttr(self._ids())
        grains.CreatePointsAttr()
        grains.CreateVelocitiesAttr()
        self._define_rest(stage)

    def samples(self, frame: Frame) -> dict[Sdf.Path, object]:
        """Return the value of each attribute that `frame` sets."""
        shown = triples(frame.position)
        sampled: dict[Sdf.Path, object] = {
            self._position: Vt.Vec3fArray.FromNumpy(shown),
            GRAINS.AppendProperty("velocities"): Vt.Vec3fArray.FromNumpy(triples(frame.velocity)),
            GRAINS.AppendProperty("extent"): covering_extent(shown, self._half_width),
        }
        if self._colors.still is None:
            color = GRAINS.AppendProperty("primvars:displayColor")
            sampled[color] = Vt.Vec3fArray.FromNumpy(self._colors.of(frame))
        return sampled

    def _ids(self) -> Vt.Int64Array:
        return Vt.Int64Array.FromNumpy(np.arange(len(self._diameter), dtype=np.int64))

    def _define_rest(self, stage: Usd.Stage) -> None:
        grains = UsdGeom.Boundable(stage.GetPrimAtPath(GRAINS))
        grains.CreateExtentAttr()
        color = UsdGeom.PrimvarsAPI(grains).CreatePrimvar(
            "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex
        )
        if self._colors.still is not None:
            color.Set(Vt.Vec3fArray.FromNumpy(self._colors.still))


class GrainSpheres(GrainPoints):
    """Grains as instances of one sphere of radius 1, scaled, for viewers that draw no points."""

    _position = GRAINS.AppendProperty("positions")

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim, the sphere and all that no frame changes."""
        grains = UsdGeom.PointInstancer.Define(stage, GRAINS)
        sphere = UsdGeom.Sphere.Define(stage, GRAINS.AppendChild("Sphere"))
        sphere.CreateRadiusAttr(1.0)
        sphere.CreateExtentAttr([(-1, -1, -1), (1, 1, 1)])
        grains.CreatePrototypesRel().SetTargets([sphere.GetPath()])
        grains.CreateProtoIndicesAttr(Vt.IntArray(len(self._diameter), 0))
        scales = np.repeat(self._half_width.astype(np.float32)[:, np.newaxis], 3, axis=1)
        grains.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(scales))
        grains.CreateIdsAttr(self._ids())
        grains.CreatePositionsAttr()
        grains.CreateVelocitiesAttr()
        self._define_rest(stage)


class ForceChains:
    """Segments from centre to centre, and from centre to wall, in a plane just in front of the grains.

    A segment is as wide as the smallest grain when its force is `force_scale`, and proportionally
    narrower; it is never wider than the smallest grain.
    """

    def __init__(self, scene: Scene) -> None:
        self._radius = scene.radius
        self._scale = force_scale(scene)
        self._widest = 2.0 * float(scene.radius.min())
        self._depth = 1.05 * float(scene.radius.max())

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim and all that no frame changes."""
        chains = UsdGeom.BasisCurves.Define(stage, FORCES)
        chains.CreateTypeAttr(UsdGeom.Tokens.linear)
        chains.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
        chains.CreatePointsAttr()
        chains.CreateCurveVertexCountsAttr()
        chains.CreateWidthsAttr()
        chains.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
        chains.CreateExtentAttr()
        chains.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set(Vt.Vec3fArray([_FORCE_COLOR]))

    def samples(self, frame: Frame) -> dict[Sdf.Path, object]:
        """Return the value of each attribute that `frame` sets."""
        ends, force = self._segments(frame)
        width = np.minimum(force / self._scale, 1.0) * self._widest
        width = np.repeat(width.astype(np.float32), 2)
        shown = triples(ends.reshape(-1, 2))
        shown[:, 2] = self._depth
        half_width = width.astype(np.float64) / 2.0
        sampled = {
            "points": Vt.Vec3fArray.FromNumpy(shown),
            "curveVertexCounts": Vt.IntArray(len(force), 2),
            "widths": Vt.FloatArray.FromNumpy(width),
            "extent": covering_extent(shown, half_width) if len(force) else Vt.Vec3fArray(2),
        }
        return {FORCES.AppendProperty(name): value for name, value in sampled.items()}

    def _segments(self, frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return both ends [m], shape (m, 2, 2), and force [N], shape (m,), of each contact that pushes."""
        contacts, wall_contacts = frame.forces()
        pushes = contacts.force > 0.0
        between = frame.position[contacts.pair[pushes]]
        leaning = np.flatnonzero(wall_contacts.force)
        wall_force = wall_contacts.force[leaning]
        centre = frame.position[leaning]
        reach = np.sign(wall_force) * self._radius[leaning]
        foot = centre + reach[:, np.newaxis] * outward(centre)
        ends = np.concatenate([between, np.stack([centre, foot], axis=1)])
        return ends, np.concatenate([contacts.force[pushes], np.abs(wall_force)])


def triples(values: NDArray[Any]) -> NDArray[np.float32]:
    """Return values, shape (n, 2), as the file shows them: float32, shape (n, 3), the third component 0."""
    shown = np.zeros((len(values), 3), dtype=np.float32)
    shown[:, :2] = values
    return shown


def covering_extent(shown: NDArray[np.float32], half_width: NDArray[np.float64]) -> Vt.Vec3fArray:
    """Return the float32 box [m] that covers spheres, rounded outwards.

    Centres [m], shape (n, 3), n >= 1, and half the widths [m], shape (n,), are as the file shows them.
    """
    edges = np.empty((3, len(shown)))  # a row a component: NumPy reduces long rows much faster
    box = np.empty((2, 3), dtype=np.float32)
    low = np.subtract(shown.T, half_width, out=edges).min(axis=1)
    np.nextafter(low.astype(np.float32), -_INFINITY, out=box[0])
    high = np.add(shown.T, half_width, out=edges).max(axis=1)
    np.nextafter(high.astype(np.float32), _INFINITY, out=box[1])
    return Vt.Vec3fArray.FromNumpy(box)


def static_layer(scene: Scene, rate: float, drawings: Iterable[Drawing]) -> Sdf.Layer:
    """Return an anonymous layer with everything that no frame changes, of so many frames a second [1/s]."""
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    stage = Usd.Stage.Open(layer)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    version = warpgrains.__version__
    layer.documentation = f"Recorded by warpgrains {version} from the scene:\n\n{scene.text}"
    layer.customLayerData = {RECORDED_BY: {"version": version, "name": scene.name, "scene": scene.text}}
    for drawing in drawings:
        drawing.define(stage)
    define_walls(stage, scene.walls)
    _define_camera(stage, half_width(scene.walls, _CAMERA_MARGIN))
    return layer


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
