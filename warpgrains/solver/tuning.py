"""Constants that were chosen by measurement, and the parameters that follow from them.

They concern the lists of a scene, its device and its threads. They change how fast a step is, and hardly its
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
BASE_SKIN = 0.12  # initial skin, in smallest radii: deviation after which a list is rebuilt
NO_SKIN = -1.0  # marks a scene without a list: the next step requests one
RESERVE = 0.1  # in base skins: margin of a skin at the start of the iteration
MONITOR_THRESHOLD = 0.3  # in base skins: largest deviation in a step without monitoring
NEAREST = 0.5 * NARROWEST.value  # radii per step: half of the narrowest skin
HOST_FEW, HOST_MANY = 750.0, 0.15  # the host's solution of a step costs a + b n sweeps
SHARED_SET = 1000  # pairs of a set above which threads that synchronize after each set gain
FARTHEST = 1e6  # radii of a circle about a box: beyond periodic sides, positions are exact enough
FEWEST = 400  # grains of each thread of a team
WARP, BLOCK = 32, 256  # threads of a GPU that share a scene of few, and of many grains
MANY = 200  # grains from which on it has many


def first_skin(scene: Scene) -> float:
    """Return the initial skin [m]: the deviation of a grain after which its list is rebuilt."""
    return BASE_SKIN * scene.smallest_radius


def cell_size(scene: Scene) -> float:
    """Return the side of a cell [m], about the diameter of the most frequent grains."""
    return 2.0 * (scene.typical_radius + first_skin(scene))


def room(scene: Scene) -> float:
    """Return the largest relative displacement of grains while a list is valid [m]."""
    return 0.5 * scene.typical_radius


def rounding(scene: Scene) -> float:
    """Return the largest rounding error of a position [m]; those beyond periodic sides grow."""
    farthest = FARTHEST if scene.period else 1.0
    return 16.0 * EPS * farthest * scene.reach


def monitor_threshold(scene: Scene) -> float:
    """Return the change of velocity below which a grain needs no monitoring, in base skins [1/s]."""
    return MONITOR_THRESHOLD / scene.dt


def nearest(scene: Scene) -> float:
    """Return the largest distance from violation [m/s] at which contacts are swept."""
    return NEAREST * scene.smallest_radius / scene.dt


def paying_threads(scene: Scene) -> int:
    """Return the number of threads that pay off for a scene: all cores, or 1 if it is small.

    A pile has about 3 contacts per grain. They form about 12 colors or 7 sqrt(n) levels, after each of which
    the threads synchronize.
    """
    sets = 12.0 if scene.order == "color" else 7.0 * np.sqrt(scene.n)
    return cores() if 3.0 * scene.n / sets > SHARED_SET else 1


def useful_threads(scene: Scene, threads: int) -> int:
    """Return how many of some threads have a core and enough grains each."""
    return max(1, min(threads, cores(), scene.n // FEWEST))


def block_size(scenes: Sequence[Scene]) -> int:
    """Return the number of a GPU's threads that share a scene."""
    return WARP if max(scene.n for scene in scenes) < MANY else BLOCK


def patience(scene: Scene) -> int:
    """Return the number of sweeps that cost as much as the host's solution of a step; 0 without one."""
    if scene.method != "exact":
        return 0
    return int(HOST_FEW + HOST_MANY * scene.n)


def threads_for(scene: Scene, device: wp.Device, threads: int | None = None) -> int:
    """Return the number of CPU threads that share a scene: those useful of `threads`, or those that pay."""
    if device.is_cuda:
        return 1
    return useful_threads(scene, threads or paying_threads(scene))
