"""What a scene accepts, and the one clear line for everything else."""

import re
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from warpgrains import Scene, SceneError
from warpgrains.scene.overlaps import overlapping_pairs
from warpgrains.scene.reader import shipped_scenes

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
    with pytest.raises(FrozenInstanceError):
        made.dt = 0.1


def test_replace_checks_again():
    made = scene().replace(drag=0.5)
    assert made.drag == 0.5
    assert np.array_equal(made.position, scene().position)
    with pytest.raises(SceneError, match="drag is -1"):
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
        "velocity of grain 1 is (inf, 0.0): it must be finite",
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
        "position of grain 1 is (0.0, 1e+300): it is outside the outer",
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
        "position of grain 1 is (0.0, 0.0): the origin",
    ),
    (
        {"position": [[0.7, 0.0], [0.0, 0.7], [0.0, 0.8], [0.7, 0.0]]},
        "position of grain 3 is (0.7, 0.0): grain 0 has the same centre",
    ),
    ({"radius": [0.1, 0.1]}, "radius has shape (2,): there are 3 grains"),
    ({"mass": [0.1] * 4}, "mass has shape (4,): there are 3 grains"),
    ({"velocity": np.zeros((2, 2))}, "velocity has shape (2, 2): position has shape (3, 2)"),
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
        "dt is 0.02 s: in one step, drag 5.0 kg/s would turn round grain 1 of mass 0.1 kg;"
        " dt must be less than 0.02 s",
    ),
]


@pytest.mark.parametrize(
    ("changes", "message"), BAD_VALUES, ids=lambda value: value if isinstance(value, str) else ""
)
def test_bad_value_is_one_line_naming_field_grain_and_value(changes, message):
    with pytest.raises(SceneError) as caught:
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


FILE = """
[domain]
radius_in = 0.5
radius_out = 1.0
[physics]
gravity = [0.0, -1.0]
drag = 0.25
[time]
dt = 0.125
duration = 2.0
[solver]
tolerance = 1e-3
max_iterations = 7
order = "color"
[grains]
position = [[0.75, 0.0], [0.0, 0.75]]
radius = [0.125, 0.25]
mass = 2.0
velocity = [1.0, 2.0]
"""


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return path

    return write


def test_load_reads_every_key(write):
    made = Scene.load(write(FILE))
    assert np.array_equal(made.position, [[0.75, 0.0], [0.0, 0.75]])
    assert np.array_equal(made.velocity, [[1.0, 2.0], [1.0, 2.0]])
    assert np.array_equal(made.radius, [0.125, 0.25])
    assert np.array_equal(made.mass, [2.0, 2.0])
    assert (made.radius_in, made.radius_out, made.gravity, made.drag) == (0.5, 1.0, (0.0, -1.0), 0.25)
    assert (made.dt, made.duration, made.steps) == (0.125, 2.0, 16)
    assert (made.tolerance, made.max_iterations, made.order) == (1e-3, 7, "color")
    assert (made.name, made.text) == ("mine", FILE)


def test_overrides_replace_values_and_stay_with_the_text(write):
    overrides = (
        "physics.drag=0.5",
        "physics.gravity = [1, 0]",
        "solver.order=sequential",
        "grains.mass=[1.0, 3.0]",
    )
    made = Scene.load(write(FILE), overrides)
    assert (made.drag, made.gravity, made.order) == (0.5, (1.0, 0.0), "sequential")
    assert np.array_equal(made.mass, [1.0, 3.0])
    assert made.text.endswith("# --set grains.mass=[1.0, 3.0]")


def test_text_tells_what_was_changed_after_reading(write):
    made = Scene.load(write(FILE)).replace(drag=0.5, order="sequential")
    assert made.text == FILE + "\n# changed afterwards: drag, order"
    assert scene().replace(drag=0.5).text == ""


