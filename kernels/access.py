"""Functions that read and write array elements in the innermost loops, with one instruction each.

Warp's own indexing allows negative indices and any stride, which costs 20 % of a sweep. Here the arrays are
contiguous, and all indices come from the solver. Loops over grains and pairs are `while` loops, because an
iteration of Warp's `range` takes a dozen instructions. Warp's `max` tests for NaN first, which costs 10 % of
a sweep; `larger` does not.

In **checked mode** every index is tested against the length of its array. The first index outside its array
is written to the scene's `Violation`, which `warpgrains.solver.records` reports. (Warp's own debug mode names
neither array nor index, and ends the process.) The environment variable WARPGRAINS_CHECK_BOUNDS=1, read when
this module is imported, sets the mode for the whole process.
"""

import os
import re
from collections.abc import Callable
from typing import Any

import warp as wp

from .types import Contact, Drive, Motion, Pose, Shape

f64 = wp.float64
CHECKED = os.environ.get("WARPGRAINS_CHECK_BOUNDS") == "1"
CHECK = """
    const auto within = [](const auto &array, int i) {
        if (i >= 0 && i < array.shape[0])
            return i;
        long long *violation = (long long *)array.grad;
        if (violation && violation[0] == 0) {
            violation[0] = 1;
            violation[1] = (long long)array.data;
            violation[2] = array.shape[0];
            violation[3] = i;
        }
        return 0;
    };
"""
"""C++ that returns index i if it is within the array, and 0 otherwise.

It writes the first index outside to the scene's `Violation`. The array's pointer to a gradient, which has no
other use here, holds the address of the `Violation`.
"""


def named(name: str) -> Callable[[Callable[..., Any]], wp.Function]:
    """Return a decorator that makes a Warp function with this name, for one of several variants."""

    def function(made: Callable[..., Any]) -> wp.Function:
        made.__name__ = made.__qualname__ = name
        return wp.func(made)

    return function


def checked(code: str) -> str:
    """Return `code`, the C++ of a native function; in checked mode, with a test of every index.

    The indices are the INDEX in each ARRAY.data[INDEX]; `CHECK` has the test.
    """
    if not CHECKED:
        return code
    return CHECK + re.sub(r"([\w.]+)\.data\[([^]]+)\]", r"\1.data[within(\1, \2)]", code)


NUMBERS = (f64, wp.int32, wp.uint64, wp.vec2d, wp.vec3d, wp.mat33d, wp.vec2i, wp.vec3i)
VALUES = (*NUMBERS, Shape, Motion, Pose, Drive)
for dtype in VALUES:

    @wp.func_native(checked("return array.data[i];"))
    def at(array: wp.array(dtype=dtype), i: int) -> dtype:
        """Read an element."""
        ...


for dtype in (*VALUES, Contact):

    @wp.func_native(checked("array.data[i] = value;"))
    def put(array: wp.array(dtype=dtype), i: int, value: dtype):
        """Write an element."""
        ...


@wp.func_native(
    checked("""
#if defined(__CUDA_ARCH__)
    wp::atomic_max(&array.data[i], value);
#else
    double before = array.data[i];
    while (value > before && !__atomic_compare_exchange(
            &array.data[i], &before, &value, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {}
#endif
""")
)
def raise_to(array: wp.array(dtype=f64), i: int, value: f64):
    """Set array[i] = max(array[i], value) atomically."""
    ...


@wp.func_native(
    checked("""
#if defined(__CUDA_ARCH__)
    return atomicAdd(&array.data[i], amount);
#else
    const int before = array.data[i];
    array.data[i] = before + amount;
    return before;
#endif
""")
)
def add(array: wp.array(dtype=wp.int32), i: int, amount: int) -> int:
    """Set array[i] += amount; return the value of array[i] before.

    A stage that calls it must be atomic (`stages.Each`): only the GPU adds atomically.
    """
    ...


for dtype in (f64, wp.int32, wp.vec3d):

    @wp.func_native(checked("for (int i = 0; i < array.shape[0]; i++) array.data[i] = {};"))
    def clear(array: wp.array(dtype=dtype)):
        """Set all elements to 0."""
        ...


@wp.func
def larger(a: f64, b: f64) -> f64:
    """Return max(a, b), or a if either is NaN."""
    return wp.where(b > a, b, a)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __ffsll(bits) - 1;
#else
    return __builtin_ctzll(bits);
#endif
""")
def lowest_bit(bits: wp.uint64) -> int:
    """Return the index, from 0, of the lowest bit that is set; undefined if no bit is set."""
    ...


CONTIGUOUS = "__builtin_assume(i >= 0 && array.strides[0] == sizeof(*array.data)); return i;"


@wp.func_native((CHECK + "return within(array, i);") if CHECKED else CONTIGUOUS)
def index_of(array: wp.array(dtype=Contact), i: int) -> int:
    """Return the index i itself; in checked mode, test first that it is within the array of contacts.

    `contact_at` then reads the contact, because a native function cannot return a record.
    """
    ...


@wp.func
def contact_at(contacts: wp.array(dtype=Contact), c: int) -> Contact:
    """Return contacts[c]."""
    return contacts[index_of(contacts, c)]


@wp.func
def bodies_of(contact: Contact):
    """Return (i, j) of a contact: grain i, and grain j or, if j >= n, wall j - n.

    n is the number of grains.
    """
    return int(contact.i // wp.uint32(2)), int(contact.j // wp.uint32(2))
