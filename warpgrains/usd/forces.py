"""Force chains: one segment a contact, as wide as its force."""

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from warpgrains.scene.scene import Scene
from warpgrains.scene.walls import outward
from warpgrains.usd.colors import Frame, force_scale
from warpgrains.usd.values import covering_extent, triples

FORCES = Sdf.Path("/World/Forces")

_POINTS = FORCES.AppendProperty("points")
_COUNTS = FORCES.AppendProperty("curveVertexCounts")
_WIDTHS = FORCES.AppendProperty("widths")
_EXTENT = FORCES.AppendProperty("extent")

_COLOR = Gf.Vec3f(0.6, 0.01, 0.02)


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
        chains.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set(Vt.Vec3fArray([_COLOR]))

    def samples(self, frame: Frame) -> dict[Sdf.Path, object]:
        """Return the value of each attribute that `frame` sets."""
        ends, force = self._segments(frame)
        width = np.minimum(force / self._scale, 1.0) * self._widest
        width = np.repeat(width.astype(np.float32), 2)
        shown = triples(ends.reshape(-1, 2))
        shown[:, 2] = self._depth
        half_width = width.astype(np.float64) / 2.0
        return {
            _POINTS: Vt.Vec3fArray.FromNumpy(shown),
            _COUNTS: Vt.IntArray(len(force), 2),
            _WIDTHS: Vt.FloatArray.FromNumpy(width),
            _EXTENT: covering_extent(shown, half_width) if len(force) else Vt.Vec3fArray(2),
        }

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
