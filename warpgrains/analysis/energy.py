"""Energies, the energy balance of steps, and the granular temperature."""

from typing import NamedTuple

import numpy as np

from warpgrains.analysis.snapshot import HasState, of_runs, snapshot
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import fields_in_help
from warpgrains.base.errors import InputError
from warpgrains.scene import energy
from warpgrains.scene.scheme import kick_of, spin_kick_of
from warpgrains.scene.snapshot import Snapshot, Snapshots
from warpgrains.space.geometry import left_of


@of_runs
def kinetic_energy(of: Snapshots) -> FloatArray:
    """Return the sum of m v^2 / 2 and, with friction, m r^2 w^2 / 4 for the spins w [J].

    In the leapfrog scheme, velocities, and so this energy, are half a step behind the other quantities.

    Examples
    --------
    >>> f"{analysis.kinetic_energy(simulation):.3f} J"
    '0.179 J'
    """
    return energy.kinetic_energy(of.mass, of.radius, of.velocity, of.spin)


@of_runs
def potential_energy(of: Snapshots) -> FloatArray:
    """Return the sum of -m g . x [J], 0 at the origin, for gravity g at the time of the snapshot.

    Examples
    --------
    >>> f"{analysis.potential_energy(simulation):.3f} J"
    '-24.643 J'
    """
    return -(of.mass * (of.position @ of.gravity[..., np.newaxis])[..., 0]).sum(axis=-1)


def granular_temperature(of: Snapshot | HasState) -> float:
    """Return ``<|v - <v>|^2> / 2`` [m2/s2], the mean square of a component of the velocity fluctuations.

    Examples
    --------
    >>> f"{analysis.granular_temperature(simulation):.3f} m2/s2"
    '0.111 m2/s2'
    """
    velocity = snapshot(of).velocity
    return float(0.5 * ((velocity - velocity.mean(axis=0)) ** 2).sum(axis=1).mean())


@fields_in_help
class EnergyBalance(NamedTuple):
    """Energy [J] that grains gained and lost in a step, or in several if balances are added.

    The kinetic energy, of translation and rotation, changes by gravity_work + wall_work - drag_loss -
    contact_loss, up to rounding.

    Examples
    --------
    >>> balance = analysis.step_energy_balance(simulation)
    >>> balance._fields
    ('gravity_work', 'drag_loss', 'contact_loss', 'friction_loss', 'wall_work')
    """

    gravity_work: float
    """Work of gravity. If gravity is constant, the work is the loss of potential energy up to a term of order
    dt, because a step moves grains with the velocities at its end, and velocities of the leapfrog scheme are
    half a step behind."""
    drag_loss: float
    """Energy dissipated by drag, on translation and on rotation."""
    contact_loss: float
    """Energy dissipated by contacts, by impacts and by friction; negative in steps in which energy grows:
    where overlaps are removed and, with friction, where grains bounce (kernels/MODEL.md, "Restitution")."""
    friction_loss: float = 0.0
    """Part of `contact_loss` due to friction: tangential forces times slip."""
    wall_work: float = 0.0
    """Work of walls that rotate or move: forces on grains times the velocity of the wall's surface."""

    @property
    def impact_loss(self) -> float:
        """Part of `contact_loss` due to normal forces [J]."""
        return self.contact_loss - self.friction_loss


