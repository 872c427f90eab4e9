"""The dual 1/2 |u0 - A^T q|^2 + b . q of a step's convex problem, along a direction projected onto q >= 0."""

import warp as wp

from .access import at, put
from .types import Floats, Ints

f64 = wp.float64

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Dual:
    """A by rows, and a point q with its slack s = b - A u(q)."""

    start: Ints
    column: Ints
    entry: Floats
    q: Floats
    slack: Floats
    target: Floats  # z: the direction is z - q
    spread: Floats  # A^T of the way from q


@wp.func
def moved(dual: Dual, c: int, a: f64) -> f64:
    """Return by how much q_c changes at a."""
    q = at(dual.q, c)
    return wp.max(q + a * (at(dual.target, c) - q), f64(0.0)) - q


@wp.func
def spread_and_fall(dual: Dual, a: f64) -> f64:
    """Compute the spread at a; return the change of the dual."""
    j = int(0)
    while j < dual.spread.shape[0]:
        put(dual.spread, j, f64(0.0))
        j += 1
    total = f64(0.0)
    c = int(0)
    while c < dual.q.shape[0]:
        way = moved(dual, c, a)
        if way != f64(0.0):
            total += way * at(dual.slack, c)
            p = at(dual.start, c)
            while p < at(dual.start, c + 1):
                j = at(dual.column, p)
                put(dual.spread, j, at(dual.spread, j) + at(dual.entry, p) * way)
                p += 1
        c += 1
    square = f64(0.0)
    j = int(0)
    while j < dual.spread.shape[0]:
        square += at(dual.spread, j) * at(dual.spread, j)
        j += 1
    return total + f64(0.5) * square


@wp.kernel
def descend(dual: Dual, first: f64):
    """Move q by the step `first`, which is doubled while the dual falls, and update its slack."""
    a = first
    here = spread_and_fall(dual, a)
    further = spread_and_fall(dual, f64(2.0) * a)
    while further < here and a < f64(0.5):
        a = f64(2.0) * a
        here = further
        further = spread_and_fall(dual, f64(2.0) * a)
    spread_and_fall(dual, a)
    c = int(0)
    while c < dual.q.shape[0]:
        put(dual.q, c, wp.max(at(dual.q, c) + moved(dual, c, a), f64(0.0)))
        total = at(dual.slack, c)
        p = at(dual.start, c)
        while p < at(dual.start, c + 1):
            total += at(dual.entry, p) * at(dual.spread, at(dual.column, p))
            p += 1
        put(dual.slack, c, total)
        c += 1
