"""Constants that were chosen by measurement, and the parameters that follow from them.

They concern the lists of a scene, its device and its threads. They change the speed of a step, and hardly the
result.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warpgrains.kernels.search.skins import NARROWEST
from warpgrains.solver.threads import cores

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

EPS = float(np.finfo(np.float64).eps)
BASE_SKIN = 0.12  # initial base skin, in smallest radii
NO_SKIN = -1.0  # skin of a scene without a list, for which the next step requests a list
RESERVE = 0.1  # part of the base skin that must be left at the start of the iteration
MONITOR_THRESHOLD = 0.3  # largest unmonitored deviation in a step, in base skins
NEAREST = 0.5 * NARROWEST.value  # radii per step: half of the narrowest skin
HOST_FEW, HOST_MANY = 750.0, 0.15  # the host's solution of a step costs a + b n sweeps
SHARED_SET = 1000  # mean number of pairs per set above which several threads are faster than one
FARTHEST = 1e6  # distance beyond periodic sides, in `scene.reach`, up to which positions are exact enough
FEWEST = 400  # smallest number of grains per thread of a team
WARP, BLOCK = 32, 256  # number of GPU threads that share a scene of few grains, and of many grains
MANY = 200  # number of grains from which a scene has many


def first_skin(scene: Scene) -> float:
    """Return the initial base skin [m]: about the displacement s_i (eq. 11) at which a list is rebuilt."""
    return BASE_SKIN * scene.smallest_radius


def cell_size(scene: Scene) -> float:
    """Return the side of a cell [m], about the diameter of the most frequent grains."""
    return 2.0 * (scene.typical_radius + first_skin(scene))


def room(scene: Scene) -> float:
    """Return how far a grain may move from the mean motion of all grains before the list is renewed [m]."""
    return 0.5 * scene.typical_radius


def rounding(scene: Scene) -> float:
    """Return a bound on the rounding error of a position [m]; it is larger if the domain is periodic."""
    farthest = FARTHEST if scene.period else 1.0
    return 16.0 * EPS * farthest * scene.reach


def monitor_threshold(scene: Scene) -> float:
    """Return the change of velocity from which a grain is monitored (after eq. 11), per base skin [1/s]."""
    return MONITOR_THRESHOLD / scene.dt


def nearest(scene: Scene) -> float:
    """Return the largest gap / dt - vn [m/s] at which a wall contact without a correction is still swept."""
    return NEAREST * scene.smallest_radius / scene.dt


def paying_threads(scene: Scene) -> int:
    """Return the number of threads that pay off for a scene: all cores, or 1 if it is small.

    A pile has about 3 contacts per grain. They form about 12 colors or 7 sqrt(n) levels, after each of which
    the threads synchronize.
    """
    sets = 12.0 if scene.order == "color" else 7.0 * np.sqrt(scene.n)
    return cores() if 3.0 * scene.n / sets > SHARED_SET else 1


def useful_threads(scene: Scene, threads: int) -> int:
    """Return the number of threads <= `threads` that have a core and at least FEWEST grains each."""
    return max(1, min(threads, cores(), scene.n // FEWEST))


def block_size(scenes: Sequence[Scene]) -> int:
    """Return the number of GPU threads that share a scene."""
    return WARP if max(scene.n for scene in scenes) < MANY else BLOCK


def patience(scene: Scene) -> int:
    """Return how many sweeps cost as much as an exact solution on the host; 0 if the host solves no steps."""
    if scene.method != "exact":
        return 0
    return int(HOST_FEW + HOST_MANY * scene.n)


def threads_for(scene: Scene, device: wp.Device, threads: int | None = None) -> int:
    """Return the number of CPU threads that share a scene; it is 1 for a GPU.

    At most `threads` are used, or `paying_threads` if it is None or 0.
    """
    if device.is_cuda:
        return 1
    return useful_threads(scene, threads or paying_threads(scene))
