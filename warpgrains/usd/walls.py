"""Walls in a recording: meshes, some of which move, and their reader."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from warpgrains.drawing.frames import Frame
from warpgrains.drawing.shapes import WALL_COLOR, drawn_walls, moved_walls, wall_mesh
from warpgrains.frame_log import Arrays
from warpgrains.scene.band import Band
from warpgrains.usd.stage import as_float32, covering_extent, define_mesh, numbers, set_kind

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

WALLS = Sdf.Path("/World/Walls")
PLACES = "warpgrains:places"
"""Attribute of `WALLS` in scenes with driven walls: the coordinates of all walls [m], see `State.driven`."""


class Walls:
    """The walls, which lie outside the space of the grains. Frames hold points and extents of mobile ones."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self._drawn = scene, drawn_walls(scene)

    def define(self, stage: Usd.Stage) -> None:
        """Author the prims, completely if the walls are not mobile."""
        walls = UsdGeom.Xform.Define(stage, WALLS).GetPrim()
        set_kind(walls, "subcomponent")
        if self._scene.has_driven_walls:
            walls.CreateAttribute(PLACES, Sdf.ValueTypeNames.DoubleArray)
        for name, wall in self._drawn.items():
            define_mesh(stage, WALLS.AppendChild(name), wall_mesh(wall), np.array(WALL_COLOR))

    def samples(self, frame: Frame) -> Arrays:
        values = dict[str, NDArray[Any]]()
        if frame.places is not None:
            values[f"{WALLS}.{PLACES}"] = frame.places
        for name, wall in moved_walls(self._scene, frame.time, frame.places).items():
            shown, path = as_float32("a point of a wall", wall_mesh(wall).points), WALLS.AppendChild(name)
            values[f"{path}.points"] = shown
            values[f"{path}.extent"] = covering_extent(shown, np.zeros(len(shown)))
        return values


def read_walls(stage: Usd.Stage, code: float = 0.0, *, only_mobile: bool = False) -> dict[str, Band]:
    """Return the walls as drawn at a time code, or only the mobile ones, by name, as `drawn_walls` does."""
    found = {}
    for wall in stage.GetPrimAtPath(WALLS).GetChildren():
        points = wall.GetAttribute("points")
        if not only_mobile or points.GetNumTimeSamples() > 0:
            first, second = np.split(numbers(points, code)[:, :2], 2)
            quads = len(wall.GetAttribute("faceVertexCounts").Get(code))
            found[wall.GetName()] = Band(first, second, is_closed=quads == len(first))
    return found
