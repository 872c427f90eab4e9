"""The solver on the host that a method uses."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from warpgrains.base.errors import requiring

if TYPE_CHECKING:
    from warpgrains.solver.records import SceneRecords


def exact_solver(method: str) -> Callable[[SceneRecords, int], Any] | None:
    """Return a factory `(records, k)` of the host's solver of scene k; None for other methods than "exact".

    Raises MissingExtraError if the method is "exact" and its extra is not installed.
    """
    if method != "exact":
        return None
    with requiring("method 'exact'", "exact"):
        from warpgrains.solver.exact.convex import ConvexSolver
        from warpgrains.solver.exact.friction import PathSolver

    def solver_of(records: SceneRecords, k: int) -> ConvexSolver | PathSolver:
        return (PathSolver if records.scenes[k].has_friction else ConvexSolver)(records, k)

    return solver_of
