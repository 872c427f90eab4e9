"""What a state of a scene amounts to: energies, forces on the walls, height and density of a pile."""

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.scene.geometry import area_below
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.solver.forces import wall_contacts


def quantities(scene: Scene, state: State) -> dict[str, float]:
    """Return all of them by name, for a state of a scene; each is a function of this file."""
    up = upwards(scene.gravity)
    height = state.position @ up
    outer, inner = wall_forces(scene, state)
    return {
        "kinetic_energy": kinetic_energy(scene.mass, state.velocity),
        "potential_energy": potential_energy(scene.mass, state.position, scene.gravity),
        "outer_wall_force": outer,
        "inner_wall_force": inner,
        "pile_height": pile_height(height, scene),
        "packing_fraction": packing_fraction(height, scene),
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


def pile_height(height: FloatArray, scene: Scene) -> float:
    """Return how far the highest point of a grain is above the lowest point of the walls [m].

    Heights are those of the grains' centres above the origin [m], shape (n,).
    """
    return float((height + scene.radius).max() + scene.walls.depth)


def packing_fraction(height: FloatArray, scene: Scene) -> float:
    """Return which share of the space between the walls the grains fill, beneath their mean height.

    Below the mean of the heights, weighted by area, a pile is dense; its loose surface does not count, nor
    does where the walls end. Grains and space are cut at that height exactly.

    Heights are those of the grains' centres above the origin [m], shape (n,).
    """
    radius = scene.radius
    mean = (radius**2 * height).sum() / (radius**2).sum()
    return float(area_below(radius, mean - height).sum() / scene.walls.area_below(mean))
