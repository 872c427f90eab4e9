"""Why a step failed, in words, with the grains that cannot fit where that is proved."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from warpgrains.kernels.record import NOT_CONVERGED, NOT_FINITE
from warpgrains.solver.infeasible import InfeasibilityProof, find_infeasibility_proof
from warpgrains.solver.statistics import named

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.scene_memory import SceneMemory


def reason(scene: Scene, memory: SceneMemory, outcome: int) -> str:
    """Say why the step that a scene is amid failed with such an outcome."""
    if outcome == NOT_CONVERGED:
        return _not_converged(scene, memory)
    grain = int(memory.record["verlet"]["flags"]["bad_grain"])
    velocity = memory.array("grains.next_velocity")[grain].tolist()
    reached = f"grain {grain} reached a velocity of {velocity} m/s"
    if outcome == NOT_FINITE:
        return f"{reached}: {_excess(scene, velocity)}"
    circle = scene.radius_out - scene.radius[grain].item()
    return (
        f"{reached} along the round wall: in a step of {scene.dt} s, it leaves the circle of {circle} m on"
        " which it touches the wall"
    )


def _excess(scene: Scene, velocity: list[float]) -> str:
    """Say why a step cannot move a grain with such a velocity [m/s]."""
    if not all(map(isfinite, velocity)):
        return "it is not finite"
    path = scene.dt * max(map(abs, velocity))
    return (
        f"in a step of {scene.dt} s it would move by {path:.3g} m, out of the domain of radius"
        f" {scene.radius_out} m, and the square of that is not finite"
    )


def _not_converged(scene: Scene, memory: SceneMemory) -> str:
    proof = find_proof(scene, memory, "position", "next_velocity")
    grains = "" if proof is None else f": {named(proof.grains)} cannot fit, {proof}"
    iterations, zeta, residual = (
        memory.record["step"][name].item() for name in ("iterations", "zeta", "residual")
    )
    return (
        f"not converged after {iterations} iterations: zeta {zeta:.3e} m/s, residual {residual:.3e} m/s,"
        f" tolerance {scene.tolerance:.3e} m/s{grains}"
    )


def find_proof(scene: Scene, memory: SceneMemory, position: str, velocity: str) -> InfeasibilityProof | None:
    """Look for a proof that no velocities solve the step from these positions, beginning at these."""
    where, how = memory.array(f"grains.{position}"), memory.array(f"grains.{velocity}")
    return find_infeasibility_proof(scene, where, how, memory.corrections())
