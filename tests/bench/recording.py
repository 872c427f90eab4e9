"""How long recording takes, how much memory, how large the file: one CSV line a case, median of three runs.

    python tests/bench/recording.py > tests/bench/results/recording.csv

Only `record` and `close` are timed; each run is a process of its own, so that its peak memory is its own.
"""

import csv
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from warpgrains.drawing.frames import Frame, FrameTimes
from warpgrains.scene.scene import Scene
from warpgrains.usd.recorder import Recorder

CASES = (
    (1_000, 400, ".usdc"),
    (10_000, 1_000, ".usdc"),
    (20, 40_000, ".usdc"),
    (10_000, 100, ".usda"),
    (10_000, 1_000, ".usdz"),
)
RUNS = 3


def scattered_scene(grains: int) -> Scene:
    """Grains of two sizes at random places; they overlap, which no recording minds."""
    random = np.random.default_rng(1)
    angle, rho = random.uniform(0, 2 * np.pi, grains), random.uniform(0.6, 1.9, grains)
    position = rho[:, np.newaxis] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radius = random.choice([0.003, 0.005], grains)
    return Scene(position=position, radius=radius, mass=1e-4, radius_in=0.5, radius_out=2.0, dt=0.01)


def record(grains: int, frames: int, suffix: str) -> tuple[float, float, float]:
    """Return seconds of recording, peak memory [MB] and file size [MB]."""
    scene = scattered_scene(grains)
    velocity = np.random.default_rng(2).normal(size=scene.position.shape)
    with tempfile.TemporaryDirectory(dir=".") as folder:
        path = Path(folder) / f"run{suffix}"
        seconds = 0.0
        with Recorder(path, scene, FrameTimes(scene.dt, 100)) as recorder:
            for frame in range(frames):
                position, faster = scene.position + 1e-4 * frame * velocity, (1 + 1e-4 * frame) * velocity
                start = time.perf_counter()
                recorder.record(Frame(position, faster))
                seconds += time.perf_counter() - start
            start = time.perf_counter()
        seconds += time.perf_counter() - start
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
        return seconds, peak, path.stat().st_size / 1e6


def main() -> None:
    """Run one case where arguments name it, all cases otherwise."""
    if sys.argv[1:]:
        print(*record(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]))
        return
    table = csv.writer(sys.stdout)
    table.writerow(["grains", "frames", "suffix", "seconds", "peak_mb", "file_mb"])
    for case in CASES:
        command = [sys.executable, __file__, *map(str, case)]
        runs = [
            subprocess.run(command, check=True, capture_output=True, text=True).stdout for _ in range(RUNS)
        ]
        measured = zip(*(map(float, run.split()) for run in runs), strict=True)
        table.writerow([*case, *(f"{statistics.median(values):.4g}" for values in measured)])
        sys.stdout.flush()


if __name__ == "__main__":
    main()
