"""Force chains in a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from warpgrains.drawing.chains import CHAIN_COLOR, Chains, ChainScale, chains_of
from warpgrains.drawing.frames import Frame
from warpgrains.frame_log import Arrays
from warpgrains.usd.stage import as_float32, bind_material, covering_extent, numbers, set_kind, triples

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

FORCES = Sdf.Path("/World/Forces")

GRAINS_OF = ("grain", "neighbour")
"""Primvars of a band: the grains of its contact, see `Chains.pair`."""
TANGENTIAL = "primvars:tangential_force"
"""The attribute of the tangential forces [N], in recordings with friction."""

_GAP = 0.05  # distance to the grains behind, in their height


class ForceChains:
    """A mesh of bands just in front of grains of `height` [m]. Primvars hold force [N] and grains."""

    def __init__(self, scene: Scene, scale: ChainScale, height: float) -> None:
        self._scene, self._scale = scene, scale
        self._depth = (1.0 + _GAP) * height

    def define(self, stage: Usd.Stage) -> None:
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
        if self._scene.has_friction:
            primvars.CreatePrimvar(
                TANGENTIAL.removeprefix("primvars:"), Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.uniform
            )
        for name in GRAINS_OF:
            primvars.CreatePrimvar(name, Sdf.ValueTypeNames.IntArray, UsdGeom.Tokens.uniform)
        bind_material(bands.GetPrim(), np.array(CHAIN_COLOR))
        set_kind(bands.GetPrim(), "subcomponent")

    def samples(self, frame: Frame) -> Arrays:
        chains = chains_of(self._scene, self._scale, frame)
        shown = triples("a corner of a force chain", chains.corners().reshape(-1, 2))
        shown[:, 2] = self._depth
        grains = zip(GRAINS_OF, chains.pair.T, strict=True)
        sampled = {
            "points": shown,
            "faceVertexCounts": np.full(len(chains.force), 4, np.int32),
            "faceVertexIndices": np.arange(len(shown), dtype=np.int32),
            "primvars:force": as_float32("a force", chains.force),
            **{f"primvars:{name}": number for name, number in grains},
            "extent": covering_extent(shown, np.zeros(len(shown)))
            if len(shown)
            else np.zeros((2, 3), np.float32),
        }
        if self._scene.has_friction:
            sampled[TANGENTIAL] = as_float32("a force", chains.tangential_force)
        return {f"{FORCES}.{name}": value for name, value in sampled.items()}


def read_chains(stage: Usd.Stage, code: float) -> Chains:
    bands = stage.GetPrimAtPath(FORCES)
    corners = numbers(bands.GetAttribute("points"), code).reshape(-1, 4, 3)[:, :, :2]
    force = numbers(bands.GetAttribute("primvars:force"), code)
    tangential = bands.GetAttribute(TANGENTIAL)
    tangential_force = numbers(tangential, code) if tangential else np.zeros_like(force)
    pair = np.stack([numbers(bands.GetAttribute(f"primvars:{name}"), code) for name in GRAINS_OF], axis=1)
    return Chains.of_corners(corners, force, tangential_force, pair.astype(np.int32))
