"""Several pairs of one set at a time: they share no grain, so a processor computes them side by side.

What is a number of one pair is a vector here, with a lane for each; every lane has the bits that its pair has
alone.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from .access import CHECKED, checked
from .types import Contact, Floats, Vectors

f64 = wp.float64
Pairs = wp.array(dtype=Contact)
FOUR = wp.constant(4)


@dataclass(frozen=True)
class Lanes:
    """Functions of several pairs at once, of those from index c on.

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
    gap_rates : wp.Function
        Their gaps over dt, `(pairs, c)` [m/s].
    push_apart : wp.Function
        Share changes of corrections out to grains, `(velocity, pairs, c, dv, share_i, share_j, kept, place)`.
    slip : wp.Function
        Velocities at which the surfaces of pairs slip, `(velocity, rim, pairs, c)` [m/s].
    push_and_turn : wp.Function
        Share changes of normal and tangential corrections out to grains and their rims,
        `(velocity, rim, pairs, c, dv, dvt, share_i, share_j, rim_i, rim_j, kept, place)`.
    """

    vector: Any
    numbers_at: wp.Function
    set_numbers: wp.Function
    sum_of: wp.Function
    product_of: wp.Function
    larger_of: wp.Function
    approach: wp.Function
    gap_rates: wp.Function
    push_apart: wp.Function
    slip: wp.Function
    push_and_turn: wp.Function


@wp.func
def end_of_fours(begin: int, end: int) -> int:
    """Return the end of the last complete group of four in [begin, end)."""
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


PLACE = "2 * within(velocity, place / 2)" if CHECKED else "place"
VELOCITIES = """
    #if defined(__CUDA_ARCH__)
        struct couple : wp::vec_t<2, double> {
            couple(wp::vec_t<2, double> v) : wp::vec_t<2, double>(v) {}
            couple operator*(const couple &n) const { return wp::cw_mul(*this, n); }
            couple operator*(double x) const { return wp::mul(*this, x); }
        };
    #else
        typedef double couple __attribute__((vector_size(16), aligned(8)));
    #endif
        const auto velocity_at = [&](unsigned place) { return (couple *)((double *)velocity.data + PLACE); };
""".replace("PLACE", PLACE)
"""C++ by which both numbers of a velocity, and of a normal, are computed at once."""


KEEP = """
    #if !defined(__CUDA_ARCH__)
        *(couple *)&kept.data[place + 2 * k] = *vi;
        *(couple *)&kept.data[place + 2 * k + 1] = *vj;
    #endif
"""
"""C++ that keeps the velocities of a pair after its correction, because a later pair may change them."""


@cache
def lanes(count: int, keep: bool = False) -> Lanes:
    """Return the functions of `count` pairs at once. With `keep`, those that push keep the velocities."""
    vector = wp.types.vector(length=count, dtype=f64)
    keeping = KEEP if keep else ""

    @wp.func_native(
        checked(f"""
        wp::vec_t<{count}, double> values;
        for (int k = 0; k < {count}; k++)
            values.c[k] = numbers.data[c + k];
        return values;
    """)
    )
    def numbers_at(numbers: Floats, c: int) -> vector: ...

    @wp.func_native(checked(f"for (int k = 0; k < {count}; k++) numbers.data[c + k] = values.c[k];"))
    def set_numbers(numbers: Floats, c: int, values: vector): ...

    @wp.func_native(lanewise(count, "x + y"))
    def sum_of(a: vector, b: vector) -> vector: ...

    @wp.func_native(lanewise(count, "x * y"))
    def product_of(a: vector, b: vector) -> vector: ...

    @wp.func_native(lanewise(count, "y > x ? y : x"))
    def larger_of(a: vector, b: vector) -> vector: ...

    @wp.func_native(
        checked(f"""{VELOCITIES}
        wp::vec_t<{count}, double> vn;
        for (int k = 0; k < {count}; k++) {{
            const couple difference = *velocity_at(pairs.data[c + k].i) - *velocity_at(pairs.data[c + k].j);
            const couple product = difference * *(const couple *)&pairs.data[c + k].n;
            vn.c[k] = product[0] + product[1];
        }}
        return vn;
    """)
    )
    def approach(velocity: Vectors, pairs: Pairs, c: int) -> vector: ...

    @wp.func_native(
        checked(f"""
        wp::vec_t<{count}, double> values;
        for (int k = 0; k < {count}; k++)
            values.c[k] = pairs.data[c + k].gap_rate;
        return values;
    """)
    )
    def gap_rates(pairs: Pairs, c: int) -> vector: ...

    @wp.func_native(
        checked(f"""{VELOCITIES}
        for (int k = 0; k < {count}; k++) {{
            const couple push = *(const couple *)&pairs.data[c + k].n * dv.c[k];
            couple *vi = velocity_at(pairs.data[c + k].i), *vj = velocity_at(pairs.data[c + k].j);
            *vi = *vi - push * share_i.c[k];
            *vj = *vj + push * share_j.c[k];
            {keeping}
        }}
    """)
    )
    def push_apart(
        velocity: Vectors,
        pairs: Pairs,
        c: int,
        dv: vector,
        share_i: vector,
        share_j: vector,
        kept: Vectors,
        place: int,
    ): ...

    @wp.func_native(
        checked(f"""{VELOCITIES}
        wp::vec_t<{count}, double> vt;
        for (int k = 0; k < {count}; k++) {{
            const unsigned i = pairs.data[c + k].i, j = pairs.data[c + k].j;
            const couple difference = *velocity_at(i) - *velocity_at(j);
            const auto n = pairs.data[c + k].n;
            vt.c[k] = difference[1] * n[0] - difference[0] * n[1] + rim.data[i / 2] + rim.data[j / 2];
        }}
        return vt;
    """)
    )
    def slip(velocity: Vectors, rim: Floats, pairs: Pairs, c: int) -> vector: ...

    @wp.func_native(
        checked(f"""{VELOCITIES}
        for (int k = 0; k < {count}; k++) {{
            const unsigned i = pairs.data[c + k].i, j = pairs.data[c + k].j;
            const auto n = pairs.data[c + k].n;
            const wp::vec_t<2, double> t(-n[1], n[0]);
            const couple push = *(const couple *)&n * dv.c[k] + *(const couple *)&t * dvt.c[k];
            couple *vi = velocity_at(i), *vj = velocity_at(j);
            *vi = *vi - push * share_i.c[k];
            *vj = *vj + push * share_j.c[k];
            {keeping}
            rim.data[i / 2] = rim.data[i / 2] - dvt.c[k] * rim_i.c[k];
            rim.data[j / 2] = rim.data[j / 2] - dvt.c[k] * rim_j.c[k];
        }}
    """)
    )
    def push_and_turn(
        velocity: Vectors,
        rim: Floats,
        pairs: Pairs,
        c: int,
        dv: vector,
        dvt: vector,
        share_i: vector,
        share_j: vector,
        rim_i: vector,
        rim_j: vector,
        kept: Vectors,
        place: int,
    ): ...

    return Lanes(
        vector,
        numbers_at,
        set_numbers,
        sum_of,
        product_of,
        larger_of,
        approach,
        gap_rates,
        push_apart,
        slip,
        push_and_turn,
    )
