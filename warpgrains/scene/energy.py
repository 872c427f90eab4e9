"""Kinetic energy of grains."""

from warpgrains.arrays import FloatArray

TOLERANCES = 30.0  # speed of grains at rest, in tolerances: soft packings move on at such speeds


def kinetic_energy(
    mass: FloatArray, radius: FloatArray, velocity: FloatArray, spin: FloatArray | float
) -> FloatArray:
    """Return the sum of m v^2 / 2 and, for the rotation of discs, m r^2 w^2 / 4 [J], shape (...).

    Masses [kg], radii [m] and spins [rad/s] have shape (..., n), velocities [m/s] (..., n, 2). A spin 0.0
    leaves rotation out.
    """
    translation = 0.5 * (mass * (velocity**2).sum(axis=-1)).sum(axis=-1)
    rotation = 0.25 * (mass * radius**2 * spin**2).sum(axis=-1)
    total: FloatArray = translation + rotation
    return total
