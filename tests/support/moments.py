"""Snapshots of scenes at their start, and a balance of forces that holds in every step."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from walled_scenes import cloud

from warpgrains import Scene, Simulation
from warpgrains.analysis import Snapshot, WallForce, snapshot, wall_forces
from warpgrains.scene.layouts import random_layout
from warpgrains.scene.scheme import free_velocity
from warpgrains.scene.state import first_state
from warpgrains.walls.annulus import Annulus

EPS = float(np.finfo(np.float64).eps)


def moment_of(position: Any, radius: Any = 0.02, **fields: Any) -> Snapshot:
    """Return the start of a scene with these grains, in a circle of 1 m unless `domain` is given."""
    circle = {} if "domain" in fields else {"radius_out": 1.0}
    scene = Scene(position=np.array(position), radius=radius, **{**circle, "mass": 1.0, **fields})
    return snapshot(scene, first_state(scene))


def random_moment(radius_in: float, **layout: Any) -> Snapshot:
    """Return the start of a scene of random grains between circles of `radius_in` and 1 m."""
    return moment_of(*random_layout(Annulus(radius_in, 1.0).space, **layout), radius_in=radius_in)


def far_away(now: Snapshot) -> Snapshot:
    """Return a snapshot of a periodic box in which each grain is moved by up to 3 periods."""
    periods = np.random.default_rng(0).integers(-3, 4, (now.n, 2))
    return replace(now, position=now.position + now.scene.period.lengths * periods)


def frictional(n: int = 120, **changes: Any) -> Scene:
    """Return a scene like `cloud`, in which grains do not overlap at the start."""
    rng, above = np.random.default_rng(2), {"y": [-0.3, 1.0]}
    position, radius = random_layout(Annulus(0.2, 1.0).space, radius=[0.02, 0.05], count=n, region=above)
    own = {"mass": rng.uniform(0.1, 1.0, n), "spin": rng.normal(0.0, 5.0, n)}
    solved = {"tolerance": 1e-9, "max_iterations": 20_000}
    return cloud(n, **{"position": position, "radius": radius, **own, **solved, **changes})


def step_and_balance_forces(simulation: Simulation) -> dict[str, WallForce]:
    """Step, assert that forces on walls balance the momentum that grains gain, and return the wall forces.

    Forces between grains do not change the momentum. The tolerance is for sums of some hundred terms, each
    rounded by eps of its size.
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
