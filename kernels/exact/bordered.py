"""Triangular solves with the factors L D L^T of a sparse matrix M, and with borders of M.

A border c adds the row a_c to M, and the same column. Its row of the factors is y_c = L^-1 a_c. In the
elimination tree, the parent of a column of L is the row of its first entry. y_c is 0 except on the paths from
the entries of a_c to the root of this tree (Liu 1990), so it is computed on these paths only. The Schur
complement of the borders, y_c . D^-1 y_d, is small and dense. It is factored row by row.
"""

import warp as wp

from ..access import at, put
from ..types import Floats, Ints

f64 = wp.float64
ENTRIES = wp.constant(4)  # largest number of entries != 0 of a_c

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Factors:
    """Factors of M = L D L^T: the diagonal D, and L in sparse columns without its diagonal of ones."""

    start: Ints  # first entry of every column of L, and the end of the last column
    row: Ints  # row of every entry, ascending in a column
    value: Floats  # of every entry
    pivot: Floats  # D


@wp.struct
class Borders:
    """Borders of M: the sparse vectors y_c = L^-1 a_c, their Schur complement, and the factors of it.

    The Schur complement covers all borders. Its factors cover only the borders in use.
    """

    most: int  # largest number of borders
    count: Ints  # number of borders, shape (1,)
    start: Ints  # first entry of every y_c, and the end of the last one
    index: Ints  # of every entry: its index in y_c
    value: Floats  # of every entry
    schur: Floats  # lower triangle, shape (most, most)
    used: Ints  # the borders in use, in the order of the rows of `lower`
    shift: Floats  # added to the diagonal of the Schur complement, by border in use
    lower: Floats  # L without its diagonal of ones, and D on the diagonal, shape (most, most)
    force: Floats  # unknowns f of the borders in use
    y: Floats  # L^-1 r
    scaled: Floats  # D^-1 L^-1 r
    work: Floats  # a column; 0 between two launches
    x: Floats  # the solution


@wp.func
def column_above(factors: Factors, j: int) -> int:
    """Return the parent of column j in the elimination tree, or the number of columns if j is a root."""
    if at(factors.start, j) < at(factors.start, j + 1):
        return at(factors.row, at(factors.start, j))
    return factors.pivot.shape[0]


@wp.func
def eliminate(factors: Factors, x: Floats, j: int):
    """Subtract x_j times column j of L from the entries of x below j."""
    amount = at(x, j)
    p = at(factors.start, j)
    end = at(factors.start, j + 1)
    while p < end:
        i = at(factors.row, p)
        put(x, i, at(x, i) - at(factors.value, p) * amount)
        p += 1


@wp.func
def dot(borders: Borders, k: int, x: Floats) -> f64:
    """Return y_k . x for the sparse vector y_k of border k and a dense vector x."""
    total = f64(0.0)
    p = at(borders.start, k)
    end = at(borders.start, k + 1)
    while p < end:
        total += at(borders.value, p) * at(x, at(borders.index, p))
        p += 1
    return total


@wp.kernel
def forward(factors: Factors, borders: Borders):
    """Replace the right-hand side r in `borders.y` by L^-1 r, and write D^-1 L^-1 r to `borders.scaled`."""
    j = int(0)
    while j < factors.pivot.shape[0]:
        eliminate(factors, borders.y, j)
        put(borders.scaled, j, at(borders.y, j) / at(factors.pivot, j))
        j += 1


