"""Order in which a simulation sweeps its contacts, and comparison with the C reference in this order."""

import ctypes
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from same_bits import assert_same_bits

from warpgrains import Scene, Simulation, State, StepReport
from warpgrains.base.arrays import FloatArray, IntArray
from warpgrains.reference.reference import Reference, pair_index

LAWS = {
    "tangent": (("friction", "wallFriction"), ("frictionWalls", "dtContacts", "dtBoundary", "dtWalls")),
    "rolling": (
        ("rollingFriction", "wallRollingFriction"),
        ("rollingWalls", "drContacts", "drBoundary", "drWalls"),
    ),
}
"""Names of the numbers and the arrays of the C struct that a law of friction uses.

The last three arrays of each law are its corrections.
"""


def swept_pairs(simulation: Simulation) -> IntArray:
    """Return the pairs of the list of contacts, in the order in which the last step swept them, (m, 2)."""
    records = simulation._engine.records
    listed = records.host["contacts"]["count"]["pairs"][0]
    pairs = records.array(0, "contacts.contact")[:listed]
    return np.stack([pairs["i"], pairs["j"]], axis=1).astype(np.int64) // 2


def full_order(simulation: Simulation) -> IntArray:
    """Return the order of a sweep over all contacts for `Reference.step`, shape (m, 2).

    The listed pairs come first, as the simulation sweeps them. Then come all other pairs, whose corrections
    must be 0, and finally all grains at all walls as (grain, -1 - wall).
    """
    n, swept = simulation.scene.n, swept_pairs(simulation)
    is_silent = np.ones(n * (n - 1) // 2, bool)
    is_silent[pair_index(swept, n)] = False
    grain, wall = np.indices((n, len(simulation.scene.bodies)))
    walls = np.stack([grain.ravel(), -1 - wall.ravel()], axis=1)
    silent = np.stack(np.triu_indices(n, 1), axis=1)[is_silent]
    return np.concatenate([swept, silent, walls]).astype(np.int32)


class Followed(NamedTuple):
    """Results of a simulation that was compared with the reference."""

    scene: Scene
    reports: list[StepReport]
    touched: set[int]
    """Walls that grains have touched."""
    position: FloatArray
    """Final positions of the grains [m], shape (n, 2)."""


def worst_overlap(simulation: Simulation) -> float:
    """Return the largest overlap of all pairs, and of all grains with walls [m]."""
    now, x = simulation.present_scene, simulation.position
    gaps = [now.side(wall, x, now.radius, time=now.time).gap for wall in range(len(now.walls))]
    gaps.append(now.pair_frames(x, np.stack(np.triu_indices(now.n, 1), axis=1))[1])
    return max(0.0, -float(np.concatenate(gaps).min()))


def residual_in_c(library: ctypes.CDLL, simulation: Simulation, start: State) -> float:
    """Return the residual of the last step, which the C reference computes [m/s] (eqs. 12, 25, 30, 38).

    `start` is the state before the step. The reference iterates each contact alone. This changes a relative
    velocity, normal, tangential or of rolling, by the error of the contact. The result is the largest error.
    """
    scene, worst = simulation.scene, 0.0
    after = replace(start, corrections=simulation.state().corrections)
    for kind in ["normal", *LAWS][: 1 + scene.has_friction + scene.has_rolling_friction]:
        reference = Reference(library, scene, after)
        reference.begin()
        arrays = reference._arrays
        for numbers, names in (LAWS[other] for other in LAWS if other != kind):
            for name in numbers:
                setattr(reference._grains, name, 0.0)
            for name in names:
                arrays[name][:] = 0.0
        begun = {name: array.copy() for name, array in arrays.items()}
        for i, j in full_order(simulation):
            change = reference._iterate(1, np.array([[i, j]], np.int32))
            rim, r = np.abs(arrays["u"] - begun["u"]), scene.radius
            if kind == "tangent":
                change = rim.sum() + sum(np.abs(arrays[name] - begun[name]).sum() for name in LAWS[kind][1])
            elif kind == "rolling":
                change = rim[i] if j < 0 else (r[j] * rim[i] + r[i] * rim[j]) / (r[i] + r[j])
            worst = max(worst, change)
            for name, array in begun.items():
                arrays[name][:] = array
    return worst


def follow_reference(
    scene: Scene,
    steps: int,
    library: ctypes.CDLL,
    simulate: Callable[[Scene], Simulation] = Simulation,
    state: State | None = None,
) -> Followed:
    """Assert that a simulation and the C reference give the same bits in every step.

    The reference sweeps contacts in the order of the simulation. Half-way, both are started again from the
    state of the simulation. `simulate` creates the simulation, and `state` is its start.
    """
    reports, touched = [], set[int]()
    for count in (steps // 2, steps - steps // 2):
        simulation, reference = simulate(scene), Reference(library, scene, state)
        if state is not None:
            simulation.restore(state)
        for _ in range(count):
            reports.append(simulation.step())
            in_order = full_order(simulation) if scene.order == "color" else None
            assert (reports[-1].iterations, reports[-1].zeta) == reference.step(in_order)
            assert_same_bits(simulation, reference)
            if not scene.bodies.inside:
                carried = reference.pair_correction, reference.wall_correction
                assert reports[-1].contacts == sum(map(np.count_nonzero, carried))
                assert reports[-1].overlap == worst_overlap(simulation)
            touched |= set(simulation.wall_contacts().wall[:, 1].tolist())
        state = simulation.state()
    return Followed(scene, reports, touched, simulation.position)
