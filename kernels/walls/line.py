"""An infinite straight wall with grains on one side."""

import warp as wp

from ..types import Shape

f64 = wp.float64
KIND = wp.constant(f64(4.0))


@wp.func
def gap(x: wp.vec2d, radius: f64, line: Shape) -> f64:
    """Return the gap between a grain at x and a line [m]; line[1:] = point, unit vector to the grains."""
    return (x[0] - line[1]) * line[3] + (x[1] - line[2]) * line[4] - radius


@wp.func
def normal(line: Shape) -> wp.vec2d:
    """Return the unit normal from a grain into a line."""
    return wp.vec2d(-line[3], -line[4])
