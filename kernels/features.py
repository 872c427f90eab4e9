"""What a grain has of its own, or shares with all: read from one entry where a scene makes no difference."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .data import Grains
from .variant import Variant

f64 = wp.float64


@cache
def functions(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the functions for one kind of scene."""

    @wp.func
    def radius_of(grains: Grains, i: int) -> f64:
        """Radius of a grain [m]."""
        if wp.static(variant.distinct_radii):
            return grains.radius[i]
        return grains.radius[0]

    @wp.func
    def mass_of(grains: Grains, i: int) -> f64:
        """Mass of a grain [kg]."""
        if wp.static(variant.distinct_masses):
            return grains.mass[i]
        return grains.mass[0]

    return SimpleNamespace(radius_of=radius_of, mass_of=mass_of)
