"""Several pairs of one set at a time: they share no grain, so a processor computes them side by side.

What is a number of one pair is a vector here, with a lane for each; every lane has the bits that its pair has
alone.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from .access import first_of, normal_of, second_of, set_vector, vector_at
from .types import Floats, Pair, Vectors

f64 = wp.float64
Pairs = wp.array(dtype=Pair)
FOUR = wp.constant(4)


@dataclass(frozen=True)
class Lanes:
    """Functions of so many pairs, those from place c on.

    Attributes
    ----------
    vector : type
        One number of each pair.
    numbers_at, set_numbers : wp.Function
        Read and write numbers, `(array, c)` and `(array, c, numbers)`.
    sum_of, product_of, larger_of : wp.Function
        Of two numbers of each pair. Compilers do not see that Warp's own could be one instruction.
    approach : wp.Function
        Velocities at which pairs close their gaps, `(velocity, pairs, c)` [m/s].
    push_apart : wp.Function
        Give grains their shares of changes of corrections, `(velocity, pairs, c, dv, share_i, share_j)`.
    """

    vector: Any
    numbers_at: wp.Function
    set_numbers: wp.Function
    sum_of: wp.Function
    product_of: wp.Function
    larger_of: wp.Function
    approach: wp.Function
    push_apart: wp.Function


@wp.func
def end_of_fours(begin: int, end: int) -> int:
    """Where the last whole four of [begin, end) ends."""
    return end - (end - begin) % FOUR


def lanewise(count: int, formula: str) -> str:
    """Return C++ that computes a formula of x and y, lanes of a and b."""
    return f"""
        wp::vec_t<{count}, double> result;
    #if defined(__CUDA_ARCH__)
        for (int k = 0; k < {count}; k++) {{
            const double x = a.c[k], y = b.c[k];
            result.c[k] = {formula};
        }}
    #else
        typedef double lanes __attribute__((vector_size({8 * count}), aligned(8)));
        const lanes x = *(const lanes *)&a, y = *(const lanes *)&b;
        *(lanes *)&result = {formula};
    #endif
        return result;
    """


@cache
def lanes(count: int) -> Lanes:
    """Return the functions of so many pairs."""
    vector = wp.types.vector(length=count, dtype=f64)

    @wp.func_native(f"""
        wp::vec_t<{count}, double> values;
        for (int k = 0; k < {count}; k++)
            values.c[k] = numbers.data[c + k];
        return values;
    """)
    def numbers_at(numbers: Floats, c: int) -> vector: ...

    @wp.func_native(f"for (int k = 0; k < {count}; k++) numbers.data[c + k] = values.c[k];")
    def set_numbers(numbers: Floats, c: int, values: vector): ...

    @wp.func_native(lanewise(count, "x + y"))
    def sum_of(a: vector, b: vector) -> vector: ...

    @wp.func_native(lanewise(count, "x * y"))
    def product_of(a: vector, b: vector) -> vector: ...

    @wp.func_native(lanewise(count, "y > x ? y : x"))
    def larger_of(a: vector, b: vector) -> vector: ...

    @wp.func
    def approach(velocity: Vectors, pairs: Pairs, c: int):
        vn = vector()
        for k in range(wp.static(count)):
            vi = vector_at(velocity, first_of(pairs, c + k))
            vj = vector_at(velocity, second_of(pairs, c + k))
            vn[k] = wp.dot(vi - vj, normal_of(pairs, c + k))
        return vn

    @wp.func
    def push_apart(velocity: Vectors, pairs: Pairs, c: int, dv: vector, share_i: vector, share_j: vector):
        for k in range(wp.static(count)):
            i = first_of(pairs, c + k)
            j = second_of(pairs, c + k)
            push = dv[k] * normal_of(pairs, c + k)
            set_vector(velocity, i, vector_at(velocity, i) - push * share_i[k])
            set_vector(velocity, j, vector_at(velocity, j) + push * share_j[k])

    return Lanes(vector, numbers_at, set_numbers, sum_of, product_of, larger_of, approach, push_apart)
