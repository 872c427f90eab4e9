"""Reading and writing in the innermost loops: the address, and nothing else.

Warp's own indexing allows negative indices and any stride; a sweep would pay a fifth of its time for that.
The arrays are contiguous and the indices are the solver's own.
"""

import warp as wp

from .types import Pair
from .walls import WallContact

f64 = wp.float64


@wp.func_native("return velocity.data[i];")
def velocity_of(velocity: wp.array(dtype=wp.vec2d), i: int) -> wp.vec2d:
    """Read a velocity [m/s]."""
    ...


@wp.func_native("velocity.data[i] = value;")
def set_velocity(velocity: wp.array(dtype=wp.vec2d), i: int, value: wp.vec2d):
    """Write a velocity [m/s]."""
    ...


@wp.func_native("return pairs.data[c].n;")
def normal_of(pairs: wp.array(dtype=Pair), c: int) -> wp.vec2d:
    """Read a unit normal."""
    ...


@wp.func_native("return pairs.data[c].gap_rate;")
def gap_rate_of(pairs: wp.array(dtype=Pair), c: int) -> f64:
    """Read gap / dt [m/s]."""
    ...


@wp.func_native("return pairs.data[c].i;")
def first_of(pairs: wp.array(dtype=Pair), c: int) -> int:
    """Read a pair's first grain."""
    ...


@wp.func_native("return pairs.data[c].j;")
def second_of(pairs: wp.array(dtype=Pair), c: int) -> int:
    """Read a pair's second grain."""
    ...


@wp.func_native("return dv.data[c];")
def dv_of(dv: wp.array(dtype=f64), c: int) -> f64:
    """Read a correction [m/s]."""
    ...


@wp.func_native("dv.data[c] = value;")
def set_dv(dv: wp.array(dtype=f64), c: int, value: f64):
    """Write a correction [m/s]."""
    ...


@wp.func_native("return walls.data[c].i;")
def grain_of(walls: wp.array(dtype=WallContact), c: int) -> int:
    """Read which grain may reach a wall."""
    ...


@wp.func_native("return walls.data[c].n;")
def wall_normal_of(walls: wp.array(dtype=WallContact), c: int) -> wp.vec2d:
    """Read a unit normal."""
    ...


@wp.func_native("return walls.data[c].gap_rate_out;")
def outer_gap_rate_of(walls: wp.array(dtype=WallContact), c: int) -> f64:
    """Read gap / dt at the outer wall [m/s]."""
    ...


@wp.func_native("return walls.data[c].gap_rate_in;")
def inner_gap_rate_of(walls: wp.array(dtype=WallContact), c: int) -> f64:
    """Read gap / dt at the inner wall [m/s]."""
    ...


@wp.func_native("return walls.data[c].dv;")
def wall_dv_of(walls: wp.array(dtype=WallContact), c: int) -> f64:
    """Read a correction at the walls [m/s]."""
    ...


@wp.func_native("walls.data[c].dv = value;")
def set_wall_dv(walls: wp.array(dtype=WallContact), c: int, value: f64):
    """Write a correction at the walls [m/s]."""
    ...


@wp.func_native("return weights.data[c];")
def weight_of(weights: wp.array(dtype=wp.vec2d), c: int) -> wp.vec2d:
    """Read the mass shares of a pair."""
    ...
