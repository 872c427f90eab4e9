"""Arguments in Python: what is meant is accepted, anything else is one line with its name and value."""

import copy
import pickle

import numpy as np
import pytest
from same_bits import contents

from warpgrains import Batch, Scene, Simulation, SimulationError


@pytest.fixture(scope="module")
def simulation():
    simulation = Simulation("annulus", order="color")
    simulation.advance(150)
    return simulation


@pytest.fixture(scope="module")
def batch(simulation):
    batch = Batch([simulation.scene, simulation.scene.replace(drag=0.1)])
    batch.run(150)
    return batch


def test_scenes_may_be_named(tmp_path):
    scene = Scene.load("annulus", "physics.drag=0.1")
    assert scene.drag == Scene.load("annulus", ["physics.drag=0.1"]).drag == 0.1
    path = tmp_path / "mine.toml"
    path.write_text(scene.text.replace("[physics]", "[physics]\ndrag = 0.1", 1).replace("drag = 0.5", ""))
    for given in (path, str(path)):
        assert Simulation(given).scene.drag == 0.1
        assert [one.drag for one in Batch(given).scenes] == [0.1]
    assert Simulation("annulus", drag=0.1).scene.drag == 0.1
    assert [one.name for one in Batch(scene).scenes] == ["annulus"]
    assert [one.drag for one in Batch([scene, "annulus"]).scenes] == [0.1, 0.5]


def test_simulations_and_batches_run_by_the_same_words():
    """Steps, duration and end criterion by their places, and all others by their names."""
    batch, simulation = Batch("annulus"), Simulation("annulus")
    (summary,) = batch.run(None, 2.0, "rest,speed=0.05,time=0.35")
    expected = simulation.run(None, 2.0, "rest,speed=0.05,time=0.35")
    assert (summary.steps, summary.met) == (expected.steps, expected.met)
    for one in (batch, simulation):
        with pytest.raises(TypeError):
            one.run(1, None, None, True)


COPIES = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": lambda one: pickle.loads(pickle.dumps(one))}


class TestCopies:
    def test_of_a_simulation(self, simulation):
        """They have taken no step, and keep threads and a class of the user's."""

        class Mine(Simulation):
            pass

        again = copy.copy(Mine(simulation.scene, threads=2))
        assert type(again) is Mine
        assert again._threads_wanted == 2
        with pytest.raises(SimulationError, match="no step has been taken"):
            copy.copy(simulation).last_start()

    @pytest.mark.parametrize("remake", COPIES.values(), ids=COPIES.keys())
    def test_of_a_batch(self, batch, remake):
        batch = remake(batch)
        again = remake(batch)
        again.run(50)
        assert [batch.state(k).steps for k in range(2)] == [150, 150]
        assert [again.state(k).steps for k in range(2)] == [200, 200]
        batch.run(50)
        for k in range(2):
            assert contents(again.state(k)) == contents(batch.state(k))
        assert again.reports == batch.reports != [None, None]
        begun = remake(Batch("annulus"))
        assert begun.state(0).steps == 0
        assert begun.reports == [None]


def test_temporary_copies_cannot_be_written_to(simulation, batch):
    simulation.step()
    start = simulation.last_start()
    arrays = (simulation.position, simulation.velocity, start.position, start.velocity)
    for array in (*arrays, batch.position(0), batch.velocity(1), Batch("annulus").position(0)):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_states_of_a_batch_are_copies(simulation):
    """Neither what is restored nor what is returned is the batch's own memory."""
    batch, state = Batch(simulation.scene), simulation.state()
    batch.restore(0, state)
    expected = state.position.copy()
    state.position[0] = 0.0
    batch.state(0).position[1] = 0.0
    assert np.array_equal(batch.position(0), expected)


TWO = {"position": np.array([[0.5, 0.0], [0.0, 0.5]]), "radius": 0.1, "mass": 1.0, "radius_out": 1.0}


class TestOverflow:
    @pytest.mark.parametrize("size", [1e-140, 1e150])
    def test_largest_and_smallest_domain(self, size):
        lengths = {name: size * TWO[name] for name in ("position", "radius", "radius_out")}
        scene = Scene(**TWO | lengths, gravity=(0.0, -size), tolerance=1e-6 * size)
        summary = Simulation(scene).run(duration=3.0)
        assert summary.unconverged == 0
        assert summary.overlap < 1e-4 * size

    @pytest.mark.parametrize("speed", [1e14, 1e200, 1e300])
    def test_velocity_whose_rounding_is_a_radius(self, speed):
        scene = Scene(**TWO, velocity=[[0.0, 0.0], [speed, 0.0]])
        path = f"{0.01 * speed:.3g}".replace("+", r"\+")
        reason = rf"grain 1 reached .*: in a step of 0.01 s it would move by {path} m, out of the domain"
        with pytest.raises(SimulationError, match=reason):
            Simulation(scene).step()
