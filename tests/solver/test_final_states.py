"""What many scenes have come to is what each of them has come to alone."""

import numpy as np
import pytest
from sample_scenes import explosion
from schemes import contact_mass

from warpgrains import Scene
from warpgrains.scene.state import first_state
from warpgrains.solver.advance import advance
from warpgrains.solver.engine import Engine
from warpgrains.solver.loading import load_state
from warpgrains.solver.sizes import Sizes
from warpgrains.warp_start import find_device


@pytest.mark.parametrize("which", [[0, 1, 2], [2, 0], [1]])
@pytest.mark.parametrize("moved", [False, True], ids=["as laid out", "with a list that has grown"])
def test_same_as_one_by_one(which, moved):
    crowd = explosion()
    shift = {"position": 0.5 * crowd.position + [0.0, -0.2], "velocity": crowd.velocity - [0.0, 3.0]}
    stiff = crowd.replace(drag=0.1, scheme="leapfrog", **shift)
    scenes = [crowd, stiff, crowd.replace(gravity={"vector": (9.0, 1.0), "rotate": 7.0}, mass=0.1)]
    if not moved:
        scenes = [Scene.load("annulus", [f"physics.drag={drag}"]) for drag in (0.1, 0.2, 0.5)]
    engine = Engine(scenes, device := find_device("cpu"), Sizes.first(scenes, 1, device))
    for k, scene in enumerate(scenes):
        load_state(engine.records, k, first_state(scene))
    engine.submit([60, 61, 3])
    advance([engine], threads=1)
    assert (engine.records.together("grains.position") is None) == moved
    ends = engine.ends(np.array(which, np.int64))
    assert len(ends.dt) == len(which)
    for place, k in enumerate(which):
        state, scene, statistics = engine.scenes[k].state(), scenes[k], engine.last_steps.summary(k)
        expected = {
            "mass": scene.mass,
            "radius": scene.radius,
            "position": state.position,
            "velocity": state.velocity,
            "wall_force": contact_mass(scene)[:, None] * at_each_wall(state.corrections, scene) / scene.dt,
            "gravity": scene.gravity_at(state.steps * scene.dt),
        }
        for name, value in expected.items():
            assert np.array_equal(getattr(ends.grains, name)[place], value), name
        walls = (ends.grains.annulus.radius_in[place], ends.grains.annulus.radius_out[place])
        assert walls == (scene.radius_in, scene.radius_out)
        assert ends.dt[place] == scene.dt
        for name, counted in ends.done.items():
            assert counted[place] == getattr(statistics, name), name
    assert statistics_differ(ends.done, which)


def at_each_wall(corrections, scene):
    every = np.zeros((scene.n, 2))
    every[*corrections.wall.T] = corrections.wall_correction
    return every


def statistics_differ(done, which):
    """The scenes did not do the same, so that a mixed-up order would be seen."""
    return len(set(done["iterations"].tolist())) == len(which)
