"""Force chains in a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from warpgrains.drawing.chains import CHAIN_COLOR, ChainScale, chains_of
from warpgrains.drawing.colors import Frame
from warpgrains.usd.looks import bind_look
from warpgrains.usd.values import covering_extent, floats, triples

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

FORCES = Sdf.Path("/World/Forces")

GRAINS_OF = ("grain", "neighbour")
"""Primvars of a band: the grains of its contact, see `Chains.pair`."""

_GAP = 0.05  # to the grains behind, in their height


class ForceChains:
    """A mesh of bands just in front of the grains, `height` [m] high; primvars tell force [N] and grains."""

    def __init__(self, scene: Scene, height: float) -> None:
        self._scene = scene
        self._scale = ChainScale.of(scene)
        self._depth = (1.0 + _GAP) * height

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim and all that no frame changes."""
        bands = UsdGeom.Mesh.Define(stage, FORCES)
        bands.CreatePointsAttr()
        bands.CreateFaceVertexCountsAttr()
        bands.CreateFaceVertexIndicesAttr()
        bands.CreateExtentAttr()
        bands.CreateNormalsAttr([(0.0, 0.0, 1.0)])
        bands.SetNormalsInterpolation(UsdGeom.Tokens.constant)
        bands.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        bands.CreateDoubleSidedAttr(True)
        primvars = UsdGeom.PrimvarsAPI(bands)
        primvars.CreatePrimvar("force", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.uniform)
        for name in GRAINS_OF:
            primvars.CreatePrimvar(name, Sdf.ValueTypeNames.IntArray, UsdGeom.Tokens.uniform)
        bind_look(bands.GetPrim(), np.array(CHAIN_COLOR))

    def samples(self, frame: Frame) -> dict[Sdf.Path, object]:
        """Return the value of each attribute that `frame` sets."""
        chains = chains_of(self._scene, self._scale, frame)
        shown = triples(chains.corners().reshape(-1, 2))
        shown[:, 2] = self._depth
        sampled = {
            "points": Vt.Vec3fArray.FromNumpy(shown),
            "faceVertexCounts": Vt.IntArray(len(chains.force), 4),
            "faceVertexIndices": Vt.IntArray.FromNumpy(np.arange(len(shown), dtype=np.int32)),
            "primvars:force": floats(chains.force),
            **{
                f"primvars:{name}": Vt.IntArray.FromNumpy(np.ascontiguousarray(grains))
                for name, grains in zip(GRAINS_OF, chains.pair.T, strict=True)
            },
            "extent": covering_extent(shown, np.zeros(len(shown))) if len(shown) else Vt.Vec3fArray(2),
        }
        return {FORCES.AppendProperty(name): value for name, value in sampled.items()}
