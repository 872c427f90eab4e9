"""Walls and force chains in a recording."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from warpgrains.base.frame_log import Arrays
from warpgrains.drawing.chains import CHAIN_COLOR, ChainScale, all_contacts, chains_of
from warpgrains.drawing.painter import Painter
from warpgrains.drawing.shapes import WALL_COLOR, wall_mesh
from warpgrains.scene.snapshot import Snapshot
from warpgrains.usd.stage import as_float32, bind_material, covering_extent, define_mesh, set_kind, triples

WALLS = Sdf.Path("/World/Walls")
PLACES = "warpgrains:places"
"""Name of an attribute of `WALLS`: the coordinate of each wall [m], see `State.driven`.

Only recordings of scenes in which forces drive walls have it.
"""
THICKNESS = "warpgrains:thickness"
"""Name of an attribute of `WALLS`: the thickness with which they are drawn [m]."""
HEIGHT = "warpgrains:height"
"""Name of an attribute of `WALLS`: the height h of their meshes, which reach from z = -h to z = h [m]."""
FORCES = Sdf.Path("/World/Forces")
GRAINS_OF = ("grain", "neighbour")
"""Names of the primvars that hold i and j of the contact that a band shows, see `all_contacts`."""
TANGENTIAL = "primvars:tangential_force"
"""Name of the attribute that holds the tangential forces of contacts [N], in recordings with friction."""

_GAP = 0.05  # distance of force chains to the grains behind, in their height
_HIGHEST = 0.1  # height of walls, in half of the longer side of the view, up to which the camera shows all


class Walls:
    """The walls as meshes with a thickness, outside the space of the grains.

    They are as high as a grain of mean radius, but not higher than the view allows; `height` is the height of
    a grain of radius 1 m. Frames hold points, normals and extents of mobile walls.
    """

    def __init__(self, painter: Painter, height: float) -> None:
        self._painter, self._scene = painter, painter.scene
        self._height = min(height * float(self._scene.radius.mean()), _HIGHEST * painter.view.half)

    def define(self, stage: Usd.Stage) -> None:
        """Author the prims with their meshes at the start."""
        walls = UsdGeom.Xform.Define(stage, WALLS).GetPrim()
        set_kind(walls, "subcomponent")
        walls.CreateAttribute(THICKNESS, Sdf.ValueTypeNames.Double).Set(self._painter.thickness)
        walls.CreateAttribute(HEIGHT, Sdf.ValueTypeNames.Double).Set(self._height)
        if self._scene.has_driven_walls:
            walls.CreateAttribute(PLACES, Sdf.ValueTypeNames.DoubleArray)
        for name, wall in self._painter.walls.items():
            mesh = wall_mesh(wall, self._height)
            define_mesh(stage, WALLS.AppendChild(name), mesh, np.array(WALL_COLOR))

    def samples(self, now: Snapshot) -> Arrays:
        """Return the arrays of the mobile walls in a frame, by the USD path of the attribute."""
        values: dict[str, NDArray[Any]] = {}
        if now.places is not None:
            values[f"{WALLS}.{PLACES}"] = now.places
        for name, wall in self._painter.moved_walls(now.scene, now.time).items():
            mesh, path = wall_mesh(wall, self._height), WALLS.AppendChild(name)
            shown = as_float32("a point of a wall", mesh.points)
            values[f"{path}.points"] = shown
            values[f"{path}.normals"] = mesh.normals.astype(np.float32)
            values[f"{path}.extent"] = covering_extent(shown, np.zeros(len(shown)))
        return values


class ForceChains:
    """The force chains as a mesh of bands, just in front of grains of height `height` [m].

    Primvars of a band hold the forces [N] and the grains of its contact. A contact that leaves a periodic box
    has several bands.
    """

    def __init__(self, scale: ChainScale, height: float, has_friction: bool) -> None:
        self._scale, self._depth, self._has_friction = scale, (1.0 + _GAP) * height, has_friction

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim; all its arrays change with time."""
        bands, types = UsdGeom.Mesh.Define(stage, FORCES), Sdf.ValueTypeNames
        bands.CreatePointsAttr()
        bands.CreateFaceVertexCountsAttr()
        bands.CreateFaceVertexIndicesAttr()
        bands.CreateExtentAttr()
        bands.CreateNormalsAttr([(0.0, 0.0, 1.0)])
        bands.SetNormalsInterpolation(UsdGeom.Tokens.constant)
        bands.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        bands.CreateDoubleSidedAttr(True)
        primvars, forces = UsdGeom.PrimvarsAPI(bands), ["primvars:force"]
        if self._has_friction:
            forces.append(TANGENTIAL)
        for name in forces:
            primvars.CreatePrimvar(name, types.FloatArray, UsdGeom.Tokens.uniform)
        for name in GRAINS_OF:
            primvars.CreatePrimvar(name, types.IntArray, UsdGeom.Tokens.uniform)
        bind_material(bands.GetPrim(), np.array(CHAIN_COLOR))
        set_kind(bands.GetPrim(), "subcomponent")

    def samples(self, now: Snapshot) -> Arrays:
        """Return the arrays of the bands in a frame, by the USD path of the attribute."""
        pair, force, tangential = all_contacts(now)
        corners, _, contact = chains_of(self._scale, now)
        shown = triples("a corner of a force chain", corners.reshape(-1, 2))
        shown[:, 2] = self._depth
        extent = covering_extent(shown, np.zeros(len(shown))) if len(shown) else np.zeros((2, 3), np.float32)
        sampled = {
            "points": shown,
            "faceVertexCounts": np.full(len(contact), 4, np.int32),
            "faceVertexIndices": np.arange(len(shown), dtype=np.int32),
            "primvars:force": as_float32("a force", force[contact]),
            **{f"primvars:{name}": grain for name, grain in zip(GRAINS_OF, pair[contact].T, strict=True)},
            "extent": extent,
        }
        if self._has_friction:
            sampled[TANGENTIAL] = as_float32("a force", tangential[contact])
        return {f"{FORCES}.{name}": value for name, value in sampled.items()}
