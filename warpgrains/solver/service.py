"""Requests of scenes to the host: memory for a list, the exact solution of a step, and errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import hypot, inf, isfinite
from typing import TYPE_CHECKING, Any

from warpgrains.errors import SimulationError, requiring
from warpgrains.kernels.record import NOT_CONVERGED, NOT_FINITE
from warpgrains.solver.infeasible import (
    InfeasibilityProof,
    find_infeasibility_proof,
)
from warpgrains.solver.statistics import named

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.records import SceneRecords
    from warpgrains.solver.scene_memory import SceneMemory


def exact_solver(method: str) -> Callable[[Scene, SceneMemory], Any] | None:
    """Return the class that solves steps of a scene on the host; None if the method needs none.

    Raises
    ------
    MissingExtraError
        The method is "exact" and qdldl, which the extra ``[exact]`` installs, is missing.
    """
    if method != "exact":
        return None
    with requiring("method 'exact'", "exact"):
        from warpgrains.solver.exact import ExactSolver
    return ExactSolver


class Service:
    """Server for the requests of scenes during a step; it keeps the errors.

    Parameters
    ----------
    scenes : sequence of Scene
        All of one method.
    records : SceneRecords
    memory : list of SceneMemory
        Memory of each scene.

    Attributes
    ----------
    errors : dict of int to SimulationError
        Reasons why scenes stopped early, by scene.
    """

    def __init__(self, scenes: Sequence[Scene], records: SceneRecords, memory: list[SceneMemory]):
        self._scenes, self._records, self._memory = scenes, records, memory
        solver = exact_solver(scenes[0].method)
        self._exact = [] if solver is None else list(map(solver, scenes, memory))
        self.errors: dict[int, SimulationError] = {}

    def reserve_contacts(self, k: int) -> bool:
        """Reserve memory for the list of scene k; return True if there is, and has always been, enough."""
        if k in self.errors:
            return False
        try:
            self._records.reserve_contacts(k, int(self._memory[k].array("neighbors.total")[0]))
        except SimulationError as error:
            self.errors[k] = error
            return False
        return True

    def solve_exactly(self, k: int) -> None:
        """Solve the step of scene k, in which sweeps converge too slowly."""
        self._exact[k].solve()

    def infeasible_grains(self, k: int) -> tuple[int, ...]:
        """Return the grains of scene k that provably cannot fit in its last step."""
        proof = _find_proof(self._scenes[k], self._memory[k], "last_position", "velocity", 0)
        return () if proof is None else proof.grains

    def explain(self, k: int, outcome: int) -> None:
        """Store the reason why the open step of scene k failed."""
        scene, done = self._scenes[k], self._memory[k].steps
        why = self.errors.get(k) or SimulationError(_reason(scene, self._memory[k], outcome))
        self.errors[k] = type(why)(f"step {done + 1}, from t = {scene.time_after(done)} s: {why}")


def _reason(scene: Scene, memory: SceneMemory, outcome: int) -> str:
    """Return the message for the outcome of a failed step."""
    if outcome == NOT_CONVERGED:
        return _not_converged(scene, memory)
    grain = int(memory.record["verlet"]["flags"]["bad_body"])
    if grain >= scene.n:
        speed, at = (memory.coordinates(name)[grain - scene.n] for name in ("next_velocity", "position"))
        return (
            f"a driven wall, body {grain - scene.n}, reached a speed of {speed} m/s at {at} m: in a step of"
            f" {scene.dt} s it would leave no room for the grains, or its place would not be finite"
        )
    velocity = memory.array("grains.next_velocity")[grain].tolist()
    reached = f"grain {grain} reached a velocity of {velocity} m/s"
    path = inf if scene.has_driven_walls else scene.dt * hypot(*velocity)
    undefined = _wall_without_normal(scene, memory, grain, path)
    if undefined is not None or outcome == NOT_FINITE:
        return f"{reached}: {undefined or _excess(scene, velocity)}"
    circle = scene.radius_out - scene.radius[grain].item()
    return (
        f"{reached} along the round wall: in a step of {scene.dt} s, it leaves the circle of {circle} m on"
        " which it touches the wall"
    )


def _wall_without_normal(scene: Scene, memory: SceneMemory, grain: int, path: float) -> str | None:
    """Return where a grain is if a wall within its path [m] has no normal there; else None."""
    position, radius = memory.grains("position")[grain : grain + 1], scene.radius[grain : grain + 1]
    time = scene.time_after(memory.steps + 1)
    for number in scene.wall_numbers:
        if scene.is_without_normal(number, position, radius, path, time).any():
            place = tuple(position[0].tolist())
            return f"it is at {place} m, where wall {number}, which it may touch in this step, has no normal"
    return None


def _excess(scene: Scene, velocity: list[float]) -> str:
    """Return the reason why a step cannot move a grain with this velocity [m/s]."""
    if not all(map(isfinite, velocity)):
        return "it is not finite"
    path = scene.dt * max(map(abs, velocity))
    return (
        f"in a step of {scene.dt} s it would move by {path:.3g} m, out of the domain of radius"
        f" {scene.radius_out} m, and the square of that is not finite"
    )


def _not_converged(scene: Scene, memory: SceneMemory) -> str:
    proof = _find_proof(scene, memory, "position", "next_velocity", 1)
    grains = "" if proof is None else f": {named(proof.grains)} cannot fit, {proof}"
    iterations, zeta, residual = (
        memory.record["step"][name].item() for name in ("iterations", "zeta", "residual")
    )
    return (
        f"not converged after {iterations} iterations: zeta {zeta:.3e} m/s, residual {residual:.3e} m/s,"
        f" tolerance {scene.tolerance:.3e} m/s{grains}"
    )


def _find_proof(
    scene: Scene, memory: SceneMemory, position: str, velocity: str, ahead: int
) -> InfeasibilityProof | None:
    """Search for a proof that the step has no solution, from the arrays of these names.

    The step ends `ahead` steps after the last one that is counted.
    """
    if scene.has_driven_walls:
        return None  # walls yield: the proof is about walls that do not
    where, how = memory.array(f"grains.{position}"), memory.array(f"grains.{velocity}")
    time = scene.time_after(memory.steps + ahead)
    return find_infeasibility_proof(scene, where, how, memory.corrections(), time)
