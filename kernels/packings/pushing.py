"""The kernel that pushes overlapping discs apart, one pair after the other, for dense packings."""

import warp as wp

from ..access import at
from ..walls.shapes import shape_gap, shape_normal
from ..walls.walls import Walls, place_at, way
from .placing import Bounds

f64 = wp.float64

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def put_inside(x: wp.vec2d, r: f64, walls: Walls, bounds: Bounds) -> wp.vec2d:
    """Return position x of a disc of radius r, moved out of walls, into the annulus and into bounds [m]."""
    for k in range(walls.shape.shape[0]):
        shape, place = at(walls.shape, k), place_at(k + 1, x, walls)
        gap = shape_gap(place, r, shape)
        if gap < f64(0.0):
            x = x + gap * shape_normal(place, shape)
    x = wp.vec2d(wp.max(x[0], bounds.low[0] + r), wp.max(x[1], bounds.low[1] + r))
    x = wp.vec2d(wp.min(x[0], bounds.high[0] - r), wp.min(x[1], bounds.high[1] - r))
    rho = wp.length(x)
    if rho > walls.annulus.radius_out - r:
        x = x * ((walls.annulus.radius_out - r) / rho)
    if walls.annulus.radius_in > f64(0.0) and rho > f64(0.0) and rho < walls.annulus.radius_in + r:
        x = x * ((walls.annulus.radius_in + r) / rho)
    return x


@wp.kernel
def push(
    position: wp.array(dtype=wp.vec2d),
    radius: wp.array(dtype=f64),
    pair: wp.array(dtype=wp.vec2i),
    walls: Walls,
    bounds: Bounds,
    sweeps: int,
    enough: f64,
    worst: wp.array(dtype=f64),
):
    """Push overlapping discs of the given pairs apart, the smaller disc by more, in at most `sweeps` sweeps.

    After the pairs, a sweep moves discs out of walls and into bounds. The sweeps end when the largest
    overlap, divided by the smaller radius, is at most `enough`. worst : [this overlap in the last sweep;
    number of sweeps done]
    """
    done, largest = int(0), f64(wp.inf)
    while done < sweeps and largest > enough:
        largest = f64(0.0)
        for k in range(pair.shape[0]):
            i, j = pair[k][0], pair[k][1]
            d = way(position[i], position[j], walls)
            r_i, r_j = radius[i], radius[j]
            apart = wp.length(d)
            overlap = r_i + r_j - apart
            if overlap > f64(0.0) and apart > f64(0.0):
                largest = wp.max(largest, overlap / wp.min(r_i, r_j))
                n = d / apart
                share = r_j * r_j / (r_i * r_i + r_j * r_j)
                position[i] = position[i] - n * (overlap * share)
                position[j] = position[j] + n * (overlap * (f64(1.0) - share))
        for i in range(position.shape[0]):
            x = put_inside(position[i], radius[i], walls, bounds)
            largest = wp.max(largest, wp.length(x - position[i]) / radius[i])
            position[i] = x
        done = done + 1
    worst[0] = largest
    worst[1] = f64(done)
