"""What a state of a scene amounts to: energies, forces on the walls, height and density of a pile."""

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.solver.forces import wall_contacts


def quantities(scene: Scene, state: State) -> dict[str, float]:
    """Return all of them by name; each is a function of this file.

    Parameters
    ----------
    scene : Scene
    state : State
        A state of it.
    """
    up = upwards(scene.gravity)
    height = state.position @ up
    outer, inner = wall_forces(scene, state)
    return {
        "kinetic_energy": kinetic_energy(scene.mass, state.velocity),
        "potential_energy": potential_energy(scene.mass, state.position, scene.gravity),
        "outer_wall_force": outer,
        "inner_wall_force": inner,
        "pile_height": pile_height(height, scene.radius, scene.radius_out),
        "packing_fraction": packing_fraction(height, scene.radius, scene.radius_in, scene.radius_out),
    }


def upwards(gravity: tuple[float, float]) -> FloatArray:
    """Return the unit vector against gravity [m/s2]; without gravity, that of y."""
    size = np.hypot(*gravity)
    return -np.array(gravity) / size if size > 0.0 else np.array([0.0, 1.0])


def kinetic_energy(mass: FloatArray, velocity: FloatArray) -> float:
    """Return the sum of m v^2 / 2 [J]; masses [kg], shape (n,), velocities [m/s], shape (n, 2)."""
    return float(0.5 * (mass * (velocity**2).sum(axis=1)).sum())


def potential_energy(mass: FloatArray, position: FloatArray, gravity: tuple[float, float]) -> float:
    """Return the sum of -m g . x [J], 0 at the origin; masses [kg], (n,), positions [m], (n, 2)."""
    return float(-(mass * (position @ np.array(gravity))).sum())


def wall_forces(scene: Scene, state: State) -> tuple[float, float]:
    """Return how hard the grains push on the outer and on the inner wall: sums of normal forces [N]."""
    force = wall_contacts(scene, state.corrections).force
    return float(force[force > 0.0].sum()), float(np.abs(force[force < 0.0]).sum())


def pile_height(height: FloatArray, radius: FloatArray, radius_out: float) -> float:
    """Return how far the highest point of a grain is above the lowest point of the outer wall [m].

    Parameters
    ----------
    height
        Of the grains' centres above the origin [m], shape (n,).
    radius
        [m], shape (n,).
    radius_out
        Radius of the outer wall [m].
    """
    return float((height + radius).max() + radius_out)


def packing_fraction(height: FloatArray, radius: FloatArray, radius_in: float, radius_out: float) -> float:
    """Return which share of the space between the walls the grains fill, beneath their mean height.

    Below the mean of the heights, weighted by area, a pile is dense; its loose surface does not count, nor
    does where the walls end. Grains and space are cut at that height exactly.

    Parameters
    ----------
    height
        Of the grains' centres above the origin [m], shape (n,).
    radius
        [m], shape (n,).
    radius_in, radius_out
        Radii of the two walls [m].
    """
    mean = (radius**2 * height).sum() / (radius**2).sum()
    walls = area_below(np.array([radius_out, radius_in]), np.full(2, mean))
    return float(area_below(radius, mean - height).sum() / (walls[0] - walls[1]))


def area_below(radius: FloatArray, level: FloatArray) -> FloatArray:
    """Return the areas [m2] of discs below a level [m], measured from their centres; shapes (n,).

    The segment of a disc of radius r below a level h, -r <= h <= r, has the area
    r^2 (pi/2 + asin(h/r)) + h sqrt(r^2 - h^2).
    """
    h = np.clip(level, -radius, radius)
    angle = np.arcsin(np.divide(h, radius, out=np.zeros_like(h), where=radius > 0.0))
    return radius**2 * (0.5 * np.pi + angle) + h * np.sqrt(radius**2 - h**2)
