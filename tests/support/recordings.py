"""Scenes, snapshots and recordings for the tests of recordings."""

from dataclasses import replace

import numpy as np
from pxr import Usd, UsdGeom

from warpgrains.analysis.snapshot import snapshot
from warpgrains.drawing.frames import FrameTimes
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import first_state
from warpgrains.simulation.options import RunOptions
from warpgrains.usd.recorder import Recorder

GRAINS = "/World/Grains"
FORMS = ("points", "discs", "spheres")
RADIUS = np.array([0.1, 0.07, 0.031, 0.1, 0.2])


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
    """Return random positions and velocities of grains in `count` frames, shape (count, 2, grains, 2).

    Entry [k, 0] holds the positions of frame k [m], and [k, 1] the velocities [m/s].
    """
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (count, 2, grains, 2))


def make_contacts(seed=0, friction=0.0):
    """Return random contacts of 5 grains, as fields of a snapshot: 3 pairs, and one contact per wall."""
    random = np.random.default_rng(seed)
    force = random.uniform(1.0, 20.0, 6)
    pair, wall = np.array([(0, 1), (1, 2), (0, 4)], np.int32), np.array([(0, 0), (3, 1)], np.int32)
    share = friction * random.uniform(-1.0, 1.0, 6)
    return {
        "pair": pair,
        "wall": wall,
        "force": force[:3],
        "wall_force": force[4:],
        "tangential_force": (share * force)[:3],
        "wall_tangential_force": (share * force)[4:],
    }


def moment(position, velocity, scene=None, **fields):
    """Return a snapshot of a scene with these positions and velocities, by default of `make_scene`."""
    scene = make_scene() if scene is None else scene
    return replace(snapshot(scene, first_state(scene)), position=position, velocity=velocity, **fields)


def recorder_of(path, scene=None, resume_at=None, first_step=0, fps=50, **options):
    """Return a recorder to a path, by default of 50 frames per second, and with colors by speed."""
    scene = make_scene() if scene is None else scene
    options = RunOptions(steps=1, record=path, fps=fps, **{"color_by": "speed"} | options)
    return Recorder(
        scene, options, FrameTimes.of(scene.dt, fps, first_step, slow=options.slow or 1.0), resume_at
    )


def moments(frames, scene=None):
    """Yield a snapshot for each of the `frames` of `make_frames`, with random contacts.

    If the scene has friction, it also has random spins and angles.
    """
    scene = make_scene() if scene is None else scene
    for seed, frame in enumerate(frames):
        fields = make_contacts(seed, scene.friction) if scene.n == len(RADIUS) else {}
        if scene.has_friction:
            spin = np.random.default_rng(seed).uniform(-20.0, 20.0, scene.n)
            fields |= {"spin": spin, "angle": 0.3 * seed - spin / 10.0}
        yield moment(*frame, scene, **fields)


def record(path, frames, scene=None, **options):
    """Record the snapshots `moments(frames, scene)`, with grains as points by default; return the path."""
    with recorder_of(path, scene, **options) as recorder:
        for now in moments(frames, scene):
            recorder.record(now)
    return path


def opened(path, frames, scene=None, **options):
    """Record a number of random frames, and return the opened USD stage."""
    return Usd.Stage.Open(str(record(path, make_frames(frames), scene, **options)))


def bands_of(path, code):
    """Return the bands of m force chains in a recorded frame, as center lines and widths [m].

    Center lines have shape (m, 2, 2): start and end of each. Widths have shape (m,). `code` is the time code.
    """
    stage = Usd.Stage.Open(str(path))
    points = np.array(stage.GetAttributeAtPath("/World/Forces.points").Get(code), np.float64)
    a, b, c, d = points.reshape(-1, 4, 3)[:, :, :2].swapaxes(0, 1)
    return np.stack([(a + d) / 2.0, (b + c) / 2.0], axis=1), np.hypot(*(a - d).T)


def grains_of(stage):
    return UsdGeom.Points(stage.GetPrimAtPath(GRAINS))