def test_mass_by_area(write):
    made = Scene.load(write(FILE.replace("mass = 2.0", "density = 10.0")))
    assert np.array_equal(made.mass, 10.0 * np.pi * made.radius**2)


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_grains_from_a_file_beside_the_scene(write, tmp_path, suffix):
    position, velocity, radius = [[0.75, 0.0], [0.0, 0.75]], [[0.0, 1.0], [0.1, 0.2]], [0.125, 0.25]
    if suffix == "npz":
        np.savez(tmp_path / "grains.npz", position=position, velocity=velocity, radius=radius)
    else:
        (tmp_path / "grains.csv").write_text(
            "x, y,vx,vy,radius\n0.75,0.0,0.0,1.0,0.125\n0.0,0.75,0.1,0.2,0.25\n"
        )
    made = Scene.load(write(f'domain.radius_out = 1.0\n[grains]\nfile = "grains.{suffix}"\nmass = 2.0\n'))
    assert np.array_equal(made.position, position)
    assert np.array_equal(made.velocity, velocity)
    assert np.array_equal(made.radius, radius)


BAD_FILES = [
    ("radius_out = 1.0", "radius_out = ", "mine.toml is not TOML: Invalid value (at line 4"),
    (
        "radius_out = 1.0",
        "radius_outer = 1.0",
        "unknown key in [domain] 'radius_outer': did you mean 'radius_out'?",
    ),
    ("radius_out = 1.0", "", "domain.radius_out is missing"),
    ("[physics]", "[phisics]", "unknown section 'phisics': did you mean 'physics'?"),
    ("[physics]", "[grain]\n[physics]", "unknown section 'grain': did you mean 'grains'?"),
    ("drag = 0.25", "drag = nan", "drag is nan: it must be finite"),
    ("drag = 0.25", 'drag = "small"', "drag is 'small': it must be a number"),
    ("mass = 2.0", "", "grains.mass or grains.density is missing"),
    ("mass = 2.0", "mass = 2.0\ndensity = 1.0", "[grains] has mass and density: it needs one of them"),
    ("mass = 2.0", "density = 0.0", "grains.density is 0.0: it must be greater than 0"),
    ("mass = 2.0", "mas = 2.0", "unknown key in [grains] 'mas': did you mean 'mass'?"),
    ("radius = [0.125, 0.25]", "", "grains.radius is missing"),
    ("radius = [0.125, 0.25]\nmass = 2.0", "density = 1.0", "grains.radius is missing"),
    ("velocity = [1.0, 2.0]", "velocity = [1.0]", "grains.velocity is [1.0]: it must be two numbers"),
    ("velocity = [1.0, 2.0]", "velocity = [[1.0], 2.0]", "velocity is ragged"),
    (
        "position = [[0.75, 0.0], [0.0, 0.75]]",
        "",
        "[grains] has none of them: it needs one of layout, position, file",
    ),
    ("[grains]", '[grains]\nlayout = "rows"', "[grains] has layout and position: it needs one of"),
    (
        "position = [[0.75, 0.0], [0.0, 0.75]]",
        'layout = "row"',
        "unknown grains.layout 'row': did you mean 'rows'?",
    ),
    ("position = [[0.75, 0.0], [0.0, 0.75]]", "layout = [1]", "unknown grains.layout [1]"),
    (
        "position = [[0.75, 0.0], [0.0, 0.75]]",
        'layout = "rows"',
        "grains.count is missing: layout 'rows' needs it",
    ),
    (
        "position = [[0.75, 0.0], [0.0, 0.75]]",
        'layout = "rows"\ncounts = 3',
        "unknown key in [grains] 'counts': did you mean 'count'?",
    ),
    ("position = [[0.75, 0.0], [0.0, 0.75]]", 'file = "none.npz"', "grains.file 'none.npz' cannot be read"),
    (
        "position = [[0.75, 0.0], [0.0, 0.75]]",
        'file = "none.txt"',
        "grains.file is 'none.txt': it must end in",
    ),
    ("position = [[0.75, 0.0], [0.0, 0.75]]", "file = 3", "grains.file is 3: it must be the name of a file"),
    (FILE, "", "domain.radius_out is missing"),
    (FILE, "domain.radius_out = 1.0", "section [grains] is missing"),
    (FILE, "grains = 1\ndomain.radius_out = 1.0", "grains is 1: it must be a section, [grains]"),
]


@pytest.mark.parametrize(
    ("good", "bad", "message"), BAD_FILES, ids=lambda value: value if len(value) < 60 else ""
)
def test_bad_file_is_one_line(write, good, bad, message):
    assert good in FILE
    path = write(FILE.replace(good, bad))
    with pytest.raises(SceneError) as caught:
        Scene.load(path)
    assert str(caught.value).removeprefix(f"{path.parent}/").startswith(message)
    assert "\n" not in str(caught.value)


