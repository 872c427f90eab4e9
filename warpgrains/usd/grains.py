"""Grains in a recording: points, or instances of discs or spheres."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.base.frame_log import Arrays
from warpgrains.drawing.colorings import colorings_of
from warpgrains.drawing.colors import linear
from warpgrains.drawing.painter import Painter
from warpgrains.drawing.shapes import Shape
from warpgrains.scene.snapshot import Snapshot
from warpgrains.usd.stage import as_float32, bind_material, covering_extent, define_mesh, set_kind, triples

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

GRAINS = Sdf.Path("/World/Grains")
PROTOTYPES = Sdf.Path("/World/Prototypes")
"""Prim that contains the prototypes, the meshes that instances repeat. It is a class, so it is not drawn."""
COLOR_INDICES = "primvars:displayColor:indices"
OF_GRAINS = {"mass": "warpgrains:mass", "radius": "warpgrains:radius"}
"""Names of the attributes that hold fields of the scene as doubles, by the name of the field.

The same fields are also stored as primvars of floats. Primvars of doubles would hide all later ones in
Blender.
"""
PERIODS = "warpgrains:periods"
"""Name of an attribute of grains in a periodic box, which draws all grains within the box.

It holds integers, shape (n, 2): position of the grain = drawn position + integers * lengths of the box.
"""
ID = "primvars:id"
ANGLE = "angle"
VELOCITIES = "velocities"

ORIENTATIONS = "orientations"
"""Name of the attribute of the orientations of instances, quaternions of half precision.

