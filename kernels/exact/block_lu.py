"""LU factors of a sparse matrix of 3 x 3 blocks, with a row and a column of blocks for every grain.

The pattern is symmetric and fixed: that of the Cholesky factors of the graph of grains. Loops skip blocks of
the pattern that are 0. There is no pivoting. Blocks on the diagonal are inverted by a QR decomposition. Such
an inverse loses digits if its entries differ by orders of magnitude, as 1 / eps and 1 do here (path.py). So
each quotient by it is refined once.
"""

import warp as wp

from ..access import at, put
from ..types import Ints, Triples

f64 = wp.float64
Blocks = wp.array(dtype=wp.mat33d)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Factors:
    """A sparse matrix of 3 x 3 blocks, which `factor` replaces by its factors L and U.

    The diagonal blocks of L are unit matrices and not stored.
    """

    start: Ints  # first block of every column of L, which is that of every row of U
    row: Ints  # row of every block of L, and column of every block of U; ascending in a column
    diagonal: Blocks  # of U
    inverse: Blocks  # of the diagonal blocks of U, up to rounding
    lower: Blocks  # of L, by columns
    upper: Blocks  # of U, by rows
    used: Ints  # indices of the blocks that are not 0, by column of L or row of U
    used_end: Ints  # end of these indices for every column


@wp.func
def inverse_of(block: wp.mat33d):
    """Return (inverse of a block, sign of its determinant), by a QR decomposition."""
    q, r = wp.qr3(block)
    sign = wp.sign(wp.determinant(q)) * wp.sign(r[0, 0]) * wp.sign(r[1, 1]) * wp.sign(r[2, 2])
    return wp.inverse(r) * wp.transpose(q), sign


@wp.func
def is_zero(block: wp.mat33d) -> bool:
    """Return whether all entries of a block are 0."""
    return wp.ddot(block, block) == f64(0.0)


@wp.func
def factor(factors: Factors) -> f64:
    """Replace the matrix by its factors; return the sign of the matrix's determinant, 1 or -1."""
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
            entry = int(at(factors.start, j))
            u += 1
            w = int(u)
            while w < end:
                q = at(factors.used, w)
                i = at(factors.row, q)
                while at(factors.row, entry) < i:
                    entry += 1
                put(factors.lower, entry, at(factors.lower, entry) - at(factors.lower, q) * upper)
                put(factors.upper, entry, at(factors.upper, entry) - lower * at(factors.upper, q))
                w += 1
        k += 1
    return sign


@wp.func
def solve(factors: Factors, x: Triples):
    """Replace the right-hand side x by the solution of the system whose matrix `factor` has factored."""
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
