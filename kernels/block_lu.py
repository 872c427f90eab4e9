"""LU factors of a sparse matrix of 3 x 3 blocks, a row and a column of blocks for every grain.

The pattern is symmetric and fixed: that of the Cholesky factors of the graph of grains. Blocks in it that are
0 are left out. Pivots are chosen within the blocks on the diagonal, among all nine entries. The inverse of
such a block loses digits where its entries are far apart, as 1 / eps and 1 are here (path.py), so that each
quotient by it is refined once.
"""

import warp as wp

from .access import at, put
from .types import Ints

f64 = wp.float64
Blocks = wp.array(dtype=wp.mat33d)
Triples = wp.array(dtype=wp.vec3d)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Factors:
    """A matrix, which `factor` replaces by its factors L, with blocks of 1 on its diagonal, and U."""

    start: Ints  # first block of every column of L, which is that of every row of U
    row: Ints  # row of every block of L, and column of every block of U; ascending in a column
    diagonal: Blocks  # of U
    inverse: Blocks  # of the diagonal of U, as far as rounding allows
    lower: Blocks
    upper: Blocks
    used: Ints  # blocks of every column of L, and row of U, that are not 0
    used_end: Ints  # their end in every column


@wp.func
def sign_of(x: int, y: int, z: int) -> f64:
    """Return the sign of a permutation of 0, 1, 2."""
    return f64((y - x) * (z - x) * (z - y)) / f64(2.0)


@wp.func
def inverse_of(block: wp.mat33d):
    """Return the inverse by elimination with full pivoting, and the sign of the determinant."""
    left = block
    right = wp.identity(n=3, dtype=f64)
    rows = wp.vec3i(0, 1, 2)
    columns = wp.vec3i(0, 1, 2)
    sign = f64(1.0)
    for k in range(3):
        largest, row, column = f64(-1.0), int(k), int(k)
        for r in range(k, 3):
            for c in range(k, 3):
                size = wp.abs(left[rows[r], columns[c]])
                if size > largest:
                    largest, row, column = size, r, c
        swapped = rows[k]
        rows[k] = rows[row]
        rows[row] = swapped
        swapped = columns[k]
        columns[k] = columns[column]
        columns[column] = swapped
        pivot = left[rows[k], columns[k]]
        if pivot < f64(0.0):
            sign = -sign
        for c in range(3):
            left[rows[k], c] = left[rows[k], c] / pivot
            right[rows[k], c] = right[rows[k], c] / pivot
        for r in range(3):
            if r != rows[k]:
                amount = left[r, columns[k]]
                for c in range(3):
                    left[r, c] = left[r, c] - amount * left[rows[k], c]
                    right[r, c] = right[r, c] - amount * right[rows[k], c]
    inverse = wp.mat33d()
    for k in range(3):
        for c in range(3):
            inverse[columns[k], c] = right[rows[k], c]
    sign = sign * sign_of(rows[0], rows[1], rows[2]) * sign_of(columns[0], columns[1], columns[2])
    return inverse, sign


@wp.func
def is_zero(block: wp.mat33d) -> bool:
    """Return whether all entries are 0."""
    return wp.ddot(block, block) == f64(0.0)


@wp.func
def factor(factors: Factors) -> f64:
    """Factor the matrix; return the sign of its determinant."""
    sign = f64(1.0)
    k = int(0)
    while k < factors.diagonal.shape[0]:
        pivot = at(factors.diagonal, k)
        inverse, own = inverse_of(pivot)
        put(factors.inverse, k, inverse)
        sign = sign * own
        first = at(factors.start, k)
        end = int(first)
        p = int(first)
        while p < at(factors.start, k + 1):
            block = at(factors.lower, p)
            if not (is_zero(block) and is_zero(at(factors.upper, p))):
                quotient = block * inverse
                put(factors.lower, p, quotient + (block - quotient * pivot) * inverse)
                put(factors.used, end, p)
                end += 1
            p += 1
        put(factors.used_end, k, end)
        u = int(first)
        while u < end:
            p = at(factors.used, u)
            j = at(factors.row, p)
            lower, upper = at(factors.lower, p), at(factors.upper, p)
            put(factors.diagonal, j, at(factors.diagonal, j) - lower * upper)
            place = int(at(factors.start, j))
            u += 1
            w = int(u)
            while w < end:
                q = at(factors.used, w)
                i = at(factors.row, q)
                while at(factors.row, place) < i:
                    place += 1
                put(factors.lower, place, at(factors.lower, place) - at(factors.lower, q) * upper)
                put(factors.upper, place, at(factors.upper, place) - lower * at(factors.upper, q))
                w += 1
        k += 1
    return sign


@wp.func
def solve(factors: Factors, x: Triples):
    """Replace the right-hand side by the solution."""
    k = int(0)
    while k < x.shape[0]:
        amount = at(x, k)
        if amount[0] != f64(0.0) or amount[1] != f64(0.0) or amount[2] != f64(0.0):
            u = at(factors.start, k)
            end = at(factors.used_end, k)
            while u < end:
                p = at(factors.used, u)
                i = at(factors.row, p)
                put(x, i, at(x, i) - at(factors.lower, p) * amount)
                u += 1
        k += 1
    while k > 0:
        k -= 1
        left = at(x, k)
        u = at(factors.start, k)
        end = at(factors.used_end, k)
        while u < end:
            p = at(factors.used, u)
            left = left - at(factors.upper, p) * at(x, at(factors.row, p))
            u += 1
        quotient = at(factors.inverse, k) * left
        put(x, k, quotient + at(factors.inverse, k) * (left - at(factors.diagonal, k) * quotient))
