"""Numbers chosen by measuring: for the lists of a scene, its device and its threads."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warpgrains.console import start_warp
from warpgrains.errors import InputError
from warpgrains.solver.threads import cores

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

EPS = float(np.finfo(np.float64).eps)
BASE_SKIN = 0.12  # of the smallest radius: how far grains may at first stray before a list is built anew
NO_SKIN = -1.0  # of a scene without a list: the next step asks for one
RESERVE = 0.1  # of a base skin: what must be left of a skin before the iteration starts
MONITOR_THRESHOLD = 0.3  # of a base skin: what a grain may stray in a step without being monitored
NEAREST = 0.01  # radii a step: half of the narrowest skin (kernels/skins.py)
TILE = {"sequential": 32768, "color": 4096}  # pairs interleaved: many hide latency, few fit in cache
DEALT_TILE = 16384  # the same, where threads are dealt tiles: they wait at the borders of these
DEALT_GRAINS = 20_000  # from which threads that are dealt tiles gain far more than they wait
SEGMENT_GRAINS = 200.0  # grains for each thread and other thread, from which segments cost little
HOST_FEW, HOST_MANY = 750.0, 0.15  # sweeps that the host takes as long as for a step of n grains: a + b n
WAITING = 1.0 / 3.0  # of its time that a team's first thread may wait for the others; else they are fewer
PAUSE = 0.03  # seconds of one thread alone before more are tried, at least
SHARED_SET = 1000  # pairs of a set, from which threads that meet after each gain more than they wait


def first_skin(scene: Scene) -> float:
    """Return how far grains may at first stray before a list is rebuilt [m]."""
    return BASE_SKIN * scene.smallest_radius


def cell_size(scene: Scene) -> float:
    """Return the side of a cell [m]: about the diameter of the grains that are most frequent."""
    return 2.0 * (scene.typical_radius + first_skin(scene))


def room(scene: Scene) -> float:
    """Return how far grains may come beside the others while a list lasts [m]."""
    return 0.5 * scene.typical_radius


def rounding(scene: Scene) -> float:
    """Return what may be lost in the digits of a position [m]."""
    return 16.0 * EPS * scene.radius_out


def monitor_threshold(scene: Scene) -> float:
    """Return the change of a velocity that need not be monitored, in base skins [1/s]."""
    return MONITOR_THRESHOLD / scene.dt


def nearest(scene: Scene) -> float:
    """Return how near to a violation contacts are swept, at most [m/s]."""
    return NEAREST * scene.smallest_radius / scene.dt


def tile(scene: Scene, is_dealt: bool) -> int:
    """Return how many pairs are interleaved at most."""
    return DEALT_TILE if is_dealt else TILE[scene.order]


def paying_threads(scene: Scene) -> int:
    """Return how many threads pay for one scene: all cores, if there is enough to sweep between two waits.

    A pile has about 3 contacts a grain; they fall in about 12 colors, or in 7 sqrt(n) levels.
    """
    if scene.method != "gauss-seidel":
        sets = 12.0 if scene.order == "color" else 7.0 * np.sqrt(scene.n)
        return cores() if 3.0 * scene.n / sets > SHARED_SET else 1
    return cores() if scene.n >= DEALT_GRAINS else 1


def crew(scene: Scene, team: int) -> tuple[int, int]:
    """Return how many threads of a team begin with a scene, and how many may ever take part in it."""
    most = min(team, cores())
    return most if paying_threads(scene) > 1 or not sys.platform.startswith("linux") else 1, most


def patience(scene: Scene) -> int:
    """Return how many sweeps take as long as the host's part of a step; 0 where it has none."""
    if scene.method != "exact":
        return 0
    return int(HOST_FEW + HOST_MANY * scene.n)


def threads_for(scene: Scene, device: wp.Device, threads: int | None = None) -> int:
    """Return how many threads share a scene on a CPU, at most: as many as are wanted, or else as pay.

    Tiles of few grains are dealt to few threads: there are some 30 segments a thread, each of which asks how
    far every other thread is, also where one thread sweeps them all.
    """
    if device.is_cuda:
        return 1
    if threads is None or scene.method != "gauss-seidel":
        return threads or paying_threads(scene)
    return min(threads, max(1, int(np.sqrt(scene.n / SEGMENT_GRAINS))))


def find_device(name: str) -> wp.Device:
    """Return a Warp device by its name; raise InputError if there is none."""
    start_warp()
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError) as error:
        known = ", ".join(device.alias for device in wp.get_devices())
        raise InputError(f"device {name!r} does not exist: choose one of {known}") from error
