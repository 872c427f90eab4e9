"""The host's part of the method "exact": a step that sweeps do not converge, solved by factorizations.

It takes the contacts as the kernels have frozen them, with what the sweeps have made of their corrections,
and puts those of `interior_point` in their place. The kernels then rebuild velocities, measure the residual
and check the list (kernels/exact.py).
"""

from typing import Any

import numpy as np
from scipy import sparse

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.scene.scene import Scene
from warpgrains.solver.interior_point import NormalMatrix, Projection, solve
from warpgrains.solver.scene_memory import SceneMemory

ASKED = 0.5  # of the tolerance, so that the kernels' rounding does not undo it
BETTER = 0.01  # of the sweeps' residual: what an answer must come to


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
        """Replace the corrections of the step, unless no better ones are found, and let the kernels go on."""
        contacts = FrozenContacts(self._scene, self._memory)
        problem, q, record = contacts.problem, contacts.corrections(), self._memory.record
        if self._matrix is None or not self._matrix.fits(problem.rows):
            self._matrix = NormalMatrix(problem.rows)
        found = solve(problem, self._matrix, q, ASKED * self._scene.tolerance)
        if found.residual <= BETTER * problem.residual(q):
            contacts.write(found.q)
        else:
            record["to_search"] = 0  # a proof that no velocities solve the step
        record["step"]["factorizations"] += found.factorizations
        record["control"]["corrected"] = 1


class FrozenContacts:
    """The listed contacts of a step: pairs in lexicographic order, grains at the outer wall, at the inner.

    Attributes
    ----------
    problem : Projection
    """

    def __init__(self, scene: Scene, memory: SceneMemory):
        self._place = memory.array("workspace.sweep_index")[: memory.pairs]
        self._pair_dv = memory.array("contacts.pair_dv")
        self._walls = memory.array("contacts.walls")[: memory.walls]
        self._signs = (1.0, -1.0) if scene.radius_in > 0.0 else (1.0,)
        pairs, grain = memory.array("contacts.pairs")[self._place], self._walls["i"]
        mass_i, mass_j = scene.mass[pairs["i"]], scene.mass[pairs["j"]]
        share_i, share_j = (np.sqrt(mass / (mass_i + mass_j))[:, np.newaxis] for mass in (mass_j, mass_i))
        values = [np.hstack([share_i * pairs["n"], -share_j * pairs["n"]])]
        columns = [np.hstack([_columns(pairs["i"]), _columns(pairs["j"])])]
        units, gap_rates = [np.sqrt(mass_i / (mass_i + mass_j) * mass_j)], [pairs["gap_rate"]]
        for sign, side in zip(self._signs, ("out", "in"), strict=False):
            values.append(sign * self._walls["n"])
            columns.append(_columns(grain))
            units.append(np.sqrt(scene.mass[grain]))
            gap_rates.append(self._walls[f"gap_rate_{side}"])
        lengths = np.repeat([4, *[2] * len(self._signs)], [len(rows) for rows in values])
        start = np.concatenate([[0], np.cumsum(lengths)])
        unit, root = np.concatenate(units), np.sqrt(np.repeat(scene.mass, 2))
        entries = [np.concatenate([part.ravel() for part in parts]) for parts in (values, columns)]
        self.problem = Projection(
            rows=sparse.csr_array((*entries, start), shape=(len(unit), 2 * scene.n)),
            bound=unit * np.concatenate(gap_rates),
            free=root * memory.array("grains.free_velocity").ravel(),
            unit=unit,
        )

    def corrections(self) -> FloatArray:
        """Return the corrections, in the units of the problem."""
        walls = [np.maximum(sign * self._walls["dv"], 0.0) for sign in self._signs]
        return self.problem.unit * np.concatenate([self._pair_dv[self._place], *walls])

    def write(self, q: FloatArray) -> None:
        """Give the contacts other corrections."""
        pairs, *walls = np.split(
            q / self.problem.unit, len(self._place) + len(self._walls) * np.arange(len(self._signs))
        )
        self._pair_dv[self._place] = pairs
        self._walls["dv"] = sum(sign * dv for sign, dv in zip(self._signs, walls, strict=True))


def _columns(grain: np.ndarray[Any, Any]) -> IndexArray:
    """Return where the velocities of grains are among all, shape (m, 2)."""
    return np.stack([2 * grain, 2 * grain + 1], axis=1)
