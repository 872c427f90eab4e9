"""Error messages for failed steps."""

from __future__ import annotations

from math import hypot, inf, isfinite
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.base.errors import SimulationError
from warpgrains.kernels.record import Outcome
from warpgrains.solver.infeasible import InfeasibilityProof, find_infeasibility_proof
from warpgrains.solver.loading import corrections_of
from warpgrains.solver.statistics import named

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.records import SceneRecords


def failure(
    records: SceneRecords, k: int, outcome: int, why: SimulationError | None = None
) -> SimulationError:
    """Return the error for the failed step of scene k.

    Its reason is the error `why`, or follows from the outcome of the step (kernels/record.py).
    """
    scene, done = records.scenes[k], int(records.host["steps"][k])
    error = why or SimulationError(_reason(records, k, outcome))
    return type(error)(f"step {done + 1}, from t = {scene.time_after(done)} s: {error}")


def infeasible_grains(records: SceneRecords, k: int) -> tuple[int, ...]:
    """Return the grains of scene k that provably could not fit in its last step; () if no proof is found."""
    proof = _find_proof(records, k, ("last_position", "last_velocity", "velocity"), 1)
    return () if proof is None else proof.grains


def _reason(records: SceneRecords, k: int, outcome: int) -> str:
    """Return the message for the outcome of a failed step."""
    if outcome == Outcome.NOT_CONVERGED:
        return _not_converged(records, k)
    scene, body = records.scenes[k], int(records.host["verlet"]["bad_body"][k])
    velocity = records.array(k, "grains.next_velocity")[body].tolist()
    if body >= scene.n:
        at = records.array(k, "grains.position")[body, 0]
        return (
            f"a driven wall, body {body - scene.n}, reached a speed of {velocity[0]} m/s at {at} m: in a step"
            f" of {scene.dt} s it would leave no room for the grains, or its place would not be finite"
        )
    reached = f"grain {body} reached a velocity of {velocity} m/s"
    is_across = outcome == Outcome.TOO_FAR and bool(scene.period)
    if is_across and (other := _across(records, k, body)) is not None:
        return (
            f"{reached}: in a step of {scene.dt} s it would meet grain {other} by two of its images in the"
            " periodic box: dt must be shorter"
        )
    path = inf if scene.has_driven_walls else scene.dt * hypot(*velocity)
    undefined = _wall_without_normal(records, k, body, path)
    if undefined is not None or outcome == Outcome.NOT_FINITE:
        return f"{reached}: {undefined or _excess(scene, velocity)}"
    circle = scene.reach - scene.radius[body].item()
    return (
        f"{reached} along the round wall: in a step of {scene.dt} s, it leaves the circle of {circle} m on"
        " which it touches the wall"
    )


def _wall_without_normal(records: SceneRecords, k: int, grain: int, path: float) -> str | None:
    """Return a message if a wall within a path [m] of a grain has no normal at its position, or None."""
    scene, own = records.scenes[k], slice(grain, grain + 1)
    position = records.array(k, "grains.position")[own]
    time = scene.time_after(int(records.host["steps"][k]))
    for number, name in enumerate(scene.wall_names):
        side = scene.side(number, position, scene.radius[own], time=time)
        if side.without_normal(path).any():
            place = tuple(position[0].tolist())
            return (
                f"it is at {place} m, where the wall {name}, which it may touch in this step, has no normal"
            )
    return None


def _across(records: SceneRecords, k: int, grain: int) -> int | None:
    """Return a grain that meets, in this step, an image of `grain` other than the nearest one, or None."""
    scene = records.scenes[k]
    position, velocity = (records.array(k, f"grains.{name}") for name in ("position", "next_velocity"))
    way = scene.period.nearest(position[: scene.n] - position[grain])
    move = scene.dt * (velocity[grain] - velocity[: scene.n])
    images = (way + scene.period.shifts[1:, np.newaxis]).transpose(1, 0, 2)  # without the nearest image
    size = np.maximum((move**2).sum(axis=1), np.finfo(float).tiny)[:, np.newaxis]
    share = np.clip((images * move[:, np.newaxis]).sum(axis=2) / size, 0.0, 1.0)[..., np.newaxis]
    apart = np.hypot(*(images - share * move[:, np.newaxis]).transpose(2, 0, 1)).min(axis=1) - scene.radius
    apart[grain] = np.inf
    return int(apart.argmin()) if apart.min() < scene.radius[grain] else None


def _excess(scene: Scene, velocity: list[float]) -> str:
    """Return a message that states why a step cannot move a grain with this velocity [m/s]."""
    if not all(map(isfinite, velocity)):
        return "it is not finite"
    path = scene.dt * max(map(abs, velocity))
    return (
        f"in a step of {scene.dt} s it would move by {path:.3g} m, out of the domain of radius"
        f" {scene.reach} m, and too far for float64 to resolve gaps"
    )


def _not_converged(records: SceneRecords, k: int) -> str:
    proof = _find_proof(records, k, ("position", "velocity", "next_velocity"), 0)
    grains = "" if proof is None else f": {named(proof.grains)} cannot fit, {proof}"
    step = records.host["step"][k]
    iterations, zeta, residual = (step[name].item() for name in ("iterations", "zeta", "residual"))
    return (
        f"not converged after {iterations} iterations: zeta {zeta:.3e} m/s, residual {residual:.3e} m/s,"
        f" tolerance {records.scenes[k].tolerance:.3e} m/s{grains}"
    )


def _find_proof(
    records: SceneRecords, k: int, names: tuple[str, str, str], ago: int
) -> InfeasibilityProof | None:
    """Search for a proof that a step, which began `ago` steps before now, has no solution.

    `names` are the arrays of positions and velocities at its start, and of velocities after its sweeps.
    None if no proof is found, or a force drives a wall.
    """
    scene = records.scenes[k]
    if scene.has_driven_walls:
        return None  # the proof holds for walls that do not yield
    position, before, velocity = (records.array(k, f"grains.{name}") for name in names)
    time = scene.time_after(int(records.host["steps"][k]) - ago)
    return find_infeasibility_proof(scene, (position, before), velocity, corrections_of(records, k), time)
