"""In which order a simulation sweeps its contacts, and the C reference held against it in that order."""

import ctypes

import numpy as np
from graphs import complete
from same_bits import assert_same_bits

from warpgrains import Scene, Simulation
from warpgrains.arrays import IntArray
from warpgrains.reference.reference import Reference, pair_index


def swept_pairs(simulation: Simulation) -> IntArray:
    """Read in which order the last step swept its pairs, shape (m, 2)."""
    records = simulation._engine.records
    listed = records.host["contacts"]["count"]["pairs"][0]
    pairs = records.array(0, "contacts.contact")[:listed]
    return np.stack([pairs["i"], pairs["j"]], axis=1).astype(np.int64) // 2


def full_order(simulation: Simulation) -> IntArray:
    """The pairs as swept, then all pairs that were left out, which must stay silent, then all walls."""
    n, swept = simulation.scene.n, swept_pairs(simulation)
    is_silent = np.ones(n * (n - 1) // 2, bool)
    is_silent[pair_index(swept, n)] = False
    scene = simulation.scene
    bodies = len(scene.bodies)
    walls = np.stack([np.repeat(np.arange(n), bodies), np.tile(-1 - np.arange(bodies), n)], axis=1)
    return np.concatenate([swept, complete(n)[is_silent], walls]).astype(np.int32)


def step_both(simulation: Simulation, reference: Reference, steps: int) -> None:
    """Hold every step against the reference, which visits the contacts in the same order."""
    for _ in range(steps):
        report = simulation.step()
        assert (report.iterations, report.zeta) == reference.step(full_order(simulation))
        assert_same_bits(simulation, reference)


def follow_reference(scene: Scene, steps: int, library: ctypes.CDLL, threads: int | None = None) -> set[int]:
    """Step a simulation and the reference, both restored half-way; return the walls that grains touched.

    Iterations and all that moves are held against the reference after each step.
    """
    simulation, reference = Simulation(scene, threads=threads), Reference(library, scene)
    moving = ["position", "velocity", "spin", "angle"] + ["driven"] * (simulation.driven is not None)
    touched: set[int] = set()
    rebuilds = 0
    for step in range(steps):
        report = simulation.step()
        in_order = full_order(simulation) if scene.order == "color" else None
        assert report.iterations == reference.step(in_order)[0]
        for name in moving:
            assert np.array_equal(getattr(simulation, name), getattr(reference, name)), name
        rebuilds += report.rebuilds
        touched |= set(simulation.wall_contacts().wall[:, 1].tolist())
        if step == steps // 2:
            state = simulation.state()
            simulation = Simulation(scene, threads=threads)
            simulation.restore(state)
            reference = Reference(library, scene, state)
    assert rebuilds > 0
    return touched
