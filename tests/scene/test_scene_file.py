"""Scenes from files: every key, overrides, grains in files of their own, and the line for what is wrong."""

import re

import numpy as np
import pytest

from warpgrains import InputError, Scene
from warpgrains.scene.document import shipped_scenes

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
    values = ("physics.drag=0.5", "physics.gravity = [1, 0]", "solver.order=sequential")
    made = Scene.load(write(FILE), [*values, "grains.mass=[1.0, 3.0]"])
    assert (made.drag, made.gravity, made.order) == (0.5, (1.0, 0.0), "sequential")
    assert np.array_equal(made.mass, [1.0, 3.0])
    assert made.text.endswith("# --set grains.mass=[1.0, 3.0]")


def test_text_tells_what_was_changed_after_reading(write):
    made = Scene.load(write(FILE)).replace(drag=0.5, order="sequential")
    assert made.text == FILE + "\n# changed afterwards: drag, order"
    assert Scene(position=made.position, radius=0.1, mass=0.1, radius_out=1.0).replace(drag=0.5).text == ""


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


PLACES = "position = [[0.75, 0.0], [0.0, 0.75]]"
BAD_FILES = [
    ("radius_out = 1.0", "radius_out = ", "mine.toml is not TOML: Invalid value (at line 4"),
    ("radius_out = 1.0", "radius_outer = 1.0", "unknown key in [domain] 'radius_outer': did you mean"),
    ("radius_out = 1.0", "", "domain.radius_out is missing"),
    ("[physics]", "[phisics]", "unknown section 'phisics': did you mean 'physics'?"),
    ("[physics]", "[grain]\n[physics]", "unknown section 'grain': did you mean 'grains'?"),
    ("drag = 0.25", "drag = nan", "drag is nan: it must be finite"),
    ("drag = 0.25", 'drag = "small"', "drag is 'small': it must be a number"),
    ("mass = 2.0", "", "grains.mass or grains.density is missing"),
    ("mass = 2.0", "mass = 2.0\ndensity = 1.0", "[grains] has mass and density: give only one"),
    ("mass = 2.0", "density = 0.0", "grains.density is 0.0: it must be greater than 0"),
    ("mass = 2.0", "mas = 2.0", "unknown key in [grains] 'mas': did you mean 'mass'?"),
    ("radius = [0.125, 0.25]", "", "grains.radius is missing"),
    ("radius = [0.125, 0.25]\nmass = 2.0", "density = 1.0", "grains.radius is missing"),
    ("velocity = [1.0, 2.0]", "velocity = [1.0]", "grains.velocity is [1.0]: it must be two numbers"),
    ("velocity = [1.0, 2.0]", "velocity = [[1.0], 2.0]", "velocity is ragged"),
    (PLACES, "", "[grains] needs exactly one of layout, position, file: it has none"),
    (
        "[grains]",
        '[grains]\nlayout = "rows"',
        "[grains] needs exactly one of layout, position, file: it has layout and position",
    ),
    (PLACES, 'layout = "row"', "unknown grains.layout 'row': did you mean 'rows'?"),
    (PLACES, "layout = [1]", "unknown grains.layout [1]"),
    (PLACES, 'layout = "rows"', "grains.count is missing: layout 'rows'"),
    (PLACES, 'layout = "rows"\ncounts = 3', "unknown key in [grains] 'counts': did you mean 'count'?"),
    (PLACES, 'file = "none.npz"', "grains.file 'none.npz' cannot be read"),
    (PLACES, 'file = "none.txt"', "grains.file is 'none.txt': it must end in"),
    (PLACES, "file = 3", "grains.file is 3: it must be the name of a file"),
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
    with pytest.raises(InputError) as caught:
        Scene.load(path)
    assert str(caught.value).removeprefix(f"{path.parent}/").startswith(message)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", "x,y\n0.75,zero\n", "line 2 holds ['0.75', 'zero']: every value must be a number"),
        ("a.csv", "x,y\n0.75\n", "line 2 has 1 values for 2 columns"),
        ("a.csv", "x,z\n0.75,0\n", "unknown column 'z'"),
        ("a.csv", "x\n0.75\n", "column 'y' is missing"),
        ("a.csv", "", "the first line must name the columns"),
        ("a.csv", "radius\n1\n", "has no positions: it needs an array position, or columns x and y"),
        ("a.csv", "x,y\n", "position has shape (0, 2)"),
        ("a.csv", "x,y,mass\n0.75,0,1\n", "grains.mass is given twice"),
        ("a.csv", "x,y\n\x00,1\n", "grains.file 'a.csv'"),
        ("a.npz", "no archive", "grains.file 'a.npz' cannot be read"),
        ("a.npz", "PK\x03\x04", "grains.file 'a.npz' cannot be read"),
        ("a.npz", "", "grains.file 'a.npz' cannot be read"),
        ("a.npz", {"positions": [[0.75, 0.0]]}, "unknown array 'positions': did you mean 'position'"),
    ],
)
def test_bad_grain_file_is_one_line(write, tmp_path, name, content, message):
    if isinstance(content, dict):
        np.savez(tmp_path / name, **content)
    else:
        (tmp_path / name).write_text(content)
    path = write(f'domain.radius_out = 1.0\n[grains]\nfile = "{name}"\nradius = 0.1\nmass = 2.0\n')
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        Scene.load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("physics.drg=0.1", "unknown key in [physics] 'drg': did you mean 'drag'?"),
        ("phisics.drag=0.1", "unknown section 'phisics': did you mean 'physics'?"),
        ("physics.drag", "override 'physics.drag': it must be section.key=value"),
        ("drag=0.1", "override 'drag=0.1': it must be section.key=value"),
        ("physics.drag=0.1.2", "override 'physics.drag=0.1.2': '0.1.2' is not a TOML value"),
        ("physics.drag=1\nradius=2", "'1\\nradius=2' is not a TOML value"),
        ("physics.drag=none", "drag is 'none': it must be a number"),
    ],
)
def test_bad_override(override, message):
    with pytest.raises(InputError, match=re.escape(message)):
        Scene.load("annulus", [override])


def test_walls_are_no_section():
    """An override of a list of walls had no effect, and was recorded."""
    said = "override 'walls.friction=0.5': walls is a list, no section of keys"
    with pytest.raises(InputError, match=re.escape(said)):
        Scene.load("hopper", ["walls.friction=0.5"])


def test_scene_that_is_not_there_or_no_text(tmp_path):
    with pytest.raises(InputError, match=r"'anulus': did you mean 'annulus'\? Known: annulus, bidisperse, "):
        Scene.load("anulus")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"binary\.toml cannot be read"):
        Scene.load(tmp_path / "binary.toml")


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
