"""Shares of tangential corrections, which only scenes with friction have (MODEL.md, eq. 22).

Rotation is kept as the rim speed, the radius times the spin, so that no contact needs a radius.
"""

import warp as wp

from . import law
from .access import at
from .record import Scene, grain_count, has_weights

f64 = wp.float64
THIRD = wp.constant(f64(1.0 / 3.0))


@wp.func
def rim_weights(s: Scene, c: int, at_wall: bool) -> wp.vec3d:
    """Return 1 / K_t of a contact, and the parts of a tangential correction that its rims take (eq. 22)."""
    if has_weights(s):
        return at(s.contacts.rim_weights, c)
    if at_wall:
        return wp.vec3d(THIRD, f64(2.0), f64(0.0))
    return wp.vec3d(THIRD, f64(1.0), f64(1.0))


@wp.func
def find_rim_weights(s: Scene, i: int, j: int) -> wp.vec3d:
    """Compute the rim weights of a contact from the masses of grain i, and of grain or wall j."""
    k_i = f64(2.0) * at(s.grains.contact_mass, i) / at(s.grains.rim_mass, i)
    if j >= grain_count(s):
        return wp.vec3d(f64(1.0) / (f64(1.0) + k_i), k_i, f64(0.0))
    mass_i, mass_j = at(s.grains.contact_mass, i), at(s.grains.contact_mass, j)
    k_j = f64(2.0) * mass_j / at(s.grains.rim_mass, j)
    part_i = law.mass_share(mass_i, mass_j) * k_i
    part_j = law.mass_share(mass_j, mass_i) * k_j
    return wp.vec3d(f64(1.0) / (f64(1.0) + part_i + part_j), part_i, part_j)
