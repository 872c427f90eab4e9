"""What a scene accepts, and the one clear line for everything else."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from warpgrains import InputError, Scene
from warpgrains.scene.geometry import overlapping_pairs

INF, NAN = float("inf"), float("nan")


def scene(**changes):
    fields = {
        "position": [[0.7, 0.0], [0.0, 0.7], [-0.7, 0.0]],
        "radius": 0.1,
        "mass": 0.1,
        "radius_in": 0.5,
        "radius_out": 1.0,
    }
    return Scene(**{**fields, **changes})


def test_scene_from_arrays_owns_read_only_float64_copies():
    position = np.array([[0, 1], [1, 0]], dtype=np.int32).T
    made = scene(position=position, radius=np.float32(0.25), mass=[1, 2], radius_in=0)
    position[0] = 7
    assert np.array_equal(made.position, [[0.0, 1.0], [1.0, 0.0]])
    assert np.array_equal(made.velocity, np.zeros((2, 2)))
    assert np.array_equal(made.radius, [0.25, 0.25])
    for array in (made.position, made.velocity, made.radius, made.mass):
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    for name in ("dt", "dtt"):
        with pytest.raises(FrozenInstanceError):
            setattr(made, name, 0.1)


def test_replace_checks_again():
    made = scene().replace(drag=0.5)
    assert made.drag == 0.5
    assert np.array_equal(made.position, scene().position)
    with pytest.raises(InputError, match="drag is -1"):
        made.replace(drag=-1.0)


@pytest.mark.parametrize(
    ("duration", "dt", "steps"),
    [(8.0, 0.01, 800), (0.3, 0.1, 3), (1.0, 1 / 120, 120), (1.0, 0.3, 3), (0.001, 0.01, 1)],
)
def test_steps_of_a_duration(duration, dt, steps):
    assert scene(duration=duration, dt=dt).steps == steps


BAD_VALUES = [
    ({"position": [[0.7, 0.0], [0.0, NAN]]}, "position of grain 1 is (0.0, nan): it must be finite"),
    (
        {"velocity": [[0.0, 0.0], [INF, 0.0], [0.0, 0.0]]},
        "velocity of grain 1 is (inf, 0.0): it must be",
    ),
    ({"radius": [0.1, 0.1, NAN]}, "radius of grain 2 is nan: it must be finite"),
    ({"mass": [INF, 0.1, 0.1]}, "mass of grain 0 is inf: it must be finite"),
    ({"radius": NAN}, "radius is nan: it must be finite"),
    ({"radius": [0.1, 0.0, 0.1]}, "radius of grain 1 is 0.0: it must be greater than 0"),
    ({"radius": -0.1}, "radius is -0.1: it must be greater than 0"),
    ({"mass": [0.1, 0.1, -2.0]}, "mass of grain 2 is -2.0: it must be greater than 0"),
    ({"mass": 0}, "mass is 0.0: it must be greater than 0"),
    ({"radius_in": 1.0}, "radius_in is 1.0 m: it must be less than radius_out, 1.0 m"),
    ({"radius_in": -0.5}, "radius_in is -0.5: it must be 0 or more"),
    ({"radius_out": -1.0}, "radius_out is -1.0: it must be greater than 0"),
    ({"radius_out": INF}, "radius_out is inf: it must be finite"),
    ({"radius": [0.1, 0.3, 0.1]}, "radius of grain 1 is 0.3: at most 0.25 m fit between the walls"),
    ({"radius": 2.0, "radius_in": 0.0}, "radius of grain 0 is 2.0: at most 1.0 m fit between the walls"),
    (
        {"position": [[0.7, 0.0], [0.0, 1e300]]},
        "position of grain 1 is (0.0, 1e+300): it is outside",
    ),
    (
        {"position": [[0.7, 0.0], [0.0, 1.7]]},
        "position of grain 1 is (0.0, 1.7): it is outside the outer wall",
    ),
    (
        {"position": [[0.1, 0.0], [0.0, 0.7]]},
        "position of grain 0 is (0.1, 0.0): it is inside the inner wall",
    ),
    (
        {"position": [[0.7, 0.0], [0.0, 0.0]], "radius_in": 0.0},
        "position of grain 1 is (0.0, 0.0): a grain cannot be at the origin",
    ),
    (
        {"position": [[0.7, 0.0], [0.0, 0.7], [0.0, 0.8], [0.7, 0.0]]},
        "position of grain 3 is (0.7, 0.0): grain 0 has the same center",
    ),
    ({"radius": [0.1, 0.1]}, "radius has shape (2,): there are 3 grains"),
    ({"mass": [0.1] * 4}, "mass has shape (4,): there are 3 grains"),
    ({"velocity": np.zeros((2, 2))}, "velocity has shape (2, 2): it must be that of position, (3, 2)"),
    ({"velocity": np.zeros(2)}, "velocity has shape (2,): it must be (n, 2)"),
    ({"position": [0.7, 0.0]}, "position has shape (2,): it must be (n, 2)"),
    ({"position": [[0.7, 0.0, 0.0]]}, "position has shape (1, 3): it must be (n, 2)"),
    ({"position": []}, "position has shape (0,): it must be (n, 2), with at least one grain"),
    ({"position": [[0.7, 0.0], [0.7]]}, "position is ragged"),
    ({"position": [["a", "b"]]}, "position holds str"),
    ({"mass": True}, "mass holds bool values"),
    ({"mass": None}, "mass holds object values"),
    ({"dt": 0.0}, "dt is 0.0: it must be greater than 0"),
    ({"dt": NAN}, "dt is nan: it must be finite"),
    ({"dt": "0.01"}, "dt is '0.01': it must be a number"),
    ({"dt": True}, "dt is True: it must be a number"),
    ({"dt": 10**400}, "dt is inf: it must be finite"),
    ({"duration": -1.0}, "duration is -1.0: it must be greater than 0"),
    ({"drag": -0.5}, "drag is -0.5: it must be 0 or more"),
    ({"drag": NAN}, "drag is nan: it must be finite"),
    ({"gravity": (0.0, INF)}, "gravity[1] is inf: it must be finite"),
    ({"gravity": -9.81}, "gravity is -9.81: it must be two numbers"),
    ({"gravity": (0.0, -9.81, 0.0)}, "gravity is (0.0, -9.81, 0.0): it must be two numbers"),
    ({"tolerance": -1e-6}, "tolerance is -1e-06: it must be 0 or more"),
    ({"tolerance": INF}, "tolerance is inf: it must be finite"),
    ({"max_iterations": 0}, "max_iterations is 0: it must be between 1 and 2147483647"),
    ({"max_iterations": 1.5}, "max_iterations is 1.5: it must be a whole number"),
    ({"max_iterations": True}, "max_iterations is True: it must be a whole number"),
    ({"max_iterations": 2**31}, "max_iterations is 2147483648: it must be between 1 and 2147483647"),
    ({"order": "colour"}, "unknown order 'colour': did you mean 'color'? Known: color, sequential"),
    (
        {"drag": 5.0, "mass": [0.2, 0.1, 0.3], "dt": 0.02},
        "dt is 0.02 s: in one step, drag 5.0 kg/s would reverse grain 1 of mass 0.1 kg;"
        " dt must be less than 0.02 s",
    ),
]


@pytest.mark.parametrize(
    ("changes", "message"), BAD_VALUES, ids=lambda value: value if isinstance(value, str) else ""
)
def test_bad_value_is_one_line_naming_field_grain_and_value(changes, message):
    with pytest.raises(InputError) as caught:
        scene(**changes)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_largest_fitting_grain_and_smaller_dt_are_accepted():
    scene(position=[[0.6, 0.0]], radius=0.1, radius_in=0.5, radius_out=0.7)
    scene(drag=5.0, mass=0.1, dt=0.0199)


def test_overlaps_are_counted_and_allowed():
    made = scene(position=[[0.7, 0.0], [0.8, 0.0], [0.0, 0.95], [-0.55, 0.0]])
    assert made.count_overlaps() == (1, 2)


def test_touching_is_no_overlap():
    touching = [[0.3 + 0.2 * k, 0.0] for k in range(4)]
    assert scene(position=touching, radius_in=0.2).count_overlaps() == (0, 0)


@pytest.mark.parametrize("sizes", [(0.02, 0.02), (0.001, 0.3)])
def test_overlapping_pairs_are_those_of_all_pairs(sizes):
    generator = np.random.default_rng(7)
    position = generator.uniform(-1.0, 1.0, (400, 2))
    radius = np.exp(generator.uniform(*np.log(sizes), 400))
    i, j = np.triu_indices(400, 1)
    overlap = np.hypot(*(position[j] - position[i]).T) < radius[i] + radius[j]
    expected = set(zip(i[overlap].tolist(), j[overlap].tolist(), strict=True))
    found = [
        pair
        for i, j in overlapping_pairs(position, radius)
        for pair in zip(i.tolist(), j.tolist(), strict=True)
    ]
    assert len(expected) > 20
    assert len(found) == len(expected)
    assert set(found) == expected


def test_same_grains_with_other_settings():
    given = {"drag": 0.3, "dt": 0.02, "order": "color", "max_iterations": 7, "gravity": (1.0, 2.0)}
    before = scene(tolerance=1e-3, name="before")
    changed, anew = before.with_settings(**given), scene(tolerance=1e-3, name="before", **given)
    for name in Scene.__dataclass_fields__:
        assert np.array_equal(getattr(changed, name), getattr(anew, name)), name
    assert changed.position is before.position
    with pytest.raises(InputError, match=r"^drag is -1.0: it must be 0 or more"):
        before.with_settings(drag=-1.0)
    with pytest.raises(InputError, match="would reverse grain 0"):
        before.with_settings(drag=50.0)
    with pytest.raises(InputError, match="method 'exact' stops on the residual"):
        before.with_settings(method="exact", stop="zeta")
