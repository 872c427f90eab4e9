"""Reading, writing and comparing in the innermost loops: one instruction, and nothing else.

Warp's own indexing allows negative indices and any stride; a sweep would pay a fifth of its time for that.
The arrays are contiguous and the indices are the solver's own. For Warp's `max`, which looks whether either
number is none, it would pay a tenth.
"""

import warp as wp

from .types import Pair
from .walls import WallContact

f64 = wp.float64


@wp.func
def larger(a: f64, b: f64) -> f64:
    """The larger number; a where either is none."""
    return wp.where(b > a, b, a)


@wp.func_native("return vectors.data[i];")
def vector_at(vectors: wp.array(dtype=wp.vec2d), i: int) -> wp.vec2d:
    """Read a vector."""
    ...


@wp.func_native("vectors.data[i] = value;")
def set_vector(vectors: wp.array(dtype=wp.vec2d), i: int, value: wp.vec2d):
    """Write a vector."""
    ...


@wp.func_native("return numbers.data[c];")
def number_at(numbers: wp.array(dtype=f64), c: int) -> f64:
    """Read a number."""
    ...


@wp.func_native("numbers.data[c] = value;")
def set_number(numbers: wp.array(dtype=f64), c: int, value: f64):
    """Write a number."""
    ...


@wp.func_native("return pairs.data[c].n;")
def normal_of(pairs: wp.array(dtype=Pair), c: int) -> wp.vec2d:
    """Read a pair's unit normal."""
    ...


@wp.func_native("return pairs.data[c].gap_rate;")
def gap_rate_of(pairs: wp.array(dtype=Pair), c: int) -> f64:
    """Read a pair's gap / dt [m/s]."""
    ...


@wp.func_native("return pairs.data[c].i;")
def first_of(pairs: wp.array(dtype=Pair), c: int) -> int:
    """Read a pair's first grain."""
    ...


@wp.func_native("return pairs.data[c].j;")
def second_of(pairs: wp.array(dtype=Pair), c: int) -> int:
    """Read a pair's second grain."""
    ...


@wp.func_native("wall = walls.data[c];")
def read_wall(walls: wp.array(dtype=WallContact), c: int, wall: wp.ref[WallContact]):
    """Read a contact with a wall."""
    ...


@wp.func_native("walls.data[c].dv = value;")
def set_wall_dv(walls: wp.array(dtype=WallContact), c: int, value: f64):
    """Write the correction of a contact with a wall."""
    ...
