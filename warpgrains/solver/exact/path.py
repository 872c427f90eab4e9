"""The host's part of the method "exact" with friction: a path is followed to a solution (MODEL.md).

A pass (kernels/path.py) begins at corrections, with a compliance eps of the contacts. It ends at better
corrections, or at a fold of the path. In the first case the next pass has a smaller eps, with which it comes
nearer to rigid contacts. In the second case it has a larger eps, with which there are fewer folds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import qdldl
from scipy import sparse

from warpgrains.arrays import FloatArray, Indices
from warpgrains.host_kernels import Array, launch, shared
from warpgrains.kernels import path as kernels
from warpgrains.kernels.block_lu import Factors
from warpgrains.kernels.record import Phase
from warpgrains.solver.constraints import StepConstraints
from warpgrains.solver.exact.listed import ListedContacts

if TYPE_CHECKING:
    from warpgrains.solver.records import SceneRecords

ASKED = 0.5  # of the tolerance; leaves a margin for rounding in the kernels
FINEST, COARSEST = 1e-6, 10.0  # compliances
DRIFTING = 1e-8  # compliance of a pass after one at the finest that left more than
SLOW = 0.5  # of the residual: corrections drift that nearly balance, r / eps a pass
FINER, COARSER = 3.0, 5.0  # factors of the compliance after a pass that was followed to its end, and others
WORSE, WORST = 10.0, 1.0  # residual after a pass that is kept, in residuals before it and at the start
PASSES = 200  # of an attempt
EXACT_TIME = 20.0  # default of `Scene.exact_time`


class Attempt(NamedTuple):
    """How folds are passed, and where the compliance begins."""

    compliance: float = 1e-3
    local: int = 30
    """Pivots in which a fold must be passed."""
    nearby: int = 2
    """Grains from a fold within which gaps are opened."""


ATTEMPTS = (Attempt(), Attempt(nearby=1), Attempt(compliance=1e-2, local=60), Attempt(nearby=3))


class Contacts(NamedTuple):
    """The contacts of a step, m pairs or contacts with walls."""

    first: Indices
    second: Indices
    """-1 at walls."""
    normal: FloatArray
    gap_rate: FloatArray
    """gap / dt [m/s]."""
    reach: FloatArray
    """A / dt of eq. 18 at a round wall, else inf [m/s]."""
    friction: FloatArray
    surface: FloatArray
    """Speed of the surface along the tangent [m/s]."""

    @classmethod
    def of(cls, constraints: StepConstraints) -> Contacts:
        """Return the contacts of constraints."""
        first = constraints.first
        second = np.full(len(first), -1)
        second[: len(constraints.second)] = constraints.second
        own = constraints.normal, constraints.gap_rate, constraints.reach, constraints.friction
        return cls(first, second, *own, constraints.surface_speed)


class Elimination:
    """The order in which n grains are eliminated, for m contacts, and the blocks of the factors.

    Attributes
    ----------
    column : ndarray
        Column of every grain, shape (n,).
    start, row : ndarray
        Blocks of every column of L.
    place : ndarray
        Block of every pair, shape (m,); -1 of contacts with walls.
    work : tuple of int
        Work of the start of a pass and of a pivot, in visits of contacts by a sweep.
    """

    def __init__(self, n: int, first: Indices, second: Indices):
        self.first, self.second = first, second
        is_pair = second >= 0
        i, j = first[is_pair], second[is_pair]
        edge = sparse.coo_array(
            (np.full(len(i), 1e-3 / n), (np.minimum(i, j), np.maximum(i, j))), shape=(n, n)
        )
        matrix = sparse.csc_matrix(
            edge + sparse.eye_array(n)
        )  # it is positive definite: only the pattern matters
        lower, _, grain = qdldl.Solver(matrix, upper=True).factors()
        self.start, self.row = lower.indptr.astype(np.int32), lower.indices.astype(np.int32)
        self.column = np.empty(n, np.int32)
        self.column[grain] = np.arange(n)
        ends = np.sort(np.stack([self.column[i], self.column[j]]).astype(np.int64), axis=0)
        length = np.diff(self.start).astype(np.int64)
        key = np.repeat(np.arange(n), length) * n + self.row
        self.place = np.full(len(first), -1, np.int32)
        self.place[is_pair] = np.searchsorted(key, ends[0] * n + ends[1])
        blocks = len(self.row) + n
        factoring = int((length * (length + 1)).sum()) + 3 * blocks
        self.work = factoring, factoring // int(kernels.UPDATES) + (3 * blocks) // 2

    def fits(self, first: Indices, second: Indices) -> bool:
        """Return True if these are the contacts."""
        return np.array_equal(first, self.first) and np.array_equal(second, self.second)


class Answer(NamedTuple):
    """Corrections, and what they took."""

    dv: FloatArray
    dvt: FloatArray
    residual: float
    """[m/s]."""
    factorizations: int = 0
    work: int = 0


class FrictionStep:
    """A step with friction in memory.

    Parameters
    ----------
    contacts : Contacts
    elimination : Elimination
        That of these contacts.
    inertia : ndarray
        M, M and J / 2 of every grain [kg], shape (n, 3).
    free : ndarray
        Free velocity and rim speed of every grain [m/s], shape (n, 3).
    """

    def __init__(self, contacts: Contacts, elimination: Elimination, inertia: FloatArray, free: FloatArray):
        n, m, blocks, updates = len(free), len(contacts.first), len(elimination.row), int(kernels.UPDATES)
        self._elimination = elimination
        column, is_pair = elimination.column, contacts.second >= 0
        first, second = (
            column[contacts.first],
            np.where(is_pair, column[contacts.second], -1).astype(np.int32),
        )
        grain = np.argsort(column)
        mass, rim = inertia[:, 0], 2.0 * inertia[:, 2]
        i, j = contacts.first, np.where(is_pair, contacts.second, contacts.first)
        share_i = np.where(is_pair, mass[j] / (mass[i] + mass[j]), 1.0)
        share_j = np.where(is_pair, mass[i] / (mass[i] + mass[j]), 0.0)
        compliance = 1.0 + share_i * (2.0 * mass[i] / rim[i]) + share_j * (2.0 * mass[j] / rim[j])
        owner = np.concatenate([first, second[is_pair]])
        owned = np.concatenate([np.arange(m), np.flatnonzero(is_pair)])
        self._step, self._path, self._factors = kernels.Step(), kernels.Path(), Factors()
        self._share(
            self._step,
            first=first,
            second=second,
            normal=contacts.normal,
            gap_rate=contacts.gap_rate,
            reach=contacts.reach,
            friction=contacts.friction,
            surface=contacts.surface,
            compliance=compliance,
            mass=mass[i] * share_i,
            place=elimination.place,
            contact_start=np.append(0, np.cumsum(np.bincount(owner, minlength=n))).astype(np.int32),
            contact=owned[np.argsort(owner, kind="stable")].astype(np.int32),
            inertia=inertia[grain],
            free=free[grain],
        )
        self._dv, self._dvt, self._count, self._reached = (
            np.zeros(m),
            np.zeros(m),
            np.zeros(5, np.int32),
            np.zeros(2),
        )
        self._share(
            self._path,
            dv=self._dv,
            dvt=self._dvt,
            count=self._count,
            reached=self._reached,
            gap=np.empty(m),
            piece=np.empty(m, np.int32),
            **{name: np.empty((m, 2)) for name in ("error", "opening", "excess", "rate")},
            **{name: np.empty((n, 3)) for name in ("velocity", "saved", "way", "change", "force")},
            updates=np.empty((updates * n, 3)),
            updated=np.empty(updates, np.int32),
            gradient=np.empty((updates, 2)),
            pivot=np.empty(updates),
            mark=np.empty(n, np.int32),
            front=np.empty(n, np.int32),
        )
        self._share(
            self._factors,
            start=elimination.start,
            row=elimination.row,
            **{name: np.empty((n, 3, 3)) for name in ("diagonal", "inverse")},
            **{name: np.empty((blocks, 3, 3)) for name in ("lower", "upper")},
            used=np.empty(blocks, np.int32),
            used_end=np.empty(n, np.int32),
        )

    def _share(self, record: object, **arrays: Array) -> None:
        for name, array in arrays.items():
            setattr(record, name, shared(np.ascontiguousarray(array), kernels.TYPES.get(array.shape[1:])))

    def residual(self, dv: FloatArray, dvt: FloatArray) -> float:
        """Return the residual of corrections [m/s] (MODEL.md, eq. 25)."""
        self._dv[:], self._dvt[:] = dv, dvt
        launch(kernels.measure, [self._step, self._path])
        return float(self._reached[1])

    def solve(
        self,
        dv: FloatArray,
        dvt: FloatArray,
        tolerance: float,
        budget: float = np.inf,
        attempt: Attempt = ATTEMPTS[0],
    ) -> Answer:
        """Solve the step from the corrections of some sweeps, to a residual of `tolerance` [m/s].

        It ends with the best corrections found when the work exceeds the budget. They may be those given.
        """
        eps, (beginning, pivoting) = attempt.compliance, self._elimination.work
        first = last = self.residual(dv, dvt)
        best, work, factorizations = Answer(dv, dvt, first), 0, 0
        for _ in range(PASSES):
            left = (budget - work - beginning) / pivoting
            if best.residual <= tolerance or left < 0.0:
                break
            pivots = int(min(200 + len(dv) // 3, left))
            self._dv[:], self._dvt[:] = dv, dvt
            inputs = [self._step, self._path, self._factors, eps, pivots, attempt.local, attempt.nearby]
            launch(kernels.follow, inputs)
            (made, factored, *_, status), residual = self._count.tolist(), float(self._reached[1])
            work += beginning + made * pivoting
            factorizations += factored
            is_kept = residual <= max(WORSE * last, WORST * first) and status != kernels.UNBOUNDED
            is_drifting = eps == FINEST and residual > SLOW * last
            if is_kept:
                dv, dvt, last = self._dv.copy(), self._dvt.copy(), residual
                if residual < best.residual:
                    best = Answer(dv, dvt, residual)
            if not is_kept or status != kernels.DONE:
                eps = min(COARSEST, eps * COARSER)
            elif is_drifting:
                eps = DRIFTING
            else:
                eps = max(FINEST, eps / FINER)
        return best._replace(factorizations=factorizations, work=work)


class PathSolver:
    """Host solver for the steps with friction of scene k.

    While sweeps go on, only an answer that meets the tolerance is taken. After the last sweep the best answer
    is taken if its residual is smaller than that of the sweeps.
    """

    def __init__(self, records: SceneRecords, k: int):
        self._records, self._k = records, k
        self._elimination: Elimination | None = None
        self._attempt, self._work = 0, 0
        self._best: Answer | None = None

    def solve(self) -> None:
        """Replace the corrections of the step if better ones are found, and let the kernels continue."""
        scene, record = self._records.scenes[self._k], self._records.host[self._k]
        listed, state = ListedContacts(self._records, self._k), record["step"]
        contacts = Contacts.of(listed.constraints)
        if self._elimination is None or not self._elimination.fits(contacts.first, contacts.second):
            self._elimination, self._best = Elimination(scene.n, contacts.first, contacts.second), None
        if state["factorizations"] == 0:
            self._attempt, self._work, self._best = 0, 0, None
        names = ("grains.free_velocity", "grains.free_rim")
        free = np.column_stack([self._records.array(self._k, name) for name in names])
        inertia = np.column_stack([scene.contact_mass, scene.contact_mass, 0.5 * scene.rim_mass])
        step = FrictionStep(contacts, self._elimination, inertia, free)
        dv, dvt, tolerance = listed.read("dv"), listed.read("dvt"), ASKED * scene.tolerance
        exact_time = EXACT_TIME if scene.exact_time is None else scene.exact_time
        budget = exact_time * scene.max_iterations * len(dv)
        answer = step.solve(dv, dvt, tolerance, budget - self._work, ATTEMPTS[self._attempt % len(ATTEMPTS)])
        self._attempt += 1
        self._work += answer.work
        state["factorizations"] += answer.factorizations
        best = self._best = min(filter(None, (self._best, answer)), key=lambda one: one.residual)
        is_last = state["iterations"] >= scene.max_iterations
        is_solved = best.residual <= tolerance
        is_better = is_solved or (is_last and best.residual < step.residual(dv, dvt))
        if is_better:
            listed.write("dv", best.dv)
            listed.write("dvt", best.dvt)
        if is_last or is_solved:
            state["patience"] = 0
        elif self._attempt >= len(ATTEMPTS) or self._work + self._elimination.work[0] > budget:
            state["patience"] = -1
        record["control"]["phase"] = Phase.CORRECTED if is_better else Phase.DECLINED
