"""How far a solved step is from the minimiser (kernels/MODEL.md, eq. 10): in NumPy, over all pairs."""

from dataclasses import dataclass

import numpy as np
from same_bits import at_annulus, dense_pair_correction

from warpgrains import Scene, Simulation
from warpgrains.arrays import FloatArray

EPS = np.finfo(float).eps


@dataclass(frozen=True)
class Solved:
    """A solved step, and what it leaves open, by constraint: all pairs i < j, outer walls, inner walls.

    With J v <= b the constraints, b = gap / dt, and lambda >= 0 the impulses [kg m/s], the velocities v
    minimise 1/2 (v - v*)^T M (v - v*) under J v <= b + delta exactly, where delta is J v - b at constraints
    with lambda > 0, and its positive part elsewhere [m/s]: these are the Karush-Kuhn-Tucker conditions.
    """

    velocity: FloatArray
    impulse: FloatArray
    delta: FloatArray
    delta_rounding: float
    """Rounding of J v - b [m/s]: a dozen operations on numbers as large as velocities and radius_out / dt."""
    velocity_rounding: float
    """How far v is from v* - M^-1 J^T lambda [m/s]: each correction rounds v_i, v_j, dv_c by eps / 2 at most,
    and products with dv by as much."""
    others: int
    """Contacts that may change while one contact is left as it is: those of its two grains."""


def solve_one_step(scene: Scene) -> Solved:
    simulation = Simulation(scene)
    report = simulation.step()
    assert report.converged
    v, pair = simulation.velocity, dense_pair_correction(simulation)
    wall = at_annulus(simulation).correction
    i, j = np.triu_indices(scene.n, 1)
    pair_impulse = scene.mass[i] * scene.mass[j] / (scene.mass[i] + scene.mass[j]) * pair
    wall_impulses = (scene.mass * np.maximum(sign * wall, 0.0) for sign in (1.0, -1.0))
    impulse = np.concatenate([pair_impulse, *wall_impulses])
    pairs = pair_excess(scene, v)
    excess = np.concatenate([pairs, *wall_excess(scene, v)])
    contacts = _contacts_that_change(scene, pairs)
    largest = max(np.abs(array).max() for array in (scene.velocity, v, pair, wall))
    return Solved(
        velocity=v,
        impulse=impulse,
        delta=np.where(impulse > 0.0, excess, np.maximum(excess, 0.0)),
        delta_rounding=12.0 * EPS * (largest + scene.radius_out / scene.dt),
        velocity_rounding=2.0 * EPS * largest * contacts * (report.iterations + 1),
        others=2 * (contacts - 1),
    )


def pair_excess(scene: Scene, v: FloatArray) -> FloatArray:
    """J v - b of all pairs [m/s]."""
    i, j = np.triu_indices(scene.n, 1)
    d = scene.position[j] - scene.position[i]
    distance = np.hypot(*d.T)
    approach = ((v[i] - v[j]) * d).sum(axis=1) / distance
    return approach - (distance - (scene.radius[i] + scene.radius[j])) / scene.dt


def wall_excess(scene: Scene, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """J v - b of all grains at the outer and at the inner wall [m/s]."""
    rho = np.hypot(*scene.position.T)
    outward = (v * scene.position).sum(axis=1) / rho
    outer = outward - (scene.radius_out - rho - scene.radius) / scene.dt
    if scene.radius_in == 0.0:
        return outer, np.full(scene.n, -np.inf)
    return outer, -outward - (rho - scene.radius_in - scene.radius) / scene.dt


def _contacts_that_change(scene: Scene, excess: FloatArray) -> int:
    """Count the most contacts of one grain, its walls as one, whose corrections the last iteration changed.

    It changed none by more than the tolerance, so that J v - b was within a few of it from 0.
    """
    i, j = np.triu_indices(scene.n, 1)
    near = excess > -1e3 * scene.tolerance
    return int(np.bincount(np.concatenate([i[near], j[near]]), minlength=1).max()) + 1
