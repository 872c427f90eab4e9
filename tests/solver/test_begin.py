"""Scenes that begin all at once are those that begin one by one."""

import numpy as np
import pytest

from warpgrains import Scene
from warpgrains.scene.state import first_state
from warpgrains.solver.buffers import fields
from warpgrains.solver.engine import Engine
from warpgrains.solver.tuning import find_device


def differing(one, other):
    """Name the numbers in which two records differ, their addresses left out."""
    if one.dtype.names is None:
        return [] if np.array_equal(one, other) else [True]
    names = [name for name in one.dtype.names if name != "data"]
    return [name for name in names if differing(one[name], other[name])]


@pytest.mark.parametrize("kind", ["plain", "friction", "driven"])
@pytest.mark.parametrize(
    "counts", [[15], [15, 15], [15, 15, 15], [15, 5, 15]], ids=["one", "two", "three", "unlike"]
)
def test_all_at_once(counts, kind):
    scenes = [
        Scene.load("annulus", [f"grains.count={count}", f"physics.drag={0.1 * (k + 1)}"])
        for k, count in enumerate(counts)
    ]
    if kind == "driven":
        scenes = [scene.replace(radius_in=0.0, pressure=10.0, wall_mass=1.0) for scene in scenes]
    elif kind == "friction":
        scenes = [scene.replace(friction=0.1, spin=np.full(scene.n, 2.0)) for scene in scenes]
    engine, other = (Engine(scenes, find_device("cpu")) for _ in range(2))
    engine.begin()
    for k, scene in enumerate(scenes):
        other.load(k, first_state(scene))
    assert (engine._records.together("grains.position") is None) == (len(set(counts)) > 1)
    assert differing(engine._records.host, other._records.host) == []
    for k in range(len(scenes)):
        for field in fields():
            one, two = (records.array(k, field.name) for records in (engine._records, other._records))
            assert one.tobytes() == two.tobytes(), field.name
