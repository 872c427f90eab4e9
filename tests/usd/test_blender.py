"""Recordings as Blender shows them.

Blender needs an environment of its own, with Python 3.11: `pip install bpy==5.0.1`. The variable
BLENDER_PYTHON names that environment's python; `pytest -m blender` then runs these tests.
"""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from pages import blocks
from pxr import Usd
from recordings import GRAINS, make_scene, moment, record, recorder_of
from walled_scenes import on_circle

from warpgrains import Scene, Simulation
from warpgrains.drawing.chains import CHAIN_COLOR
from warpgrains.drawing.colorings import speed_scale
from warpgrains.drawing.colors import GrainColors, mark_color
from warpgrains.usd.recording import Recording

pytestmark = pytest.mark.blender

HALF_WIDTH = 2.2
CAMERA = 1.04 * 2.0 * 2.0 * 50.0 / 24.0  # its distance [m], of its focal length and aperture
WALL = 0.014 * 1.04 * 2.0  # thickness of walls [m], which follows the view
PIXELS = 800
SMALL = (400, 400)  # enough for the color of a grain
SCRIPT = Path(__file__).with_name("blender_render.py")


@pytest.fixture
def scene():
    random = np.random.default_rng(5)
    angle, rho = random.uniform(0, 2 * np.pi, 200), random.uniform(0.7, 1.8, 200)
    position = rho[:, np.newaxis] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return make_scene(random.uniform(0.02, 0.1, 200), position=position)


@pytest.fixture(scope="module")
def blender():
    """Start Blender once for all pictures."""
    if "BLENDER_PYTHON" not in os.environ:
        pytest.fail("BLENDER_PYTHON must name a python that has bpy")
    command = [os.environ["BLENDER_PYTHON"], SCRIPT]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process


@pytest.fixture
def rendered(blender):
    """Return the pictures of frames as Blender draws them, and what it says it imported."""

    def render(path, frames, view=None, size=(PIXELS, PIXELS)):
        asked = [str(path), HALF_WIDTH, *size, str(path.parent), view, *frames]
        print(json.dumps(asked), file=blender.stdin, flush=True)
        lines = iter(blender.stdout.readline, "")
        imported = next(line for line in lines if line.startswith("imported "))
        pictures = [np.load(path.parent / f"{frame:04d}.npy") for frame in frames]
        return pictures, json.loads(imported.removeprefix("imported "))

    return render


def covered(scene, position):
    """Return which pixels show a disc or a wall, drawn from the state alone."""
    steps = HALF_WIDTH * ((np.arange(PIXELS) + 0.5) / PIXELS * 2 - 1)
    x, y = steps, -steps[:, np.newaxis]
    rho = np.hypot(x, y)
    shown = ((rho >= 2.0) & (rho <= 2.0 + WALL)) | ((rho >= 0.5 - WALL) & (rho <= 0.5))
    for (centre_x, centre_y), radius in zip(position, scene.radius, strict=True):
        shown |= np.hypot(x - centre_x, y - centre_y) <= radius
    return shown


@pytest.mark.parametrize(
    ("suffix", "draw_as"),
    [(".usdc", "points"), (".usda", "points"), (".usdz", "points"), (".usdc", "discs"), (".usdc", "spheres")],
)
def test_shows_the_discs_of_the_state(rendered, tmp_path, scene, suffix, draw_as):
    drift = 0.02 * np.random.default_rng(6).normal(size=scene.position.shape)
    frames = [(scene.position + number * drift, drift) for number in range(3)]
    path = record(tmp_path / f"run{suffix}", frames, scene, draw_as=draw_as)
    pictures, imported = rendered(path, [0, 2])
    if draw_as == "points":
        assert imported["types"]["Grains"] == "POINTCLOUD"
    assert imported["frames"] == [0, 2]
    polygon = 1.0 - np.sin(2 * np.pi / 64) / (2 * np.pi / 64)  # lacks so much of the disc
    most = 1e-3 if draw_as == "points" else polygon + 1e-3
    for picture, (position, _) in zip(pictures, frames[::2], strict=True):
        expected = covered(scene, position)
        wrong = np.count_nonzero((picture[:, :, 3] > 0.5) != expected)
        assert wrong <= most * np.count_nonzero(expected)


