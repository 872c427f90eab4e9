"""The host's part of the method "exact": a step that sweeps do not converge, solved by factorizations.

It takes the contacts as the kernels have frozen them, with what the sweeps have made of their corrections,
and puts those of `active_set` in their place, or of `interior_point` where this does not get there. The
kernels then rebuild velocities, measure the residual and check the list (kernels/exact.py).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import sparse

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.solver import active_set, interior_point
from warpgrains.solver.projection import NormalMatrix, Projection, Solution

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.scene_memory import SceneMemory

ASKED = 0.5  # of the tolerance, so that the kernels' rounding does not undo it
BETTER = 0.01  # of the sweeps' residual: what an answer must come to


def solve(problem: Projection, matrix: NormalMatrix, q: FloatArray, tolerance: float) -> Solution:
    """Solve a step from corrections that some sweeps have left, as closely as either method can."""
    found = active_set.solve(problem, matrix, q, tolerance)
    if found.residual <= tolerance:
        return found
    start = found.q if found.residual < problem.residual(q) else q
    inner = interior_point.solve(problem, matrix, start, tolerance)
    return inner._replace(factorizations=found.factorizations + inner.factorizations)


class ExactSolver:
    """Solves steps of one scene.

    Parameters
    ----------
    scene : Scene
    memory : SceneMemory
        Where its contacts are.
    """

    def __init__(self, scene: Scene, memory: SceneMemory):
        self._scene, self._memory = scene, memory
        self._matrix: NormalMatrix | None = None

    def solve(self) -> None:
        """Replace the corrections of the step, unless no better ones are found, and let the kernels go on.

        The gaps of a round wall depend on velocities (MODEL.md, eq. 18): they are those of the last answer,
        until it satisfies its own.
        """
        contacts, record = FrozenContacts(self._scene, self._memory), self._memory.record
        if self._matrix is None or not self._matrix.fits(contacts.rows):
            self._matrix = NormalMatrix(contacts.rows)
        tolerance, q = ASKED * self._scene.tolerance, contacts.corrections()
        problem = contacts.problem(q)
        before = left = problem.residual(q)
        while left > tolerance:
            found = solve(problem, self._matrix, q, tolerance)
            record["step"]["factorizations"] += found.factorizations
            problem = contacts.problem(found.q)
            last, residual = left, problem.residual(found.q)
            if residual < left:
                q, left = found.q, residual
            if found.residual > tolerance or residual > 0.5 * last:
                break
        is_better = before > tolerance and left <= max(BETTER * before, tolerance)
        if is_better:
            contacts.write(q)
        else:
            record["to_search"] = 0  # a proof that no velocities solve the step
        record["control"]["corrected"], record["control"]["declined"] = 1, not is_better


class FrozenContacts:
    """The listed contacts of a step: pairs in lexicographic order, and grains wall after wall.

    Attributes
    ----------
    rows : csr_array
        Of (v_i - v_j) . n or v_i . n, in the units of a `Projection`.
    """

    def __init__(self, scene: Scene, memory: SceneMemory):
        self._scene, self._dv = scene, memory.array("contacts.dv")
        self._place = memory.listed_pairs()[1]
        self._grain, self._wall = memory.listed_walls()
        self._position = memory.array("grains.position")[self._grain]
        pairs = memory.array("contacts.contact")[self._place]
        self._gap_rate = pairs["gap_rate"]
        mass = scene.contact_mass
        mass_i, mass_j = mass[pairs["i"]], mass[pairs["j"]]
        share_i, share_j = (np.sqrt(other / (mass_i + mass_j))[:, np.newaxis] for other in (mass_j, mass_i))
        walls = scene.walls.seen_from(self._position, scene.radius[self._grain])
        values = [np.hstack([share_i * pairs["n"], -share_j * pairs["n"]]), *(wall.normal for wall in walls)]
        columns = [
            np.hstack([_columns(pairs["i"]), _columns(pairs["j"])]),
            *[_columns(self._grain)] * len(walls),
        ]
        units = [
            np.sqrt(mass_i / (mass_i + mass_j) * mass_j),
            *[np.sqrt(mass[self._grain])] * len(walls),
        ]
        lengths = np.repeat([4, *[2] * len(walls)], [len(rows) for rows in values])
        entries = [np.concatenate([part.ravel() for part in parts]) for parts in (values, columns)]
        self._unit, self._root = np.concatenate(units), np.sqrt(mass)[:, np.newaxis]
        self._free = (self._root * memory.array("grains.free_velocity")).ravel()
        start = np.concatenate([[0], np.cumsum(lengths)])
        self._signs = [wall.sign for wall in walls]
        self.rows = sparse.csr_array((*entries, start), shape=(len(lengths), 2 * scene.n))

    def problem(self, q: FloatArray) -> Projection:
        """Return the step's problem, with the gaps that the walls have for the velocities of corrections."""
        scene = self._scene
        velocity = (self._free - self.rows.T @ q).reshape(-1, 2) / self._root
        move = scene.dt * velocity[self._grain]
        walls = scene.walls.seen_from(self._position, scene.radius[self._grain], move)
        gap_rate = np.concatenate([self._gap_rate, *(wall.gap / scene.dt for wall in walls)])
        return Projection(self.rows, self._unit * gap_rate, self._free, self._unit)

    def corrections(self) -> FloatArray:
        """Return the corrections, in the units of the problem."""
        walls = [np.maximum(sign * self._dv[self._wall], 0.0) for sign in self._signs]
        return self._unit * np.concatenate([self._dv[self._place], *walls])

    def write(self, q: FloatArray) -> None:
        """Give the contacts other corrections."""
        first = len(self._place)
        pairs, *walls = np.split(q / self._unit, first + len(self._grain) * np.arange(len(self._signs)))
        self._dv[self._place] = pairs
        self._dv[self._wall] = sum(sign * dv for sign, dv in zip(self._signs, walls, strict=True))


def _columns(grain: np.ndarray[Any, Any]) -> IndexArray:
    """Return where the velocities of grains are among all, shape (m, 2)."""
    return np.stack([2 * grain, 2 * grain + 1], axis=1)
