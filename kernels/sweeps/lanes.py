"""Functions of several pairs of one set, which share no grain, so that a processor computes them in parallel.
(With one pair at a time, an accelerated step of 1,000 flowing grains takes 30 % longer.)

A number of a pair becomes a vector with one lane for each pair. Each lane has the same bits as if its pair
were computed alone.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from ..access import CHECKED, checked
from ..types import Contact, Floats, Vectors

f64 = wp.float64
Pairs = wp.array(dtype=Contact)
FOUR = wp.constant(4)


@wp.func
def end_of_fours(begin: int, end: int) -> int:
    """Return the end of the last complete group of four in [begin, end)."""
    return end - (end - begin) % FOUR


def lanewise(count: int, formula: str) -> str:
    """Return C++ that evaluates a formula of x and y in each of `count` lanes of the vectors a and b."""
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
"""C++ that defines `couple`: both components of a velocity or normal, on which one instruction operates."""


KEEP = """
    #if !defined(__CUDA_ARCH__)
        *(couple *)&kept.data[slot + 2 * k] = after_i;
        *(couple *)&kept.data[slot + 2 * k + 1] = after_j;
    #endif
"""
"""C++ that saves both velocities of a pair after its correction, because a later pair may change them."""


TURN = """
    const wp::vec_t<2, double> t(-normal[1], normal[0]);
    const double dvt = change.dvt.c[k];
    impulse = impulse + *(const couple *)&t * dvt;
    const double slid_i = rim.data[i / 2] - dvt * shares.rim_i.c[k];
    const double slid_j = rim.data[j / 2] - dvt * shares.rim_j.c[k];
    rim.data[i / 2] = slid_i;
    rim.data[j / 2] = slid_j;
"""
"""C++ that adds a tangential correction to the impulse and to both rim speeds."""
ROLL = """
    const double dvr = change.dvr.c[k], part = shares.part.c[k];
    rim.data[i / 2] = slid_i - dvr * part * shares.rim_i.c[k];
    rim.data[j / 2] = slid_j + dvr * (1.0 - part) * shares.rim_j.c[k];
"""
"""C++ that also adds a rolling correction to both rim speeds, after TURN."""


@cache
def records(count: int) -> tuple[Any, Any, Any]:
    """Return (vector, Changes, Shares): a vector type, and two records of such vectors.

    A vector has a number for each of `count` pairs.
    """
    vector = wp.types.vector(length=count, dtype=f64)

    @wp.struct
    class Changes:
        """Changes of the corrections of pairs [m/s]."""

        dv: vector
        dvt: vector
        dvr: vector

    @wp.struct
    class Shares:
        """Changes of velocities and rim speeds by corrections of 1 m/s (eqs. 7, 22 and 37)."""

        i: vector  # of the velocity of i; unused if masses are equal
        j: vector
        rim_i: vector
        rim_j: vector
        part: vector  # c_i of eq. 37

    return vector, Changes, Shares


@cache
def lanes(
    count: int, weighted: bool = False, friction: bool = False, rolling: bool = False, keep: bool = False
) -> SimpleNamespace:
    """Return Warp functions, as attributes, each of which processes the pairs c to c + count - 1 at once.

    `push` adds changes of corrections to velocities and, with friction, to rim speeds (eqs. 7, 23 and 37). If
    not `weighted`, grains of equal mass get one half each: halving the normal is exact, and saves a product
    on the path from one pair to the next with the same grain. (Otherwise a plain step takes 4 to 7 % longer.)
    With `keep`, `push` also saves the velocities that it yields. `roll` returns the rolling speed after a
    tangential correction.
    """
    vector, pair_changes, pair_shares = records(count)
    half, of_i, of_j = ("", " * shares.i.c[k]", " * shares.j.c[k]") if weighted else (" * 0.5", "", "")

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
        checked(f"""
        wp::vec_t<{count}, double> vr;
        for (int k = 0; k < {count}; k++) {{
            const unsigned i = pairs.data[c + k].i / 2, j = pairs.data[c + k].j / 2;
            const double slid_i = rim.data[i] - dvt.c[k] * shares.rim_i.c[k];
            const double slid_j = rim.data[j] - dvt.c[k] * shares.rim_j.c[k];
            vr.c[k] = shares.part.c[k] * slid_i - (1.0 - shares.part.c[k]) * slid_j;
        }}
        return vr;
    """)
    )
    def roll(rim: Floats, pairs: Pairs, c: int, dvt: vector, shares: pair_shares) -> vector: ...

    @wp.func_native(
        checked(f"""{VELOCITIES}
        for (int k = 0; k < {count}; k++) {{
            const unsigned i = pairs.data[c + k].i, j = pairs.data[c + k].j;
            const auto n = pairs.data[c + k].n;
            const couple normal = *(const couple *)&n{half};
            couple impulse = normal * change.dv.c[k];
            {TURN if friction else ""}
            {ROLL if rolling else ""}
            couple *vi = velocity_at(i), *vj = velocity_at(j);
            const couple after_i = *vi - impulse{of_i}, after_j = *vj + impulse{of_j};
            *vi = after_i;
            *vj = after_j;
            {KEEP if keep else ""}
        }}
    """)
    )
    def push(
        velocity: Vectors,
        rim: Floats,
        pairs: Pairs,
        c: int,
        change: pair_changes,
        shares: pair_shares,
        kept: Vectors,
        slot: int,
    ): ...

    return SimpleNamespace(
        numbers_at=numbers_at,
        set_numbers=set_numbers,
        sum_of=sum_of,
        product_of=product_of,
        larger_of=larger_of,
        approach=approach,
        gap_rates=gap_rates,
        slip=slip,
        roll=roll,
        push=push,
    )
