"""Snapshots of scenes at their start, and regions about which tests of analysis agree."""

from dataclasses import replace
from typing import Any

import numpy as np

from warpgrains import Scene
from warpgrains.analysis import Snapshot, snapshot
from warpgrains.scene.state import first_state

EPS = float(np.finfo(np.float64).eps)


def moment_of(position: Any, radius: Any = 0.02, **fields: Any) -> Snapshot:
    """Return the start of a scene of grains in a circle of 1 m, unless it is said otherwise."""
    circle = {} if "domain" in fields else {"radius_out": 1.0}
    scene = Scene(position=np.array(position), radius=radius, **{**circle, "mass": 1.0, **fields})
    return snapshot(scene, first_state(scene))


def far_away(now: Snapshot) -> Snapshot:
    """Return a snapshot of the same grains of a periodic box, each some periods away."""
    periods = np.random.default_rng(0).integers(-3, 4, (now.n, 2))
    return replace(now, position=now.position + now.scene.period * periods)
