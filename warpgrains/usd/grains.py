"""Grains in a recording: instances of colored discs or spheres, or points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from warpgrains.arrays import IndexArray
from warpgrains.drawing.colormaps import linear
from warpgrains.drawing.colors import Frame, GrainColors, pressure
from warpgrains.frame_log import Arrays
from warpgrains.usd.looks import bind_look
from warpgrains.usd.shapes import Shape
from warpgrains.usd.values import covering_extent, triples

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

GRAINS = Sdf.Path("/World/Grains")

_PROTOTYPES = "Color{:02d}"


class GrainPoints:
    """Grains as `UsdGeom.Points`; their `widths` are diameters.

    Beside places, masses and velocities they have colors, and raw values as float primvars: the speed [m/s],
    where contacts are at hand the pressure [N/m], and the radius [m] where it gives the color.

    Parameters
    ----------
    scene : Scene
        What is drawn.
    colors : GrainColors or None
        None leaves out all that a long recording of many grains can do without: colors, velocities, values.
    has_contacts : bool
        Whether frames have contacts.
    """

    height = 1.0
    """How far a grain of radius 1 m reaches towards the viewer [m]."""
    _position = "points"

    def __init__(self, scene: Scene, colors: GrainColors | None, has_contacts: bool) -> None:
        self._radius, self._mass = scene.radius, scene.mass
        self._diameter = (2.0 * scene.radius).astype(np.float32)
        self._half_width = self._diameter.astype(np.float64) / 2.0
        self._colors = colors
        self._has_contacts = has_contacts

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim and all that no frame changes."""
        self._define_prim(stage)
        prim = stage.GetPrimAtPath(GRAINS)
        UsdGeom.Boundable(prim).CreateExtentAttr()
        ids = Vt.Int64Array.FromNumpy(np.arange(len(self._diameter), dtype=np.int64))
        primvars = UsdGeom.PrimvarsAPI(prim)
        mass = primvars.CreatePrimvar("mass", Sdf.ValueTypeNames.DoubleArray, UsdGeom.Tokens.vertex)
        mass.Set(Vt.DoubleArray.FromNumpy(self._mass))
        prim.CreateAttribute("ids", Sdf.ValueTypeNames.Int64Array, False).Set(ids)
        if self._colors is None:
            return
        prim.CreateAttribute("velocities", Sdf.ValueTypeNames.Vector3fArray, False)
        self._define_values(primvars, self._colors)
        if self._colors.still is not None:
            name, value = self._color(self._colors.still, self._colors)
            prim.GetAttribute(name).Set(value)

    def samples(self, frame: Frame) -> Arrays:
        """Return the value of each attribute that `frame` sets."""
        shown = triples(frame.position)
        values = {self._position: shown, "extent": covering_extent(shown, self._half_width)}
        if self._colors is not None:
            values["velocities"] = triples(frame.velocity)
            values["primvars:speed"] = np.hypot(*frame.velocity.T).astype(np.float32)
            if self._has_contacts:
                values["primvars:pressure"] = pressure(frame, self._radius).astype(np.float32)
            if self._colors.still is None:
                name, value = self._color(self._colors.levels(frame), self._colors)
                values[name] = value
        return {f"{GRAINS}.{name}": value for name, value in values.items()}

    def _define_prim(self, stage: Usd.Stage) -> None:
        grains = UsdGeom.Points.Define(stage, GRAINS)
        diameter = self._diameter
        all_equal = bool((diameter == diameter[0]).all())
        grains.CreateWidthsAttr(Vt.FloatArray.FromNumpy(diameter[:1] if all_equal else diameter))
        grains.SetWidthsInterpolation(UsdGeom.Tokens.constant if all_equal else UsdGeom.Tokens.vertex)
        grains.CreatePointsAttr()
        if self._colors is not None:
            grains.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
        bind_look(grains.GetPrim())

    def _define_values(self, primvars: UsdGeom.PrimvarsAPI, colors: GrainColors) -> None:
        names = ["speed"] + ["pressure"] * self._has_contacts
        for name in names:
            primvars.CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
        if colors.scale is not None and colors.scale.quantity == "radius":
            radius = primvars.CreatePrimvar("radius", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
            radius.Set(self._radius.astype(np.float32))

    def _color(self, levels: IndexArray, colors: GrainColors) -> tuple[str, NDArray[Any]]:
        """Return the attribute that holds the colors, and its value."""
        return "primvars:displayColor", linear(colors.colors)[levels]


class GrainInstances(GrainPoints):
    """Grains as instances of a shape of radius 1, scaled: one prototype a color.

    Thus every viewer that draws instances shows the colors; of points, Blender does not.
    """

    _position = "positions"

    def __init__(self, scene: Scene, colors: GrainColors, has_contacts: bool, shape: Shape) -> None:
        super().__init__(scene, colors, has_contacts)
        self.height = shape.height
        self._shape, self._all_colors = shape, colors.colors

    def _define_prim(self, stage: Usd.Stage) -> None:
        grains = UsdGeom.PointInstancer.Define(stage, GRAINS)
        for number, color in enumerate(self._all_colors):
            path = GRAINS.AppendChild(_PROTOTYPES.format(number))
            bind_look(self._shape.define(stage, path).GetPrim(), color)
            grains.CreatePrototypesRel().AddTarget(path)
        scales = np.repeat(self._half_width.astype(np.float32)[:, np.newaxis], 3, axis=1)
        grains.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(scales))
        grains.CreateProtoIndicesAttr()
        grains.CreatePositionsAttr()

    def _color(self, levels: IndexArray, colors: GrainColors) -> tuple[str, NDArray[Any]]:
        return "protoIndices", levels.astype(np.int32)