def test_file_that_is_no_text(tmp_path):
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SceneError, match=r"binary\.toml cannot be read"):
        Scene.load(path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", "x,y\n0.75,zero\n", "line 2 holds ['0.75', 'zero']: every value must be a number"),
        ("a.csv", "x,y\n0.75\n", "line 2 has 1 values for 2 columns"),
        ("a.csv", "x,z\n0.75,0\n", "unknown column 'z'"),
        ("a.csv", "x\n0.75\n", "column 'y' is missing"),
        ("a.csv", "", "the first line must name the columns"),
        ("a.csv", "radius\n1\n", "has no positions"),
        ("a.csv", "x,y\n", "position has shape (0, 2)"),
        ("a.csv", "x,y,mass\n0.75,0,1\n", "grains.mass is given twice"),
        ("a.csv", "x,y\n\x00,1\n", "grains.file 'a.csv'"),
        ("a.npz", "no archive", "grains.file 'a.npz' cannot be read"),
        ("a.npz", "PK\x03\x04", "grains.file 'a.npz' cannot be read"),
        ("a.npz", "", "grains.file 'a.npz' cannot be read"),
    ],
)
def test_bad_grain_file_is_one_line(write, tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    path = write(f'domain.radius_out = 1.0\n[grains]\nfile = "{name}"\nradius = 0.1\nmass = 2.0\n')
    with pytest.raises(SceneError, match=re.escape(message)) as caught:
        Scene.load(path)
    assert "\n" not in str(caught.value)


def test_unknown_array_in_a_grain_file(write, tmp_path):
    np.savez(tmp_path / "a.npz", positions=[[0.75, 0.0]])
    path = write('domain.radius_out = 1.0\n[grains]\nfile = "a.npz"\n')
    with pytest.raises(SceneError, match="unknown array 'positions': did you mean 'position'"):
        Scene.load(path)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("physics.drg=0.1", "unknown key in [physics] 'drg': did you mean 'drag'?"),
        ("phisics.drag=0.1", "unknown section 'phisics': did you mean 'physics'?"),
        ("physics.drag", "override 'physics.drag': it must be section.key=value"),
        ("drag=0.1", "override 'drag=0.1': it must be section.key=value"),
        ("physics.drag=0.1.2", "override 'physics.drag=0.1.2': '0.1.2' is not a TOML value"),
        (
            "physics.drag=1\nradius=2",
            "override 'physics.drag=1\\nradius=2': '1\\nradius=2' is not a TOML value",
        ),
        ("physics.drag=none", "drag is 'none': it must be a number"),
    ],
)
def test_bad_override(override, message):
    with pytest.raises(SceneError, match=re.escape(message)):
        Scene.load("annulus", [override])


def test_unknown_scene_lists_the_shipped_ones():
    with pytest.raises(SceneError, match=r"'anulus': did you mean 'annulus'\? Known: annulus, column, "):
        Scene.load("anulus")


def test_a_file_wins_over_a_shipped_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pile").mkdir()
    (tmp_path / "annulus").write_text(FILE)
    assert Scene.load("annulus").n == 2
    assert Scene.load("pile").n == 1000


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_start_without_overlap(name):
    assert Scene.load(name).count_overlaps() == (0, 0)


def test_annulus_is_the_scene_of_the_course():
    made = Scene.load("annulus")
    r, radius_in = 0.1, 0.5
    x = [(i % 5) * r * 2.5 - 5 * r + 1e-8 for i in range(15)]
    y = [(i // 5) * r * 2.5 + 2 * r + radius_in for i in range(15)]
    assert np.array_equal(made.position, np.column_stack([x, y]))
    assert np.array_equal(made.radius, [r] * 15)
    assert np.array_equal(made.mass, [0.1] * 15)
    assert (made.radius_in, made.radius_out, made.gravity, made.drag) == (0.5, 2.0, (0.0, -9.81), 0.5)
    assert (made.dt, made.steps, made.tolerance) == (0.01, 800, 1e-6)