def step_energy_balance(of: Snapshot | HasState) -> EnergyBalance:
    """Return the energy balance of the last step from its forces and velocities; 0 before the first step.

    From v before the step to v' after it, m (v' - v) = dt F, so the kinetic energy changes by
    dt F . (v + v') / 2, a sum over the forces, and that of rotation likewise by torques and spins. The free
    velocity is v* = v' - dt F_contacts / M with the contact mass M (kernels/MODEL.md, eq. 17b), and v follows
    from it by eq. 2, or by eqs. 16 and 17; free spins follow with the inertia J r^2 / 2 of eq. 22.

    Raises
    ------
    InputError
        A force or a pressure drives a wall, or there is rolling friction.

    Examples
    --------
    >>> balance = analysis.step_energy_balance(simulation)
    >>> balance.drag_loss > 0.0, balance.contact_loss >= 0.0
    (True, True)
    """
    now = snapshot(of)
    for field, is_set in (
        ("walls that a pressure or a force drives", now.scene.has_driven_walls),
        ("rolling_friction", now.scene.has_rolling_friction),
    ):
        if is_set:
            raise InputError(f"the energy balance of a step cannot be computed with {field}")
    if now.steps == 0:
        return EnergyBalance(0.0, 0.0, 0.0)
    scene = now.start_scene
    mass, start = scene.mass[:, np.newaxis], now.start_time
    normal_force = _sums(now, now.loads.force, now.loads.normal)
    free = now.velocity - scene.dt * contact_forces(now) / scene.contact_mass[:, np.newaxis]
    kick = kick_of(scene, free, now.velocity, staggered=now.start_staggered, time=start)
    mean = 0.5 * (kick.before + now.velocity)
    pushed = 0.0  # work of normal forces of moving walls [J]
    if scene.has_moving_walls:
        speed = scene.wall_speeds(now.start, now.wall, start)[:, 0]
        pushed = float(-scene.dt * (now.wall_force * speed).sum())
    balance = EnergyBalance(
        gravity_work=float((kick.time * mass * mean * scene.gravity_at(start)).sum()),
        drag_loss=float((scene.drag * kick.path * mean).sum()),
        contact_loss=pushed - float((scene.dt * normal_force * mean).sum()),
        wall_work=pushed,
    )
    return _with_friction(balance, now, mean) if scene.has_friction else balance


def _with_friction(balance: EnergyBalance, now: Snapshot, mean: FloatArray) -> EnergyBalance:
    """Return the balance with spin drag, friction and the tangential work of walls added [J].

    `mean` are the velocities (v + v') / 2 of the step [m/s], shape (n, 2).
    """
    scene, (grain, normal, _, tangential) = now.start_scene, now.loads
    turn = -scene.dt * scene.radius * np.bincount(grain, tangential, now.n)  # angular impulse
    free = now.spin - turn / (0.5 * scene.rim_mass * scene.radius**2)
    kick = spin_kick_of(scene, free, now.spin, staggered=now.start_staggered)
    spin = 0.5 * (kick.before + now.spin)
    surface = (mean[grain] * left_of(normal)).sum(axis=1) + (scene.radius * spin)[grain]
    work = -scene.dt * tangential * surface  # on the grains [J]
    speed = scene.wall_speeds(now.start, now.wall, now.start_time)[:, 1]
    wall_work = float(-scene.dt * (now.wall_tangential_force * speed).sum())
    friction_loss = wall_work - float(work.sum())
    return balance._replace(
        drag_loss=balance.drag_loss + float((scene.spin_drag * kick.path * spin).sum()),
        contact_loss=balance.contact_loss + friction_loss,
        friction_loss=friction_loss,
        wall_work=balance.wall_work + wall_work,
    )


def contact_forces(of: Snapshot | HasState) -> FloatArray:
    """Return the sum of the forces of all contacts on each grain [N], shape (n, 2).

    Examples
    --------
    >>> analysis.contact_forces(simulation).shape
    (15, 2)
    """
    now = snapshot(of)
    normal_force = _sums(now, now.loads.force, now.loads.normal)
    if not now.scene.has_friction:
        return normal_force
    return normal_force + _sums(now, now.loads.tangential_force, left_of(now.loads.normal))


def _sums(now: Snapshot, force: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the sum of -force * direction over the loads of each grain [N], shape (n, 2).

    Forces [N], shape (c,), and directions, shape (c, 2), are those of `now.loads`, where a pair has a load on
    each of its grains, with opposite normals.
    """
    return np.stack([np.bincount(now.loads.grain, -force * along, now.n) for along in direction.T], axis=1)
