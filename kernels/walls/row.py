"""An infinite row of equal discs at equal spacing, of which a grain touches the nearest disc."""

import warp as wp

from ..types import Shape

f64 = wp.float64
KIND = wp.constant(f64(5.0))


@wp.func
def nearest_center(x: wp.vec2d, row: Shape) -> wp.vec2d:
    """Return the center nearest to x [m]; row[1:] = a center, vector to the next center, radius."""
    dx, dy = row[3], row[4]
    discs = wp.rint(((x[0] - row[1]) * dx + (x[1] - row[2]) * dy) / (dx * dx + dy * dy))
    return wp.vec2d(row[1] + discs * dx, row[2] + discs * dy)
