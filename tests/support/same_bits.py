"""Comparisons of all bits: of dataclasses, and of a simulation with the C reference."""

from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from warpgrains import Scene, Simulation
from warpgrains.base.arrays import FloatArray
from warpgrains.reference.reference import Reference, pair_index


class AtAnnulus(NamedTuple):
    """Correction [m/s] and force [N] of each grain at the annulus, shape (n,).

    They are > 0 at the outer circle, < 0 at the inner one, and 0 without contact.
    """

    correction: FloatArray
    force: FloatArray


def at_annulus(simulation: Simulation) -> AtAnnulus:
    """Return corrections and forces at the annulus in the last step."""
    contacts, n = simulation.wall_contacts(), simulation.scene.n
    grain, wall = contacts.wall.T
    inner = simulation.scene.bodies.circle_walls[0]
    sign, (correction, force) = np.where(wall == inner, -1.0, 1.0), np.zeros((2, n))
    correction[grain], force[grain] = sign * contacts.correction, sign * contacts.force
    return AtAnnulus(correction, force)


def contents(record: Any) -> Any:
    """Return the fields of (nested) dataclasses, with arrays as bytes, so that == compares bits."""
    if isinstance(record, np.ndarray):
        return record.dtype, record.shape, record.tobytes()
    if hasattr(record, "__dataclass_fields__"):
        return {field.name: contents(getattr(record, field.name)) for field in fields(record)}
    return record


def run_of(scene: Scene, steps: int, **options: Any) -> Simulation:
    """Return the simulation of a scene after a number of steps."""
    simulation = Simulation(scene, **options)
    simulation.advance(steps)
    return simulation


def dense_pair_correction(simulation: Simulation) -> FloatArray:
    """Return the corrections of all pairs i < j in the last step [m/s], shape (n (n - 1) / 2,).

    They are in lexicographic order, and 0 for pairs that are not in the list of contacts.
    """
    n, contacts = simulation.scene.n, simulation.contacts()
    dense = np.zeros(n * (n - 1) // 2)
    dense[pair_index(contacts.pair, n)] = contacts.correction
    return dense


def assert_same_bits(simulation: Simulation, reference: Reference) -> None:
    """Assert that grains, driven walls and corrections have the bits of the reference."""
    scene = simulation.scene
    moving = ["velocity", "position"] + ["spin", "angle"] * scene.has_friction
    for name in moving + ["driven"] * scene.has_driven_walls:
        assert np.array_equal(getattr(simulation, name), getattr(reference, name)), name
    assert np.array_equal(dense_pair_correction(simulation), reference.pair_correction)
    if scene.has_friction:
        carried = simulation.state().corrections
        at = pair_index(carried.pair, scene.n)
        assert np.array_equal(reference.pair_friction[at], carried.pair_friction)
        if scene.has_rolling_friction:
            assert np.array_equal(reference.pair_rolling[at], carried.pair_rolling)
    if not scene.bodies.inside:
        assert np.array_equal(at_annulus(simulation).correction, reference.wall_correction)
