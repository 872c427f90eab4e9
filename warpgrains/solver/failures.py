"""Why a step failed, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

from warpgrains.solver.statistics import named

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.infeasible import InfeasibilityProof


def not_finite(grain: int, velocity: list[float]) -> str:
    """Say which grain left the range of numbers, and with what velocity [m/s]."""
    return f"grain {grain} reached a velocity of {velocity} m/s"


def beyond_wall(scene: Scene, grain: int, velocity: list[float]) -> str:
    """Say which grain moves along the round wall by more than its circle is wide [m]."""
    circle = scene.radius_out - scene.radius[grain].item()
    return (
        f"grain {grain} reached a velocity of {velocity} m/s along the round wall: in a step of {scene.dt} s,"
        f" it leaves the circle of {circle} m on which it touches the wall"
    )


def not_converged(
    scene: Scene, iterations: int, zeta: float, residual: float, proof: InfeasibilityProof | None
) -> str:
    """Say how far a step came [m/s], and which grains cannot fit, if that is proved."""
    reason = "" if proof is None else f": {named(proof.grains)} cannot fit, {proof}"
    return (
        f"not converged after {iterations} iterations: zeta {zeta:.3e} m/s, residual {residual:.3e} m/s,"
        f" tolerance {scene.tolerance:.3e} m/s{reason}"
    )
