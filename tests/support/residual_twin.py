"""The natural residual of a simulation's last step (kernels/MODEL.md, eq. 12), in NumPy, over all pairs."""

import numpy as np
from same_bits import at_annulus
from schemes import contact_mass, without_contacts
from scipy.spatial import KDTree

from warpgrains import Simulation
from warpgrains.arrays import FloatArray


def free_velocity(simulation: Simulation) -> FloatArray:
    """Velocities that the next step begins with [m/s]."""
    return without_contacts(simulation.scene, simulation.velocity, simulation.state().staggered)


def twin_residual(simulation: Simulation, free_velocity: FloatArray) -> float:
    """Eta of the last step, for velocities rebuilt from the corrections [m/s]."""
    scene, contacts = simulation.scene, simulation.contacts()
    dv_pair = np.zeros((scene.n, scene.n))
    dv_pair[tuple(contacts.pair.T)] = contacts.correction
    position = simulation.last_start().position
    rho = np.hypot(*position.T)
    n_wall, dv_wall = position / rho[:, None], at_annulus(simulation).correction
    v = free_velocity - dv_wall[:, None] * n_wall
    i, j = contacts.pair.T
    d = position[j] - position[i]
    impulse = (contacts.correction / np.hypot(*d.T))[:, None] * d
    mass = contact_mass(scene)
    share = (mass[j] / (mass[i] + mass[j]))[:, None]
    np.subtract.at(v, i, impulse * share)
    np.add.at(v, j, impulse * (1.0 - share))
    # A pair that carries nothing has an error only if it is so near that it can close its gap in the step.
    reach = 2.0 * (scene.radius.max() + scene.dt * np.hypot(*v.T).max())
    near = KDTree(position).query_pairs(reach, output_type="ndarray")
    i, j = np.concatenate([contacts.pair, near]).T
    d = position[j] - position[i]
    distance = np.hypot(*d.T)
    vn, dv = np.sum((v[i] - v[j]) * d, axis=1) / distance, dv_pair[i, j]
    gap = distance - scene.radius[i] - scene.radius[j]
    vn_wall, gap_out = np.sum(v * n_wall, axis=1), scene.radius_out - rho - scene.radius
    if scene.wall == "round":
        path = scene.dt * (v[:, 1] * n_wall[:, 0] - v[:, 0] * n_wall[:, 1])
        gap_out = np.sqrt((scene.radius_out - scene.radius) ** 2 - path**2) - rho
    sides = [(vn, dv, gap), (vn_wall, np.maximum(dv_wall, 0.0), gap_out)]
    if scene.radius_in > 0.0:
        sides.append((-vn_wall, np.maximum(-dv_wall, 0.0), rho - scene.radius_in - scene.radius))
    errors = [np.abs(np.maximum(0.0, dv + vn - gap / scene.dt) - dv) for vn, dv, gap in sides]
    return max(error.max(initial=0.0) for error in errors)