@wp.kernel
def add_borders(factors: Factors, borders: Borders, column: Ints, entry: Floats, done: int):
    """Append the given rows a_c, from number `done` on, to the borders until their memory is full.

    Given row k has its indices in `column` and its values, of which some may be 0, in `entry`, both from
    element ENTRIES k to ENTRIES (k + 1) - 1. `borders.count` says afterwards how many borders there are.
    """
    size = factors.pivot.shape[0]
    work = borders.work
    k = at(borders.count, 0)
    end = at(borders.start, k)
    base = done * ENTRIES
    while base < column.shape[0] and end + size <= borders.index.shape[0]:
        heads = wp.vec4i(0)
        for e in range(ENTRIES):
            heads[e] = at(column, base + e)
            put(work, heads[e], at(work, heads[e]) + at(entry, base + e))
        base += ENTRIES
        begin = end
        j = wp.min(heads)
        while j < size:
            put(borders.index, end, j)
            put(borders.value, end, at(work, j))
            end += 1
            eliminate(factors, work, j)
            put(work, j, at(work, j) / at(factors.pivot, j))
            above = column_above(factors, j)
            for e in range(ENTRIES):
                if heads[e] == j:
                    heads[e] = above
            j = wp.min(heads)
        k += 1
        put(borders.start, k, end)
        for other in range(k):
            put(borders.schur, (k - 1) * borders.most + other, dot(borders, other, work))
        for p in range(begin, end):
            put(work, at(borders.index, p), f64(0.0))
    put(borders.count, 0, k)


@wp.func
def schur_at(borders: Borders, c: int, d: int) -> f64:
    """Return y_c . D^-1 y_d of borders c and d, an element of the Schur complement."""
    return at(borders.schur, wp.max(c, d) * borders.most + wp.min(c, d))


@wp.func
def factor_row(borders: Borders, k: int):
    """Compute row k of the factors of the Schur complement of the borders in use, from rows 0 to k - 1."""
    row = k * borders.most
    border = at(borders.used, k)
    for c in range(k):
        other = c * borders.most
        scaled = schur_at(borders, border, at(borders.used, c))  # the entry of L times D
        for t in range(c):
            scaled -= at(borders.lower, row + t) * at(borders.lower, other + t)
        put(borders.lower, row + c, scaled)
    pivot = schur_at(borders, border, border) + at(borders.shift, k)
    for c in range(k):
        scaled = at(borders.lower, row + c)
        value = scaled / at(borders.lower, c * borders.most + c)
        pivot -= scaled * value
        put(borders.lower, row + c, value)
    put(borders.lower, row + k, pivot)


@wp.func
def solve_borders(borders: Borders, count: int):
    """Replace `force` by the unknowns f of the first `count` borders in use.

    Before, `force` holds the right-hand sides of the equations of these borders.
    """
    force = borders.force
    for k in range(count):
        total = at(force, k) + dot(borders, at(borders.used, k), borders.scaled)
        for t in range(k):
            total -= at(borders.lower, k * borders.most + t) * at(force, t)
        put(force, k, total)
    for k in range(count):
        put(force, k, at(force, k) / at(borders.lower, k * borders.most + k))
    k = count - 1
    while k >= 0:
        for t in range(k):
            put(force, t, at(force, t) - at(borders.lower, k * borders.most + t) * at(force, k))
        k -= 1


@wp.kernel
def solve(factors: Factors, borders: Borders, factored: int, count: int):
    """Solve M x + sum_c f_c a_c = r together with the equations of the first `count` borders in use.

    The kernel `forward` has processed r before. `borders.force` holds the right-hand sides of the borders'
    equations, and becomes f; `borders.x` becomes x. Rows of the Schur complement from number `factored` on
    are factored first.
    """
    for k in range(factored, count):
        factor_row(borders, k)
    solve_borders(borders, count)
    x = borders.x
    j = int(0)
    while j < x.shape[0]:
        put(x, j, at(borders.y, j))
        j += 1
    for k in range(count):
        c = at(borders.used, k)
        for p in range(at(borders.start, c), at(borders.start, c + 1)):
            i = at(borders.index, p)
            put(x, i, at(x, i) - at(borders.force, k) * at(borders.value, p))
    while j > 0:
        j -= 1
        left = at(x, j) / at(factors.pivot, j)
        p = at(factors.start, j)
        end = at(factors.start, j + 1)
        while p < end:
            left -= at(factors.value, p) * at(x, at(factors.row, p))
            p += 1
        put(x, j, left)
