"""Reading, writing and comparing in the innermost loops: one instruction, and nothing else.

Warp's own indexing allows negative indices and any stride; a sweep would pay a fifth of its time for that.
Loops over grains and pairs are `while` loops: a turn of Warp's `range` takes a dozen instructions.
The arrays are contiguous and the indices are the solver's own. For Warp's `max`, which looks whether either
number is none, it would pay a tenth.
"""

import warp as wp

from .types import Pair, WorkingPair
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


@wp.func_native("return bits.data[i];")
def bits_at(bits: wp.array(dtype=wp.uint64), i: int) -> wp.uint64:
    """Read 64 bits."""
    ...


@wp.func_native("bits.data[i] = value;")
def set_bits(bits: wp.array(dtype=wp.uint64), i: int, value: wp.uint64):
    """Write 64 bits."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __ffsll(bits) - 1;
#else
    return __builtin_ctzll(bits);
#endif
""")
def lowest_bit(bits: wp.uint64) -> int:
    """The lowest bit that is set, if one is."""
    ...


@wp.func_native("return triples.data[k];")
def triple_at(triples: wp.array(dtype=wp.vec3d), k: int) -> wp.vec3d:
    """Read three numbers."""
    ...


@wp.func_native("triples.data[k] = value;")
def set_triple(triples: wp.array(dtype=wp.vec3d), k: int, value: wp.vec3d):
    """Write three numbers."""
    ...


@wp.func_native("return integers.data[c];")
def integer_at(integers: wp.array(dtype=wp.int32), c: int) -> int:
    """Read an integer."""
    ...


@wp.func_native("integers.data[c] = value;")
def set_integer(integers: wp.array(dtype=wp.int32), c: int, value: int):
    """Write an integer."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return atomicAdd(counts.data + k, 1);
#else
    return counts.data[k]++;
#endif
""")
def count_one(counts: wp.array(dtype=wp.int32), k: int) -> int:
    """Count one more, in a stage that adds up (stages.py). Returns how many there were."""
    ...


@wp.func_native("return couples.data[k];")
def couple_at(couples: wp.array(dtype=wp.vec2i), k: int) -> wp.vec2i:
    """Read two integers."""
    ...


@wp.func_native("couples.data[k] = value;")
def set_couple(couples: wp.array(dtype=wp.vec2i), k: int, value: wp.vec2i):
    """Write two integers."""
    ...


@wp.func_native("return entries.data[k];")
def entry_at(entries: wp.array(dtype=wp.vec3i), k: int) -> wp.vec3i:
    """Read three integers."""
    ...


@wp.func_native("entries.data[k] = value;")
def set_entry(entries: wp.array(dtype=wp.vec3i), k: int, value: wp.vec3i):
    """Write three integers."""
    ...


@wp.func_native("pairs.data[c] = {source.data[k].n, 2u * source.data[k].i, 2u * source.data[k].j};")
def copy_pair(pairs: wp.array(dtype=WorkingPair), c: int, source: wp.array(dtype=Pair), k: int):
    """Make a working pair of a pair."""
    ...


@wp.func_native("return pairs.data[c].n;")
def normal_of(pairs: wp.array(dtype=Pair), c: int) -> wp.vec2d:
    """Read a pair's unit normal."""
    ...


@wp.func_native("pairs.data[c].i = i; pairs.data[c].j = j;")
def set_grains(pairs: wp.array(dtype=Pair), c: int, i: int, j: int):
    """Write a pair's grains."""
    ...


@wp.func_native("pairs.data[c].n = n; pairs.data[c].gap_rate = gap_rate;")
def freeze_pair(pairs: wp.array(dtype=Pair), c: int, n: wp.vec2d, gap_rate: f64):
    """Write a pair's unit normal, and its gap / dt [m/s]."""
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


@wp.func
def vn_of(velocity: wp.array(dtype=wp.vec2d), pairs: wp.array(dtype=Pair), c: int) -> f64:
    """The velocity at which a pair closes its gap [m/s]."""
    difference = vector_at(velocity, first_of(pairs, c)) - vector_at(velocity, second_of(pairs, c))
    return wp.dot(difference, normal_of(pairs, c))


@wp.func_native("wall = walls.data[c];")
def read_wall(walls: wp.array(dtype=WallContact), c: int, wall: wp.ref[WallContact]):
    """Read a contact with a wall."""
    ...


@wp.func_native("walls.data[c] = wall;")
def set_wall(walls: wp.array(dtype=WallContact), c: int, wall: WallContact):
    """Write a contact with a wall."""
    ...


@wp.func_native("return walls.data[c].dv;")
def wall_dv_at(walls: wp.array(dtype=WallContact), c: int) -> f64:
    """Read the correction of a contact with a wall."""
    ...


@wp.func_native("walls.data[c].dv = value;")
def set_wall_dv(walls: wp.array(dtype=WallContact), c: int, value: f64):
    """Write the correction of a contact with a wall."""
    ...
