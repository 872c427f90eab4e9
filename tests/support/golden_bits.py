"""Bits of some 200 random scenes: written once by a version of the kernels, and compared by later ones.

    python tests/support/golden_bits.py write FILE      (by the version to keep)
    python tests/support/golden_bits.py compare FILE

In color order a scene is compared until the first step in which a list was built during the sweeps.
Accelerated scenes are compared too, and counted apart.
"""

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from random_scenes import random_scene

from warpgrains import Simulation, SimulationError

STEPS = 30


def digests(seed: int, threads: int) -> tuple[list[str], int, Any]:
    """Return a digest of the state after every step, the first step to leave out, and the scene."""
    scene = random_scene(np.random.default_rng((7, seed)))
    simulation = Simulation(scene, threads=threads)
    found, valid = [], STEPS
    for step in range(STEPS):
        try:
            report = simulation.step()
        except SimulationError:
            break
        parts = [simulation.position, simulation.velocity, getattr(simulation, "spin", None)]
        text = b"".join(np.ascontiguousarray(p).tobytes() for p in parts if p is not None)
        found.append(hashlib.sha256(text).hexdigest()[:16] + f" {report.iterations}")
        if sys.argv[1] == "write" and scene.order == "color":
            control = simulation._records.host["control"][0]
            if (control["resuming"] or report.restarts) and valid == STEPS:
                valid = step
    return found, valid, scene


def main() -> None:
    path = Path(sys.argv[2])
    if sys.argv[1] == "write":
        table = {}
        for seed in range(218):
            try:
                one, valid, scene = digests(seed, 1)
            except Exception as error:
                print(seed, type(error).__name__, error)
                continue
            two, _, _ = digests(seed, 2)
            assert one == two, seed
            table[seed] = [one, valid, f"{scene.method} {scene.order}"]
        path.write_text(json.dumps(table))
        print(len(table), "scenes", sum(len(t[0][: t[1]]) for t in table.values()), "steps")
        return
    table = json.loads(path.read_text())
    same: dict[str, list[int]] = {}
    for seed, (kept, valid, kind) in table.items():
        for threads in (1, 2):
            found, _, _ = digests(int(seed), threads)
            equal = found[:valid] == kept[:valid]
            same.setdefault(kind, [0, 0])[0 if equal else 1] += 1
            if not equal:
                first = next((k for k, (a, b) in enumerate(zip(found, kept, strict=False)) if a != b), None)
                print("differs:", seed, kind, "threads", threads, "first step", first, "of", valid)
    for kind, (equal, other) in same.items():
        print(f"{kind}: {equal} the same, {other} differ")


if __name__ == "__main__":
    main()
