"""Energies, the energy balance of steps, and the granular temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import FloatArray
from warpgrains.scene.scheme import kick_of
from warpgrains.solver.ends import Grains

if TYPE_CHECKING:
    from warpgrains.simulation.simulation import Simulation


def kinetic_energy(of: Snapshot | HasState) -> float:
    """Return the sum of m v^2 / 2 [J]; in the leapfrog scheme, half a step before the other quantities.

    Examples
    --------
    >>> f"{analysis.kinetic_energy(simulation):.3f} J"
    '0.179 J'
    """
    return kinetic_energies(snapshot(of).grains).item()


def kinetic_energies(grains: Grains) -> FloatArray:
    """Return the kinetic energies of many runs [J], shape (m,)."""
    return 0.5 * (grains.mass * (grains.velocity**2).sum(axis=-1)).sum(axis=-1)


def potential_energy(of: Snapshot | HasState) -> float:
    """Return the sum of -m g . x [J], 0 at the origin.

    Examples
    --------
    >>> f"{analysis.potential_energy(simulation):.3f} J"
    '-24.643 J'
    """
    return potential_energies(snapshot(of).grains).item()


def potential_energies(grains: Grains) -> FloatArray:
    """Return the potential energies of many runs [J], shape (m,)."""
    return -(grains.mass * (grains.position @ grains.gravity[..., np.newaxis])[..., 0]).sum(axis=-1)


def granular_temperature(of: Snapshot | HasState) -> float:
    """Return ``<|v - <v>|^2> / 2`` [m2/s2], the mean square of a component of the velocity fluctuations.

    Examples
    --------
    >>> f"{analysis.granular_temperature(simulation):.3f} m2/s2"
    '0.111 m2/s2'
    """
    velocity = snapshot(of).velocity
    return float(0.5 * ((velocity - velocity.mean(axis=0)) ** 2).sum(axis=1).mean())


def mean_speed(of: Snapshot | HasState) -> float:
    """Return the mean of ``|v|`` [m/s].

    Examples
    --------
    >>> f"{analysis.mean_speed(simulation):.3f} m/s"
    '0.153 m/s'
    """
    return float(np.hypot(*snapshot(of).velocity.T).mean())


def largest_speed(of: Snapshot | HasState) -> float:
    """Return the largest ``|v|`` [m/s].

    Examples
    --------
    >>> f"{analysis.largest_speed(simulation):.3f} m/s"
    '1.881 m/s'
    """
    return float(np.hypot(*snapshot(of).velocity.T).max())


class EnergyBalance(NamedTuple):
    """Energy [J] gained from gravity and lost to drag and contacts in one or several steps.

    The kinetic energy changes by gravity_work - drag_loss - contact_loss, up to rounding.

    Examples
    --------
    >>> balance = analysis.step_energy_balance(simulation)
    >>> balance._fields
    ('gravity_work', 'drag_loss', 'contact_loss')
    """

    gravity_work: float
    """Work of gravity. It equals the loss of potential energy up to a term of order dt, because a step moves
    grains with the velocities at its end, and velocities of the leapfrog scheme are half a step behind."""
    drag_loss: float
    """Energy dissipated by drag."""
    contact_loss: float
    """Energy dissipated by the inelastic contacts."""


def step_energy_balance(of: Snapshot | HasState) -> EnergyBalance:
    """Return the energy balance of the last step from its forces and velocities; zeros before the first.

    From v before the step to v' after it, m (v' - v) = dt F, so the kinetic energy changes by
    dt F . (v + v') / 2, a sum over the forces. The free velocity is v* = v' - dt F_contacts / M with the
    contact mass M (kernels/MODEL.md, eq. 17b), and v follows from it by eq. 2, or by eqs. 16 and 17.

    Examples
    --------
    >>> balance = analysis.step_energy_balance(simulation)
    >>> balance.drag_loss > 0.0, balance.contact_loss >= 0.0
    (True, True)
    """
    now = snapshot(of)
    if now.steps == 0:
        return EnergyBalance(0.0, 0.0, 0.0)
    scene, mass = now.scene, now.scene.mass[:, np.newaxis]
    gravity, force = np.array(scene.gravity), contact_forces(now)
    free = now.velocity - scene.dt * force / scene.contact_mass[:, np.newaxis]
    kick = kick_of(scene, free, now.velocity, staggered=now.steps > 1)
    mean = 0.5 * (kick.before + now.velocity)
    return EnergyBalance(
        gravity_work=float((kick.time * mass * mean * gravity).sum()),
        drag_loss=float((scene.drag * kick.path * mean).sum()),
        contact_loss=float(-(scene.dt * force * mean).sum()),
    )


def energy_balance(simulation: Simulation, steps: int) -> EnergyBalance:
    """Advance a simulation by some steps and return the energy balance of all of them [J].

    Examples
    --------
    >>> other = wg.Simulation(simulation.scene)
    >>> balance = analysis.energy_balance(other, steps=100)
    >>> gained = balance.gravity_work - balance.drag_loss - balance.contact_loss
    >>> bool(np.isclose(gained, analysis.kinetic_energy(other)))
    True
    """
    total = np.zeros(3)
    for _ in range(steps):
        simulation.step()
        total += step_energy_balance(simulation)
    return EnergyBalance(*total.tolist())


def contact_forces(of: Snapshot | HasState) -> FloatArray:
    """Return the sum of the forces of all contacts on each grain [N], shape (n, 2).

    Examples
    --------
    >>> analysis.contact_forces(simulation).shape
    (15, 2)
    """
    now = snapshot(of)
    grain, normal, force = now.loads
    return np.stack([np.bincount(grain, -force * along, now.n) for along in normal.T], axis=1)
