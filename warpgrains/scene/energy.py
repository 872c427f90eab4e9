"""Kinetic energy of grains."""

from warpgrains.base.arrays import FloatArray

TOLERANCES = 30.0  # speed of grains at rest, in tolerances: soft packings move on at such speeds


def kinetic_energy(
    mass: FloatArray, radius: FloatArray, velocity: FloatArray, spin: FloatArray | float
) -> FloatArray:
    """Return the sum of m v^2 / 2 and, if the spin is not 0.0, m r^2 w^2 / 4 of discs [J], shape (...)."""
    translation = 0.5 * (mass * (velocity**2).sum(axis=-1)).sum(axis=-1)
    rotation = 0.25 * (mass * radius**2 * spin**2).sum(axis=-1)
    total: FloatArray = translation + rotation
    return total
