"""What scenes wait for: room for a list, the exact solution of a step, a proof that grains cannot fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from warpgrains.errors import SimulationError, missing_extra
from warpgrains.solver.failures import find_proof, reason
from warpgrains.solver.infeasible import iterations_worth_a_search

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.records import SceneRecords
    from warpgrains.solver.scene_memory import SceneMemory

REFUSED = -1  # outcome of a step whose list finds no memory


def exact_solver(method: str) -> Callable[[Scene, SceneMemory], Any] | None:
    """Return what makes a solver of steps for a scene; None where the method needs none.

    Raises
    ------
    SceneError
        It is "exact", and qdldl is not installed; it comes with the extra ``[exact]``.
    """
    if method != "exact":
        return None
    try:
        from warpgrains.solver.exact import ExactSolver
    except ModuleNotFoundError as error:
        raise missing_extra("method 'exact'", error, "exact") from error
    return ExactSolver


class Service:
    """What the host does for scenes that are amid a step, and what it has found.

    Parameters
    ----------
    scenes : sequence of Scene
        All of one method.
    records : SceneRecords
    memory : list of SceneMemory
        Of each scene.

    Attributes
    ----------
    proofs : list of list
        Steps that have no solution, by number, and the grains that cannot fit, of each scene.
    errors : dict of int to str
        Why scenes stopped before their end.
    """

    def __init__(self, scenes: Sequence[Scene], records: SceneRecords, memory: list[SceneMemory]):
        self._scenes, self._records, self._memory = scenes, records, memory
        solver = exact_solver(scenes[0].method)
        self._exact = [] if solver is None else list(map(solver, scenes, memory))
        self.forget()

    def forget(self) -> None:
        """Begin to count proofs and errors anew."""
        self.proofs: list[list[tuple[int, tuple[int, ...]]]] = [[] for _ in self._scenes]
        self.errors: dict[int, str] = {}

    def make_room(self, k: int) -> bool:
        """Make room for the list of scene k; return whether there is memory."""
        try:
            self._records.make_room(k, int(self._memory[k].array("neighbors.total")[0]))
        except SimulationError as error:
            self.errors[k] = str(error)
            return False
        return True

    def solve_exactly(self, k: int) -> None:
        """Solve the step of scene k where its sweeps are too slow."""
        self._exact[k].solve()

    def look_for_proof(self, k: int, step: int) -> None:
        """Name the grains of scene k that cannot fit after an unconverged step, of this number."""
        proof = find_proof(self._scenes[k], self._memory[k], "last_position", "velocity")
        wait = 0 if proof else iterations_worth_a_search(self._scenes[k].n)
        self._memory[k].record["to_search"] = wait
        if proof:
            self.proofs[k].append((step, proof.grains))

    def explain(self, k: int, outcome: int, done: int) -> None:
        """Say why the step of scene k that follows on so many failed."""
        scene = self._scenes[k]
        why = self.errors[k] if outcome == REFUSED else reason(scene, self._memory[k], outcome)
        self.errors[k] = f"step {done + 1}, from t = {done * scene.dt} s: {why}"

    def give_up(self, k: int) -> None:
        """Take back what the unfinished step of scene k did."""
        self._memory[k].give_up_step()
        self._records.push(k)
