"""The dual 1/2 |u0 - A^T q|^2 + b . q of a step's convex problem (eq. 20).

It is decreased along q(a) = max(0, q + a (z - q)), a line from q to a target z that stops at 0.
"""

import warp as wp

from ..access import at, clear, put
from ..types import Floats, Ints

f64 = wp.float64

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Dual:
    """The dual: the matrix A in sparse rows, and a point q with its slack s = b - A u for u = u0 - A^T q."""

    start: Ints  # first entry of every row of A, and the end of the last row
    column: Ints  # of every entry of A
    entry: Floats  # values of A
    q: Floats
    slack: Floats
    target: Floats  # z: the direction is z - q
    ahead: Floats  # A^T (z - q)
    spread: Floats  # A^T (q(a) - q)


@wp.func
def add_row(dual: Dual, c: int, amount: f64, total: Floats):
    """Add `amount` times row c of A to the vector `total`."""
    p = at(dual.start, c)
    end = at(dual.start, c + 1)
    while p < end:
        j = at(dual.column, p)
        put(total, j, at(total, j) + at(dual.entry, p) * amount)
        p += 1


@wp.func
def fall_at(dual: Dual, a: f64) -> f64:
    """Return the change of the dual from q to q(a), < 0 if it falls; write A^T (q(a) - q) to `spread`."""
    clear(dual.spread)
    total = f64(0.0)
    c = int(0)
    while c < dual.q.shape[0]:
        q = at(dual.q, c)
        way = a * (at(dual.target, c) - q)
        if q + way < f64(0.0):
            add_row(dual, c, -q - way, dual.spread)
            way = -q
        total += way * at(dual.slack, c)
        c += 1
    square = f64(0.0)
    j = int(0)
    while j < dual.spread.shape[0]:
        spread = at(dual.spread, j) + a * at(dual.ahead, j)
        put(dual.spread, j, spread)
        square += spread * spread
        j += 1
    return total + f64(0.5) * square


@wp.kernel
def descend(dual: Dual, first: f64):
    """Replace q by q(a), and update its slack.

    The step a is `first`, doubled as long as the dual falls by that and a < 1/2.
    """
    clear(dual.ahead)
    c = int(0)
    while c < dual.q.shape[0]:
        add_row(dual, c, at(dual.target, c) - at(dual.q, c), dual.ahead)
        c += 1
    a = first
    here = fall_at(dual, a)
    further = fall_at(dual, f64(2.0) * a)
    while further < here and a < f64(0.5):
        a = f64(2.0) * a
        here = further
        further = fall_at(dual, f64(2.0) * a)
    fall_at(dual, a)
    c = int(0)
    while c < dual.q.shape[0]:
        q = at(dual.q, c)
        put(dual.q, c, wp.max(q + a * (at(dual.target, c) - q), f64(0.0)))
        total = at(dual.slack, c)
        p = at(dual.start, c)
        end = at(dual.start, c + 1)
        while p < end:
            total += at(dual.entry, p) * at(dual.spread, at(dual.column, p))
            p += 1
        put(dual.slack, c, total)
        c += 1
