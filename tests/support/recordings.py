"""Scenes and frames for the tests of recordings."""

from dataclasses import dataclass

import numpy as np
from pxr import UsdGeom

from warpgrains.drawing.frames import Frame, FrameTimes
from warpgrains.scene.scene import Scene
from warpgrains.usd.recorder import Recorder

GRAINS = "/World/Grains"
RADIUS = np.array([0.1, 0.07, 0.031, 0.1, 0.2])


@dataclass
class Contacts:
    pair: np.ndarray
    force: np.ndarray


@dataclass
class WallContacts:
    wall: np.ndarray
    force: np.ndarray


def make_scene(radius=RADIUS, **fields):
    angle = np.linspace(0.0, 6.0, len(radius))
    given = {
        "position": 1.2 * np.stack([np.cos(angle), np.sin(angle)], axis=1),
        "radius": radius,
        "mass": 1.0,
        "radius_in": 0.5,
        "radius_out": 2.0,
        "name": "example",
        "text": '# grains of "many" sizes\n[time]\ndt = 0.01\n',
    }
    return Scene(**given | fields)


def make_frames(count, grains=5, seed=0):
    """Positions and velocities, shape (count, 2, grains, 2), that float32 cannot hold exactly."""
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (count, 2, grains, 2))


def make_contacts(seed=0):
    """Contacts of five grains: four between them, the last without a force, and one at each wall."""
    force = np.random.default_rng(seed).uniform(1.0, 20.0, 6)
    pair = np.array([(0, 1), (1, 2), (0, 4), (2, 3)])
    return Contacts(pair, np.append(force[:3], 0.0)), WallContacts(np.array([(0, 0), (3, 1)]), force[4:])


def points_recorder(path, scene, **options):
    """A recorder of points at 50 frames per second, unless it is told otherwise."""
    return Recorder(path, scene, **{"times": FrameTimes(scene.dt, 50), "draw_as": "points"} | options)


def record(path, frames, scene=None, **options):
    """Record frames, each with contacts of its own, and return the path; by default as points."""
    with points_recorder(path, scene or make_scene(), **options) as recorder:
        for seed, (position, velocity) in enumerate(frames):
            contacts = make_contacts(seed) if recorder.needs_contacts else ()
            recorder.record(Frame(position, velocity, *contacts))
    return path


def grains_of(stage):
    return UsdGeom.Points(stage.GetPrimAtPath(GRAINS))
