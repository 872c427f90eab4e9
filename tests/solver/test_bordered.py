"""Factors with borders, and the descent of the dual, against NumPy's dense matrices."""

import numpy as np
import pytest
from scipy import sparse

from warpgrains.solver.exact import bordered
from warpgrains.solver.exact.active_set import _Dual
from warpgrains.solver.exact.bordered import BorderedMatrix
from warpgrains.solver.exact.projection import PROXIMITY, Projection

PAIRS = [(0, 1), (0, 2), (1, 2), (1, 3), (2, 4), (3, 4), (3, 5), (4, 5)]
ALONE = [0, 0, 5, 6]  # grain 6 touches no other


def random_rows(rng: np.random.Generator) -> sparse.csr_array:
    """Rows of length 1 of pairs of seven grains, and of contacts with walls."""
    columns = [[2 * i, 2 * i + 1, 2 * j, 2 * j + 1] for i, j in PAIRS]
    columns += [[2 * i, 2 * i + 1] for i in ALONE]
    values = [value / np.linalg.norm(value) for value in (rng.normal(size=len(own)) for own in columns)]
    start = np.concatenate([[0], np.cumsum([len(own) for own in columns])])
    entries = np.concatenate(values), np.concatenate(columns), start
    return sparse.csr_array(entries, shape=(len(columns), 14))


@pytest.mark.parametrize("base", [0.0, 0.5, 1.0])
def test_borders_solve_what_they_are_of(base: float) -> None:
    """Rows join a base and leave it, come back, and have their memory grow; against the whole matrix."""
    rng = np.random.default_rng(0)
    rows, matrix = random_rows(rng), BorderedMatrix()
    dense, right = rows.toarray(), rng.normal(size=14)
    m = len(dense)
    matrix.factor(rows, rng.uniform(size=m) < base)
    matrix.take(right)
    inside = dense[matrix.base]
    square = np.eye(14) + PROXIMITY * inside.T @ inside
    for _ in range(12):
        assert matrix.change(rng.uniform(size=m) < 0.5)
        own, across = rng.normal(size=len(matrix.changed)), dense[matrix.changed]
        shift = np.diag(np.where(matrix.base[matrix.changed], 1.0, -1.0) / PROXIMITY)
        expected = np.linalg.solve(
            np.block([[square, across.T], [across, shift]]), np.concatenate([right, -own])
        )
        force, x = matrix.solve(own)
        # the condition number is about rho
        assert np.abs(np.concatenate([x, force]) - expected).max() <= 1e-6 * np.abs(expected).max()


def test_without_memory_for_borders_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bordered, "MOST", 2)
    rows, matrix = random_rows(np.random.default_rng(1)), BorderedMatrix()
    none = np.zeros(rows.shape[0], bool)
    matrix.factor(rows, none)
    one, three = none.copy(), none.copy()
    one[4], three[:3] = True, True
    assert matrix.change(one)
    assert not matrix.change(three)
    assert matrix.changed.tolist() == [4]


def test_descent_lowers_the_dual_and_keeps_its_slack() -> None:
    rng = np.random.default_rng(2)
    rows = random_rows(rng)
    m = rows.shape[0]
    problem = Projection(rows, rng.normal(size=m), rng.normal(size=14), np.ones(m))

    def value(q: np.ndarray) -> float:
        u = problem.free - rows.T @ q
        return float(u @ u / 2.0 + problem.bound @ q)

    q = rng.uniform(size=m)
    dual = _Dual(problem, q)
    z, first = q - dual.slack, 1e-3  # steepest descent
    before = value(q)
    dual.descend(z, first)
    assert value(dual.q) < value(np.maximum(q + first * (z - q), 0.0)) < before
    assert (dual.q >= 0.0).all()
    slack = problem.bound - rows @ (problem.free - rows.T @ dual.q)
    assert np.abs(dual.slack - slack).max() <= 1e-13
