"""What a scene accepts, what it keeps, and which grains it says overlap."""

import copy
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from same_bits import contents
from walled_scenes import LID, filled

from warpgrains import Box, Scene, Simulation
from warpgrains.scene.fields import SceneFields
from warpgrains.scene.toml import parameters_text, read_parameters
from warpgrains.space.geometry import overlapping_pairs

ARRAYS = ("position", "velocity", "radius", "mass")


def scene(**changes):
    fields = {
        "position": [[0.7, 0.0], [0.0, 0.7], [-0.7, 0.0]],
        "radius": 0.1,
        "mass": 0.1,
        "radius_in": 0.5,
        "radius_out": 1.0,
    }
    return Scene(**{**fields, **changes})


def require_same(one, other):
    for name in Scene.__dataclass_fields__:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


def test_scene_from_arrays_owns_float64_copies():
    position = np.array([[0, 1], [1, 0]], dtype=np.int32).T
    unmasked = np.ma.array([1, 2], mask=[False, False])
    made = scene(position=position, radius=np.float32(0.25), mass=unmasked, radius_in=0)
    position[0] = 7
    assert np.array_equal(made.position, [[0.0, 1.0], [1.0, 0.0]])
    assert np.array_equal(made.velocity, np.zeros((2, 2)))
    assert np.array_equal(made.radius, [0.25, 0.25])
    assert np.array_equal(made.mass, [1.0, 2.0])
    for name in ARRAYS:
        assert getattr(made, name).dtype == np.float64
        assert getattr(made, name).flags.c_contiguous
    for name in ("dt", "dtt"):
        with pytest.raises(FrozenInstanceError):
            setattr(made, name, 0.1)


@pytest.mark.parametrize(
    "remake", [lambda one: one, copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))]
)
def test_scenes_and_their_copies_cannot_be_written_to(remake):
    made = scene(name="mine", drag=0.1)
    again = remake(made)
    assert type(again) is Scene
    require_same(again, made)
    for name in ARRAYS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(again, name)[0] = 1.0


@pytest.mark.parametrize(
    ("duration", "dt", "steps"),
    [(8.0, 0.01, 800), (0.3, 0.1, 3), (1.0, 1 / 120, 120), (1.0, 0.3, 3), (0.006, 0.01, 1)],
)
def test_steps_of_a_duration(duration, dt, steps):
    assert scene(duration=duration, dt=dt).steps == steps


def test_limits_are_accepted():
    scene(position=[[0.6, 0.0]], radius=0.1, radius_in=0.5, radius_out=0.7)
    scene(drag=5.0, mass=0.1, dt=0.0199)
    assert Simulation(scene(radius_out=9.9e10)).step().converged


def test_overlaps_are_counted_and_allowed():
    made = scene(position=[[0.7, 0.0], [0.8, 0.0], [0.0, 0.95], [-0.55, 0.0]])
    assert made.count_overlaps() == (1, 2, pytest.approx(0.1))
    touching = [[0.3 + 0.2 * k, 0.0] for k in range(4)]
    assert scene(position=touching, radius_in=0.2).count_overlaps() == (0, 0, 0.0)


@pytest.mark.parametrize("sizes", [(0.02, 0.02), (0.001, 0.3)])
def test_overlapping_pairs_are_those_of_all_pairs(sizes):
    generator = np.random.default_rng(7)
    position = generator.uniform(-1.0, 1.0, (400, 2))
    radius = np.exp(generator.uniform(*np.log(sizes), 400))
    pairs = np.stack(np.triu_indices(400, 1), axis=1)
    i, j = pairs.T
    expected = pairs[np.hypot(*(position[j] - position[i]).T) < radius[i] + radius[j]]
    found = np.concatenate([np.stack(some, axis=1) for some in overlapping_pairs(position, radius)])
    assert len(expected) > 20
    assert sorted(found.tolist()) == expected.tolist()


def test_same_grains_with_other_settings():
    given = {"drag": 0.3, "dt": 0.02, "order": "color", "max_iterations": 7, "gravity": (1.0, 2.0)}
    before = scene(tolerance=1e-3, name="before")
    changed, anew = before.replace(**given), scene(tolerance=1e-3, name="before", **given)
    require_same(changed, anew)
    assert changed.position is before.position


def test_velocity_of_minus_zero_becomes_zero(reference):
    """As in the text's loop: -0.0 + dt (0 - 0 * -0.0) is +0.0."""
    made = scene(gravity=(0.0, 0.0), velocity=np.full_like(scene().position, -0.0))
    for code in (Simulation(made), reference(made)):
        code.step()
        assert not np.signbit(code.velocity).any()


def test_a_box_and_its_sides_are_kept_in_text_and_copies():
    """The lid has sunk, and the belt has moved, but they are those of the box. Arrays become numbers."""
    belt = {"velocity": np.array([0.5, 0.0]), "roughness": {"radius": np.float32(0.03125), "spacing": 0.125}}
    simulation = Simulation(filled(bottom=belt, top=LID, friction=0.4))
    simulation.advance(5)
    now = simulation.present_scene
    grains = {name: getattr(now, name) for name in (*ARRAYS, "spin")}
    read = Scene.made(vars(SceneFields(**grains, **read_parameters(parameters_text(now)))))
    for kept in (read, pickle.loads(pickle.dumps(now)), now.replace(drag=0.1)):
        assert (kept.domain, kept.walls) == (now.domain, now.walls)
        assert hash(kept.domain) == hash(now.domain)
    assert now.domain != Box(now.domain.x, now.domain.y, "x")
    assert now.walls != simulation.scene.walls
    again = pickle.loads(pickle.dumps(simulation))
    for one in (simulation, again):
        one.advance(3)
    assert contents(again.state()) == contents(simulation.state())
