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
from recordings import make_scene, record

from warpgrains.usd.colors import GrainColors

pytestmark = pytest.mark.blender

HALF_WIDTH = 2.2
PIXELS = 800
SCRIPT = Path(__file__).with_name("blender_render.py")


@pytest.fixture
def scene():
    random = np.random.default_rng(5)
    angle, rho = random.uniform(0, 2 * np.pi, 200), random.uniform(0.7, 1.8, 200)
    position = rho[:, np.newaxis] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return make_scene(random.uniform(0.02, 0.1, 200), position=position)


def rendered(path, frames):
    """Return the pictures of frames as Blender draws them, and what it says it imported."""
    if "BLENDER_PYTHON" not in os.environ:
        pytest.fail("BLENDER_PYTHON must name a python that has bpy")
    command = [os.environ["BLENDER_PYTHON"], SCRIPT, path, HALF_WIDTH, PIXELS, path.parent, *frames]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True)
    pictures = [np.load(path.parent / f"{frame:04d}.npy") for frame in frames]
    return pictures, json.loads(done.stdout.splitlines()[-1])


def pixel_centres():
    """Return where each pixel's centre is [m]: x of each column, y of each row."""
    steps = (np.arange(PIXELS) + 0.5) / PIXELS * 2 - 1
    return HALF_WIDTH * steps, -HALF_WIDTH * steps[:, np.newaxis]


def covered(scene, position):
    """Return which pixels show a disc or a wall, drawn from the state alone."""
    x, y = pixel_centres()
    rho = np.hypot(x, y)
    shown = ((rho >= 2.0) & (rho <= 2.04)) | ((rho >= 0.46) & (rho <= 0.5))
    for (centre_x, centre_y), radius in zip(position, scene.radius, strict=True):
        shown |= np.hypot(x - centre_x, y - centre_y) <= radius
    return shown


@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz"])
def test_shows_the_discs_of_the_state(tmp_path, scene, suffix):
    drift = 0.02 * np.random.default_rng(6).normal(size=scene.position.shape)
    frames = [(scene.position + number * drift, drift) for number in range(3)]
    path = record(tmp_path / f"run{suffix}", frames, scene)
    pictures, imported = rendered(path, range(3))
    assert imported["types"]["Grains"] == "POINTCLOUD"
    assert imported["frames"] == [0, 2]
    for picture, (position, _) in zip(pictures, frames, strict=True):
        expected = covered(scene, position)
        wrong = np.count_nonzero((picture[:, :, 3] > 0.5) != expected)
        assert wrong <= 1e-3 * np.count_nonzero(expected)


def test_shows_the_colors_as_they_are_meant(tmp_path):
    path = record(tmp_path / "run.usdc", [(make_scene().position, np.zeros((5, 2)))], color_by="radius")
    (picture,), _ = rendered(path, [0])
    x, y = pixel_centres()
    linear = GrainColors(make_scene(), "radius").still
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    for centre, color in zip(make_scene().position, encoded, strict=True):
        pixel = picture[np.argmin(np.abs(y - centre[1])), np.argmin(np.abs(x - centre[0])), :3]
        assert np.allclose(pixel, color, atol=0.01)


def test_shows_force_chains_and_spheres(tmp_path, scene):
    forces = record(tmp_path / "forces.usdc", [(make_scene().position, np.zeros((5, 2)))], forces=True)
    assert rendered(forces, [0])[1]["types"]["Forces"] == "CURVES"
    spheres = record(tmp_path / "spheres.usdc", [(scene.position, scene.velocity)], scene, as_spheres=True)
    (picture,), _ = rendered(spheres, [0])
    expected = covered(scene, scene.position)
    wrong = np.count_nonzero((picture[:, :, 3] > 0.5) != expected)
    assert wrong <= 0.1 * np.count_nonzero(expected)  # Blender's sphere is a polyhedron