As NumPy arrays, their components are (x, y, z, w).
"""

_MOST_PROTOTYPES = 16


class Grains:
    """Grains as `UsdGeom.Points`, or as instances of a shape of radius 1, rotated if there is friction.

    The `widths` of points are diameters [m]. Colors are indices into a table. Blender does not read primvars
    of an instancer. Therefore an instance also has one of 16 prototypes, which have the mean colors of 16
    ranges of the table. Velocities [m/s] are divided by `slow`, as the recording is played. Further primvars
    hold the mass [kg], with friction the angle [rad], and the quantities of `COLORINGS`.

    `ids` number the grains of a run in the order in which they appear. The primvar `id` is the same, because
    Blender does not read `ids`. In a periodic box, a grain that crosses a side is also drawn at the opposite
    side; these images follow all grains in the arrays. If grains have images, come or go, the length of
    arrays changes, so every frame holds all arrays.
    """

    def __init__(self, painter: Painter, shape: Shape | None, slow: float) -> None:
        scene = self._scene = painter.scene
        self.height = 1.0 if shape is None else shape.height
        """Extent of a grain of radius 1 m towards the viewer [m]."""
        self._shape, self._colors, self._rotates = shape, painter.colors, scene.has_friction
        self._slow = slow
        self._position = "points" if shape is None else "positions"
        width = _widths(scene)
        self._are_equal = not scene.exchanges_grains and bool((width == width[0]).all())
        self._shared = -(-len(self._colors.colors) // _MOST_PROTOTYPES)
        found = colorings_of(scene, painter.needs_contacts)
        self._changing = {name: own.values for name, own in found.items() if own.changes}
        if self._rotates:
            self._changing[ANGLE] = lambda now: now.angle
        self._is_periodic, self._is_open = bool(scene.period), scene.exchanges_grains

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim and all arrays that do not change."""
        prim = self._points(stage) if self._shape is None else self._instancer(stage, self._shape)
        set_kind(prim, "subcomponent")
        UsdGeom.Boundable(prim).CreateExtentAttr()
        types = Sdf.ValueTypeNames
        prim.CreateAttribute("ids", types.Int64Array, False)
        prim.CreateAttribute(VELOCITIES, types.Vector3fArray, False)
        if self._is_periodic:
            prim.CreateAttribute(PERIODS, types.Int2Array)
        primvars, vertex = UsdGeom.PrimvarsAPI(prim), UsdGeom.Tokens.vertex
        primvars.CreatePrimvar(ID, types.IntArray, vertex)
        color = primvars.CreatePrimvar("displayColor", types.Color3fArray, vertex)
        color.Set(Vt.Vec3fArray.FromNumpy(linear(self._colors.colors)))
        color.CreateIndicesAttr()
        for name, attribute in OF_GRAINS.items():
            own = prim.CreateAttribute(attribute, types.DoubleArray)
            if not self._is_open:
                own.Set(Vt.DoubleArray.FromNumpy(getattr(self._scene, name)))
            primvars.CreatePrimvar(name, types.FloatArray, vertex)
        for name in self._changing:
            primvars.CreatePrimvar(name, types.FloatArray, vertex)
        number = np.arange(self._scene.n)
        still = {} if self._is_open else self._still(self._scene, number, number)
        if self._colors.still is not None:
            still |= self._color(self._colors.still)
        for name, array in still.items():
            own = prim.GetAttribute(name)
            own.Set(type(own.GetTypeName().defaultValue).FromNumpy(array))

    def samples(self, now: Snapshot) -> Arrays:
        """Return the arrays of a frame, by the USD path of the attribute."""
        places, number = now.images
        shown = triples("the position of a grain", places)
        found = {name: values(now)[number] for name, values in self._changing.items()}
        values: dict[str, NDArray[Any]] = {
            self._position: shown,
            "extent": covering_extent(shown, _widths(now.scene)[number].astype(np.float64) / 2.0),
            VELOCITIES: triples("the velocity of a grain", now.velocity[number] / self._slow),
            **{f"primvars:{name}": as_float32(f"the {name} of a grain", own) for name, own in found.items()},
        }
        if self._rotates and self._shape is not None:
            values[ORIENTATIONS] = quaternions(now.angle[number])
        if self._colors.scale is not None and self._colors.scale.quantity in found:
            values |= self._color(self._colors.scale.levels(found[self._colors.scale.quantity]))
        elif self._is_periodic or self._is_open:
            values |= self._color(self._colors.levels(now)[number])
        if self._is_periodic:
            lengths = np.where(now.scene.period.repeats, now.scene.period.lengths, np.inf)
            values[PERIODS] = np.rint((now.position - places[: now.n]) / lengths).astype(np.int32)
        if self._is_periodic or self._is_open:
            values |= self._still(now.scene, now.id, number)
        if self._is_open:
            values |= {attribute: getattr(now.scene, name) for name, attribute in OF_GRAINS.items()}
        return {f"{GRAINS}.{name}": value for name, value in values.items()}

    def _still(self, scene: Scene, born: IndexArray, number: IndexArray) -> dict[str, NDArray[Any]]:
        """Return ids, masses, radii and sizes of all drawn grains, by attribute, shape (k,).

        First come the n grains of `scene`, then images of some of them; `number` holds the index of each in
        `scene`, shape (k,). `born` holds the ids of the n grains, shape (n,). Images have larger ids.
        """
        images = born[-1] + 1 + np.arange(len(number) - len(born))
        ids = np.concatenate([born, images])
        values: dict[str, NDArray[Any]] = {"ids": ids, ID: ids.astype(np.int32)}
        for name in OF_GRAINS:
            own = as_float32(f"the {name} of a grain", getattr(scene, name))
            values[f"primvars:{name}"] = own[number]
        width = _widths(scene)[number]
        if self._shape is not None:
            values["scales"] = np.repeat((0.5 * width)[:, np.newaxis], 3, axis=1)
        elif not self._are_equal:
            values["widths"] = width
        return values

    def _color(self, levels: IndexArray) -> dict[str, NDArray[Any]]:
        """Return the USD attributes that color grains, by name: `levels` as color indices, shape (n,).

        If grains are instances of meshes, the indices of their prototypes are added.
        """
        index = {COLOR_INDICES: levels} | (
            {} if self._shape is None else {"protoIndices": levels // self._shared}
        )
        return {name: value.astype(np.int32) for name, value in index.items()}

    def _points(self, stage: Usd.Stage) -> Usd.Prim:
        grains = UsdGeom.Points.Define(stage, GRAINS)
        grains.CreateWidthsAttr(Vt.FloatArray.FromNumpy(_widths(self._scene)[:1]))
        grains.SetWidthsInterpolation(UsdGeom.Tokens.constant if self._are_equal else UsdGeom.Tokens.vertex)
        grains.CreatePointsAttr()
        bind_material(grains.GetPrim())
        return grains.GetPrim()

    def _instancer(self, stage: Usd.Stage, shape: Shape) -> Usd.Prim:
        grains = UsdGeom.PointInstancer.Define(stage, GRAINS)
        UsdGeom.Scope(stage.CreateClassPrim(PROTOTYPES)).GetPrim().SetTypeName("Scope")
        colors = self._colors.colors
        for first in range(0, len(colors), self._shared):
            path = PROTOTYPES.AppendChild(f"Color{first // self._shared:02d}")
            define_mesh(stage, path, shape, colors[first : first + self._shared].mean(axis=0))
            grains.CreatePrototypesRel().AddTarget(path)
        grains.CreateScalesAttr()
        grains.CreateProtoIndicesAttr()
        grains.CreatePositionsAttr()
        if self._rotates:
            grains.CreateOrientationsAttr()
        return grains.GetPrim()


def _widths(scene: Scene) -> NDArray[np.float32]:
    """Return the diameters of the grains [m], shape (n,)."""
    return (2.0 * scene.radius).astype(np.float32)


def position_of(grains: Usd.Prim) -> Usd.Attribute:
    """Return the attribute that holds the centers of the grains."""
    return grains.GetAttribute("points" if grains.IsA(UsdGeom.Points) else "positions")


def numbers_of(grains: Usd.Prim) -> dict[str, Usd.Attribute]:
    """Return the primvars that hold a number per grain, by name: all but those of color and id."""
    primvars = UsdGeom.PrimvarsAPI(grains).GetPrimvarsWithAuthoredValues()
    names = {primvar.GetPrimvarName(): primvar.GetAttr() for primvar in primvars}
    return {name: attribute for name, attribute in names.items() if name not in ("displayColor", "id")}


def quaternions(angle: FloatArray) -> NDArray[np.float32]:
    """Return rotations about z by angles [rad], shape (n,), as quaternions (x, y, z, w), shape (n, 4)."""
    half, zero = 0.5 * angle, np.zeros_like(angle)
    return np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1).astype(np.float32)
