"""Snapshots of scenes at their start, and a balance of forces that holds in every step."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from walled_scenes import cloud

from warpgrains import Scene, Simulation
from warpgrains.analysis import EnergyBalance, Snapshot, WallForce, snapshot, step_energy_balance, wall_forces
from warpgrains.scene.layouts import random_layout
from warpgrains.scene.scheme import free_velocity
from warpgrains.scene.state import first_state
from warpgrains.walls.annulus import Annulus

EPS = float(np.finfo(np.float64).eps)


def moment_of(position: Any, radius: Any = 0.02, **fields: Any) -> Snapshot:
    """Return the snapshot of a scene with these grains at its start.

    They are in a circle of radius 1 m unless `fields` has a domain.
    """
    circle = {} if "domain" in fields else {"radius_out": 1.0}
    scene = Scene(position=np.array(position), radius=radius, **{**circle, "mass": 1.0, **fields})
    return snapshot(scene, first_state(scene))


def random_moment(radius_in: float, **layout: Any) -> Snapshot:
    """Return the snapshot of a scene of random grains between circles of radii `radius_in` and 1 m.

    `layout` are arguments of `random_layout`.
    """
    return moment_of(*random_layout(Annulus(radius_in, 1.0).space, **layout), radius_in=radius_in)


def far_away(now: Snapshot) -> Snapshot:
    """Return a snapshot of a periodic box with each grain moved by a whole number of periods, up to 3."""
    periods = np.random.default_rng(0).integers(-3, 4, (now.n, 2))
    return replace(now, position=now.position + now.scene.period.lengths * periods)


def frictional(n: int = 120, **changes: Any) -> Scene:
    """Return a scene like `walled_scenes.cloud`, in which no grains overlap at the start."""
    rng, above = np.random.default_rng(2), {"y": [-0.3, 1.0]}
    position, radius = random_layout(Annulus(0.2, 1.0).space, radius=[0.02, 0.05], count=n, region=above)
    own = {"mass": rng.uniform(0.1, 1.0, n), "spin": rng.normal(0.0, 5.0, n)}
    solved = {"tolerance": 1e-9, "max_iterations": 20_000}
    return cloud(n, **{"position": position, "radius": radius, **own, **solved, **changes})


def step_and_balance_forces(simulation: Simulation) -> dict[str, WallForce]:
    """Advance by a step, and assert that the forces on walls balance the momentum that contacts give grains.

    Forces between grains do not change the total momentum. The tolerance is for sums of some hundred terms,
    each with a relative rounding error eps. Returns the forces on walls by name.
    """
    scene, before = simulation.scene, simulation.state()
    free = free_velocity(scene, before.velocity, before.staggered, simulation.time)
    simulation.step()
    mass = scene.contact_mass[:, np.newaxis]
    gained = mass * (simulation.velocity - free) / scene.dt
    found = wall_forces(simulation)
    total = np.sum([own.force for own in found.values()], axis=0)
    rounding = 1e3 * EPS * np.abs(gained).sum() + 1e2 * EPS * np.abs(mass * free).sum() / scene.dt
    assert total == pytest.approx(-gained.sum(axis=0), rel=0.0, abs=rounding)
    return found


def energy_balance(simulation: Simulation, steps: int) -> EnergyBalance:
    """Advance a simulation and return the energy balance of all these steps."""
    each = []
    for _ in range(steps):
        simulation.step()
        each.append(step_energy_balance(simulation))
    return EnergyBalance(*np.sum(each, axis=0).tolist())