def test_reads_every_number_of_the_grains(rendered, tmp_path):
    simulation, path = Simulation(Scene.load("annulus", ["contact.friction=0.5"])), tmp_path / "run.usdc"
    simulation.run(duration=2.0, record=path, forces=True)
    _, imported = rendered(path, [30], size=SMALL)
    assert (imported["frames"], imported["rate"]) == ([0, 48], 24)  # it plays in real time
    stage = Usd.Stage.Open(str(path))
    grains = stage.GetPrimAtPath(GRAINS)
    names = {"angle", "force", "id", "mass", "mobilized", "pressure", "radius", "speed", "spin"}
    assert imported["numbers"].keys() == names
    for name in names:
        assert imported["numbers"][name] == list(grains.GetAttribute(f"primvars:{name}").Get(30))
        assert any(imported["numbers"][name])


def test_ids_follow_grains_that_come_and_go(rendered, tmp_path):
    path, found = tmp_path / "run.usdc", []
    Simulation("silo").run(steps=600, record=path)
    for frame in (10, 28):
        numbers = rendered(path, [frame], size=SMALL)[1]["numbers"]
        assert numbers["id"] == Recording(path).frame(frame, contacts=False).id.tolist()
        found.append(dict(zip(numbers["id"], numbers["mass"], strict=True)))
    first, last = found
    assert 200 < len(first.keys() & last.keys()) < len(last)
    assert all(last[born] == mass for born, mass in first.items() if born in last)


