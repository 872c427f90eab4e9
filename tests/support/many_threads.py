"""Scenes of two kinds of kernels, each built and advanced in a Python thread of its own, all at once.

Kernels are compiled meanwhile, if the folder that WARP_CACHE_PATH names holds none. It prints "same bits".
"""

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import numpy as np

from warpgrains import Batch, Scene, Simulation
from warpgrains.arrays import FloatArray

KINDS: list[tuple[str, dict[str, Any]]] = [
    ("annulus", {}),
    ("polydisperse", {"order": "color"}),
    ("bidisperse", {"method": "exact"}),
    ("pile", {}),
    ("annulus", {"method": "exact"}),
    ("column", {"method": "exact", "order": "color"}),
    ("polydisperse", {"method": "exact"}),
    ("no_inner_wall", {}),
]
STEPS = 3


def advanced(k: int, start: Barrier | None = None) -> FloatArray:
    """Return where the grains of the kind k are after some steps; odd kinds are advanced in batches."""
    if start is not None:
        start.wait()
    name, changes = KINDS[k]
    scene = Scene.load(name).replace(**changes)
    if k % 2:
        batch = Batch([scene], threads=1)
        batch.run(steps=STEPS)
        return batch.position(0)
    simulation = Simulation(scene, threads=1 + k % 4)
    simulation.run(steps=STEPS)
    return simulation.position


if __name__ == "__main__":
    start = Barrier(len(KINDS))
    with ThreadPoolExecutor(len(KINDS)) as pool:
        together = [pool.submit(advanced, k, start) for k in range(len(KINDS))]
    for k, ended in enumerate(together):
        assert np.array_equal(ended.result(), advanced(k)), KINDS[k]
    print("same bits")
