"""The residual eta of a simulation's last step (kernels/MODEL.md, eq. 12), in NumPy, over all pairs."""

import numpy as np
from same_bits import at_annulus, dense_pair_correction
from schemes import contact_mass, without_contacts

from warpgrains import Simulation
from warpgrains.base.arrays import FloatArray


def free_velocity(simulation: Simulation) -> FloatArray:
    """Return the velocities after the next step without contacts [m/s], shape (n, 2)."""
    return without_contacts(simulation.scene, simulation.velocity, simulation.state().staggered)


def twin_residual(simulation: Simulation, free_velocity: FloatArray) -> float:
    """Return eta of the last step [m/s], with the velocities that its corrections give.

    `free_velocity` are the velocities after this step without contacts [m/s], shape (n, 2).
    """
    scene, position, mass = simulation.scene, simulation.last_start().position, contact_mass(simulation.scene)
    rho, wall = np.hypot(*position.T), at_annulus(simulation).correction
    outward = position / rho[:, None]
    v = free_velocity - wall[:, None] * outward
    i, j = np.triu_indices(scene.n, 1)
    dv, d = dense_pair_correction(simulation), position[j] - position[i]
    distance = np.hypot(*d.T)
    n, carries = d / distance[:, None], dv != 0.0
    share = mass[j] / (mass[i] + mass[j])
    np.subtract.at(v, i[carries], ((dv * share)[:, None] * n)[carries])
    np.add.at(v, j[carries], ((dv * (1.0 - share))[:, None] * n)[carries])
    outer = scene.radius_out - rho - scene.radius
    if scene.wall == "round":
        path = scene.dt * (v[:, 1] * outward[:, 0] - v[:, 0] * outward[:, 1])
        outer = np.sqrt((scene.radius_out - scene.radius) ** 2 - path**2) - rho
    vn, vn_wall = np.sum((v[i] - v[j]) * n, axis=1), np.sum(v * outward, axis=1)
    sides = [(vn, dv, distance - scene.radius[i] - scene.radius[j]), (vn_wall, np.maximum(wall, 0.0), outer)]
    if scene.radius_in > 0.0:
        sides.append((-vn_wall, np.maximum(-wall, 0.0), rho - scene.radius_in - scene.radius))
    errors = [np.abs(np.maximum(0.0, dv + vn - gap / scene.dt) - dv) for vn, dv, gap in sides]
    return max(error.max(initial=0.0) for error in errors)