class TestAsOpened:
    """A recording imported with Blender's defaults, and nothing done to it."""

    def pixels_at(self, places, picture):
        """Return the colors at places [m]; a square picture shows 4 % more than the circle of 2 m."""
        reach = 1.04 * 2.0
        steps = reach * ((np.arange(len(picture)) + 0.5) / len(picture) * 2 - 1)
        column = np.abs(steps - places[:, :1]).argmin(axis=1)
        row = np.abs(-steps - places[:, 1:]).argmin(axis=1)
        return picture[row, column, :3]

    @pytest.mark.parametrize(
        ("draw_as", "color_by"),
        [("points", "speed"), ("discs", "speed"), ("discs", "palette"), ("spheres", "radius")],
    )
    def test_grains_have_their_colors(self, rendered, tmp_path, draw_as, color_by):
        scene = make_scene()
        speed = speed_scale(scene) * np.array([[0.0, 0.1, 0.4, 0.7, 1.0], [1.0, 0.3, 0.2, 0.1, 0.0]])
        frames = [(scene.position, np.stack([one, 0.0 * one], axis=1)) for one in speed]
        path = record(tmp_path / "run.usdc", frames, color_by=color_by, draw_as=draw_as)
        pictures, imported = rendered(path, [0, 1], "Standard", SMALL)
        assert imported["frames"] == [0, 1]
        colors = GrainColors(scene, color_by)
        for picture, frame in zip(pictures, frames, strict=True):
            shown = self.pixels_at(scene.position, picture)
            assert np.allclose(shown, meant(colors, moment(*frame), draw_as), atol=0.01)

    @pytest.mark.parametrize("draw_as", ["discs", "spheres"])
    def test_marks_show_how_far_grains_have_turned(self, rendered, tmp_path, draw_as):
        position = 1.2 * on_circle(np.arange(5) * 2.0 * np.pi / 5.0)
        scene = make_scene(np.full(5, 0.25), position=position, friction=0.3)
        path, height = tmp_path / "run.usdc", 0.25 * (0.24 if draw_as == "discs" else 0.75**0.5)
        nearer = CAMERA / (CAMERA - height)  # marks are that much closer to the camera than the plane z = 0
        angles = np.array([[0.0, 1.0, 2.0, 3.0, 4.0], [1.5, -1.0, 7.0, 0.3, -2.0]])
        with recorder_of(path, scene, draw_as=draw_as, color_by="palette") as recorder:
            for angle in angles:
                recorder.record(moment(scene.position, scene.velocity, scene, spin=angle, angle=angle))
        pictures, _ = rendered(path, [0, 1], "Standard", (1200, 1200))  # no pixel is of mark and grain
        colors = GrainColors(scene, "palette").colors[:5]
        for picture, angle in zip(pictures, angles, strict=True):
            ahead = 0.5 * 0.25 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            for shift, expected in ((-ahead, colors), (ahead, mark_color(colors))):
                shown = self.pixels_at(nearer * (scene.position + shift), picture)
                assert np.allclose(shown, expected, atol=0.02 if draw_as == "discs" else 0.08)  # shaded

    def test_colors_are_told_apart_by_the_view_that_is_default(self, rendered, tmp_path):
        scene = make_scene()
        still = [(scene.position, scene.velocity)]
        path = record(tmp_path / "run.usdc", still, color_by="bands", draw_as="discs")
        (picture,), _ = rendered(path, [0], "AgX", SMALL)
        hue = [color - color.mean() for color in self.pixels_at(scene.position, picture)]
        colors = GrainColors(scene, "bands")
        meant = [color - color.mean() for color in colors.colors[colors.still]]
        likeness = [[a @ b / np.linalg.norm(a) / np.linalg.norm(b) for b in meant] for a in hue]
        assert (np.diag(likeness) > 0.8).all()  # AgX fades and shifts colors
        assert (np.ptp(self.pixels_at(scene.position, picture), axis=1) > 0.15).all()  # none is grey

    def test_force_chains_have_theirs(self, rendered, tmp_path):
        scene = make_scene(gravity=(0.0, -1.0))
        still = [(scene.position, scene.velocity)]
        path = record(tmp_path / "run.usdc", still, scene, draw_as="discs", forces=True)
        (picture,), imported = rendered(path, [0], "Standard", SMALL)
        assert imported["types"]["Forces"] == "MESH"
        middle = scene.position[:2].mean(axis=0, keepdims=True)
        assert np.allclose(self.pixels_at(middle, picture), CHAIN_COLOR, atol=0.01)

    @pytest.mark.parametrize("draw_as", ["points", "discs", "spheres"])
    @pytest.mark.parametrize("size", [(200, 200), (320, 180)])
    def test_camera_frames_the_domain(self, rendered, tmp_path, scene, draw_as, size):
        """All is seen in square and in wide pictures: the circle, 2 % for its wall, and as much again."""
        path = record(tmp_path / "run.usdc", [(scene.position, scene.velocity)], scene, draw_as=draw_as)
        (picture,), imported = rendered(path, [0], "Standard", size)
        assert min(imported["background"][:3]) > 0.3
        width, height = size
        rows, columns = (np.flatnonzero((picture[:, :, 3] > 0.5).any(axis=axis)) for axis in (1, 0))
        margin = 0.5 * height * (1 - 1.02 / 1.04)
        assert np.allclose([rows[0], height - 1 - rows[-1]], margin, atol=1.5)
        wider = (width - height) / 2
        assert np.allclose([columns[0], width - 1 - columns[-1]], margin + wider, atol=1.5)


def meant(colors, frame, draw_as):
    """Return the colors of grains; instances have those of 16 prototypes, or of the palette."""
    exact = colors.of(frame)
    if draw_as == "points" or colors.scale is None:
        return exact
    shared = colors.colors.reshape(16, -1, 3).mean(axis=1)
    return shared[colors.levels(frame) // (len(colors.colors) // 16)]


def test_what_the_docs_say_of_blender(tmp_path, scene):
    line, script = (block.text for block in blocks("recordings") if block.marks == "not run: Blender")
    assert line in script
    (tmp_path / "scene.py").write_text(script)
    record(tmp_path / "annulus.usdc", [(scene.position, 2.0 * scene.position)], scene)
    python = Path(os.environ["BLENDER_PYTHON"]).absolute()
    subprocess.run([python, "scene.py"], cwd=tmp_path, check=True, capture_output=True)
    picture = imread(tmp_path / "annulus-in-blender.png")
    assert picture.shape[:2] == (400, 400)
    shades = np.unique((picture[::4, ::4, :3] * 15.0).round().reshape(-1, 3), axis=0)
    assert len(shades) > 20  # of the speeds
