"""The walls of a recording: flat rings about the origin."""

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from warpgrains.drawing.rings import WALL_COLOR, rings
from warpgrains.drawing.shapes import ring
from warpgrains.scene.walls import Annulus
from warpgrains.usd.looks import define_mesh, set_kind

WALLS = Sdf.Path("/World/Walls")


def define_walls(stage: Usd.Stage, walls: Annulus) -> None:
    """Author the prims of the walls, outside the space that they leave to the grains."""
    set_kind(UsdGeom.Xform.Define(stage, WALLS).GetPrim(), "subcomponent")
    for name, (inner, outer) in rings(walls).items():
        define_mesh(stage, WALLS.AppendChild(name), ring(inner, outer), np.array(WALL_COLOR))


def reach_of(walls: Annulus) -> float:
    """Return how far from the origin the walls reach, as thick as they are drawn [m]."""
    return max(outer for _, outer in rings(walls).values())


def read_walls(stage: Usd.Stage) -> list[tuple[float, float]]:
    """Return inner and outer radius of each wall, as thick as it is drawn [m]."""
    walls = stage.GetPrimAtPath(WALLS).GetChildren()
    points = [np.array(wall.GetAttribute("points").Get(), dtype=np.float64) for wall in walls]
    return [(float(rho.min()), float(rho.max())) for rho in (np.hypot(*ring[:, :2].T) for ring in points)]
