"""Kinetic energy of grains."""

from warpgrains.base.arrays import FloatArray

TOLERANCES = 30.0  # grains slower than this times the tolerance count as resting: soft packings creep on


def kinetic_energy(
    mass: FloatArray, radius: FloatArray, velocity: FloatArray, spin: FloatArray | float
) -> FloatArray:
    """Return the sum of m v^2 / 2 + m r^2 spin^2 / 4 over n discs [J], shape (...) for masses (..., n)."""
    translation = 0.5 * (mass * (velocity**2).sum(axis=-1)).sum(axis=-1)
    rotation = 0.25 * (mass * radius**2 * spin**2).sum(axis=-1)
    total: FloatArray = translation + rotation
    return total
