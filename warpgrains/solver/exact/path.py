"""A step with friction: a path is followed to a solution (MODEL.md, "The exact method with friction").

A pass (kernels/exact/path.py) starts from corrections, with a compliance eps of the contacts. It ends at
better corrections, or at a fold of the path. In the first case, the next pass has a smaller eps, which
approximates rigid contacts better. In the second case, the next pass has a larger eps, because the path has
fewer folds then.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import qdldl
from scipy import sparse

from warpgrains.base.arrays import BoolArray, FloatArray, Indices
from warpgrains.base.host_kernels import Array, launch, shared
from warpgrains.kernels.exact import path as kernels
from warpgrains.kernels.exact.block_lu import Factors
from warpgrains.solver.exact.constraints import StepConstraints

FIRST, FINEST, COARSEST = 1e-3, 1e-6, 10.0  # compliances eps
FINER, COARSER = 3.0, 5.0  # eps is divided by FINER after a complete pass, multiplied by COARSER after others
DRIFTING = 1e-8  # eps after a pass with FINEST that leaves more than STALLED of the residual r
STALLED = 0.5  # because corrections that nearly balance then drift by r / eps per pass
WORSE = 10.0  # largest residual after a pass whose corrections are kept, in residuals before the pass
HALVED, SWEEPS = 6.0, 7_500  # the residual must halve within HALVED times the work so far plus SWEEPS sweeps


class Contacts(NamedTuple):
    """The contacts of a step, m pairs or contacts with walls."""

    first: Indices
    second: Indices
    """Second grain, or number of grains + index of a driven wall, or -1 at other walls."""
    normal: FloatArray
    gap_rate: FloatArray
    """gap / dt, with restitution and the motion of walls, as in `StepConstraints` [m/s]."""
    circle: FloatArray
    """A / dt at a round wall, with A = radius of the wall - radius of the grain (eq. 18), or inf [m/s]."""
    friction: FloatArray
    surface: FloatArray
    """Speed of the wall along the tangent [m/s]; 0 for pairs. In an entry for rolling, r_i Omega (eq. 37)."""
    lever: FloatArray
    """Velocity along normal and tangent of a driven wall at speed 1 (eq. 28); 0 at other walls, for pairs."""
    parts: FloatArray
    """Factors of the centers' tangential velocity and of the rim speeds of both grains, shape (m, 3).

    They are 1, 1, 1 for slip, and 0, c_i, -c_j in an entry for rolling (eq. 37).
    """

    @classmethod
    def of(cls, constraints: StepConstraints) -> Contacts:
        """Return the contacts of `constraints`, in the same order, without entries for rolling."""
        second = np.append(constraints.second, constraints.driver)
        lever = np.append(np.zeros((len(constraints.second), 2)), constraints.lever, axis=0)
        own = constraints.normal, constraints.gap_rate, constraints.circle, constraints.friction
        return cls(
            constraints.first, second, *own, constraints.surface_speed, lever, np.ones((len(second), 3))
        )

    def with_rolling(self, mu: FloatArray, surface: FloatArray, radius: FloatArray) -> Contacts:
        """Return the contacts, followed by an entry for the rolling of each contact.

        `mu` and `surface` hold the `friction` (mu_r) and `surface` of each new entry, shape (m,). `radius`
        holds the radii of all grains [m].
        """
        is_pair = (self.second >= 0) & (self.second < len(radius))
        r_i, r_j = radius[self.first], radius[np.where(is_pair, self.second, 0)]
        c_i = np.where(is_pair, r_j / (r_i + r_j), 1.0)
        parts = np.stack([np.zeros(len(c_i)), c_i, c_i - 1.0], axis=1)
        rolling = self._replace(friction=mu, surface=surface, parts=parts)._asdict()
        return Contacts(
            **{name: np.append(own, rolling[name], axis=0) for name, own in self._asdict().items()}
        )

    def only(self, chosen: BoolArray) -> Contacts:
        """Return the contacts selected by a mask, shape (m,)."""
        return Contacts(**{name: values[chosen] for name, values in self._asdict().items()})


class Answer(NamedTuple):
    """Corrections found, their residual, and the cost of finding them."""

    dv: FloatArray
    dvt: FloatArray
    """Tangential corrections [m/s], followed by rolling corrections if there are any."""
    residual: float
    """Residual eta (eqs. 25 and 38) [m/s]."""
    factorizations: int = 0
    work: int = 0
    """Cost of finding them, in the time that a sweep takes to visit a contact."""


class FrictionStep:
    """A step with friction in memory, for m contacts of n grains and some driven walls.

    Grains are eliminated in an order that keeps the factors sparse. The walls follow, because they touch many
    grains. The kernels number grains and walls in this order.

    Parameters
    ----------
    contacts : Contacts
    inertia : ndarray
        Inertia [kg], shape (n + walls, 3), of two velocity components and rim speed: M, M and J / 2 (eqs.
        17b, 22) of every grain; M, 1 and 1 of every driven wall, whose speed is the first component.
    free : ndarray
        Velocities and rim speeds without contacts [m/s], shape (n + walls, 3).
    walls : int
        Number of driven walls.
    """

    def __init__(self, contacts: Contacts, inertia: FloatArray, free: FloatArray, walls: int = 0):
        first, second = contacts.first, contacts.second
        n, m, updates = len(inertia) - walls, len(first), int(kernels.UPDATES)
        is_pair = (second >= 0) & (second < n)
        i, j = first, np.where(is_pair, second, first)
        edges = np.append(np.minimum(i, j), np.arange(n)), np.append(np.maximum(i, j), np.arange(n))
        # Only the pattern of this matrix matters; its values make it positive definite.
        matrix = sparse.csc_matrix((np.repeat([0.1 / max(1, m), 1.0], [m, n]), edges), shape=(n, n))
        lower, _, order = qdldl.Solver(matrix, upper=True).factors()
        # Each wall has a block in every column before its own column.
        row = np.insert(lower.indices, np.repeat(lower.indptr[1:], walls), np.tile(n + np.arange(walls), n))
        row = np.append(row, n + np.triu_indices(walls, 1)[1])
        length = np.append(np.diff(lower.indptr) + walls, np.arange(walls)[::-1]).astype(np.int64)
        grains, n, blocks, self._order = n, n + walls, len(row), np.append(order, n + np.arange(walls))
        every, j = np.arange(n), np.where(second >= 0, second, first)
        # work of a factorization: a product of blocks takes as long as two visits
        self._beginning = 2 * (int((length * (length + 1)).sum()) + 3 * (blocks + n))
        self._pivoting = self._beginning // updates + 3 * (blocks + n)
        column = np.empty(n, np.int32)
        column[self._order] = every
        low, high = np.minimum(column[i], column[j]), np.maximum(column[i], column[j])
        block = np.searchsorted(np.repeat(every, length) * n + row, low * np.int64(n) + high)
        mass, k = inertia[:, 0], inertia[:, 0] / inertia[:, 2]
        share_i = np.where(is_pair, mass[j] / (mass[i] + mass[j]), 1.0)
        slips, part_i, part_j = contacts.parts.T
        k_n, k_t = (1.0 + mass[i, np.newaxis] / mass[j, np.newaxis] * contacts.lever**2).T
        k_t = slips * k_t + part_i**2 * share_i * k[i]
        k_t = k_t + np.where(is_pair, part_j**2 * (1.0 - share_i) * k[j], 0.0)
        owner = np.append(column[i], column[j[is_pair]])
        owned = np.append(np.arange(m), np.flatnonzero(is_pair))
        empty, numbers = np.empty, np.int32
        self._host: dict[str, Array] = {
            **contacts._asdict(),
            "first": column[i],
            "second": np.where(second >= 0, column[j], -1).astype(numbers),
            **{name: empty(m) for name in ("dv", "dvt", "gap")},
            **{name: empty((m, 2)) for name in ("error", "opening", "excess", "rate")},
            **{name: empty((n, 3)) for name in ("velocity", "saved", "way", "change")},
            **{name: empty((n, 3, 3)) for name in ("diagonal", "inverse")},
            **{name: empty((blocks, 3, 3)) for name in ("lower", "upper")},
            **{name: empty(n, numbers) for name in ("near", "found", "used_end")},
            "k_n": k_n.copy(),
            "k_t": k_t,
            "mass": mass[i] * share_i,
            "block": block.astype(numbers),
            "contact_start": np.append(0, np.cumsum(np.bincount(owner, minlength=grains))).astype(numbers),
            "contact": owned[np.argsort(owner, kind="stable")].astype(numbers),
            "inertia": inertia[self._order],
            "free": free[self._order],
            "piece": empty(m, numbers),
            "updates": empty((updates * n, 3)),
            "updated": empty(updates, numbers),
            "gradient": empty((updates, 2)),
            "pivot": empty(updates),
            "count": empty(3, numbers),
            "residual": empty(1),
            "start": np.append(0, np.cumsum(length)).astype(numbers),
            "row": row.astype(numbers),
            "used": empty(blocks, numbers),
        }
        self._records = [self._shared(struct) for struct in (kernels.Step, kernels.Path, Factors)]

    def _shared(self, struct: Any) -> Any:
        """Return a record of a kernel's struct that shares the arrays of the host."""
        record = struct()
        for name in struct.vars:
            setattr(record, name, shared(self._host[name], kernels.TYPES.get(self._host[name].shape[1:])))
        return record

    def residual(self, dv: FloatArray, dvt: FloatArray) -> float:
        """Return the residual of corrections, as in `Answer` [m/s] (MODEL.md, eqs. 25 and 38)."""
        self._host["dv"][:], self._host["dvt"][:] = dv, dvt
        launch(kernels.measure, self._records[:2])
        return self._host["residual"].item()

    def velocity(self, answer: Answer) -> FloatArray:
        """Return the velocities of grains and driven walls by an answer [m/s], shape (n + walls, 2)."""
        self.residual(answer.dv, answer.dvt)
        found = np.empty((len(self._order), 2))
        found[self._order] = self._host["velocity"][:, :2]
        return found

    def solve(self, dv: FloatArray, dvt: FloatArray, tolerance: float, budget: float = np.inf) -> Answer:
        """Solve the step from the corrections of some sweeps, to a residual of `tolerance` [m/s].

        It stops earlier if `Answer.work` would exceed the budget, or if the residual does not halve soon
        enough. It returns the best corrections found, which may be the given ones.
        """
        eps, first = FIRST, self.residual(dv, dvt)
        best, last, work, factorizations = Answer(dv, dvt, first), first, 0, 0
        halved, end = first, min(budget, float(SWEEPS * len(dv)))
        while best.residual > tolerance and work + self._beginning <= end:
            self._host["dv"][:], self._host["dvt"][:] = dv, dvt
            most = int(min(200 + len(dv) // 3, (end - work - self._beginning) / self._pivoting))
            launch(kernels.follow, [*self._records, eps, most])
            pivots, factored, outcome = self._host["count"].tolist()
            found = self._host["dv"].copy(), self._host["dvt"].copy()
            residual = self.residual(*found)
            work += self._beginning + pivots * self._pivoting
            factorizations += factored
            is_kept = residual <= max(WORSE * last, first) and outcome != kernels.UNBOUNDED
            is_drifting = eps == FINEST and residual > STALLED * last
            if is_kept:
                (dv, dvt), last = found, residual
                best = min(best, Answer(dv, dvt, residual), key=lambda one: one.residual)
            if best.residual <= 0.5 * halved:
                halved, end = best.residual, min(budget, HALVED * work + SWEEPS * len(dv))
            if not is_kept or outcome != kernels.DONE:
                eps = min(COARSEST, eps * COARSER)
            else:
                eps = DRIFTING if is_drifting else max(FINEST, eps / FINER)
        return best._replace(factorizations=factorizations, work=work)
