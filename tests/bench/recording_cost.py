"""What recording every step costs a run of 10,000 grains at 50 iterations a step: CSV, one line a repeat.

python tests/bench/recording_cost.py > recording_cost.csv
"""

import csv
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import warpgrains as wg
from warpgrains.warp_start import start_warp

GRAINS, STEPS, REPEATS = 10_000, 40, 5


def make_scene() -> wg.Scene:
    """Return the pile, ten times as many grains, with exactly 50 iterations a step."""
    overrides = [f"grains.count={GRAINS}", "grains.radius=0.004"]
    return wg.Scene.load("pile", overrides).replace(
        tolerance=0.0, max_iterations=50, method="gauss-seidel", order="sequential"
    )


def main() -> None:
    """Run the same steps without and with recording, in turn."""
    start_warp()
    scene = make_scene()
    simulation = wg.Simulation(scene)
    table = csv.writer(sys.stdout)
    table.writerow(["grains", "steps", "seconds_without", "seconds_with", "ratio"])
    with tempfile.TemporaryDirectory(dir=".") as folder:
        simulation.run(steps=20, record=Path(folder) / "warm.usdc")
        start = simulation.state()
        for repeat in range(REPEATS):
            seconds = []
            for record in (None, Path(folder) / f"{repeat}.usdc"):
                simulation.restore(start)
                began = perf_counter()
                simulation.run(steps=STEPS, record=record, fps=1.0 / scene.dt)
                seconds.append(perf_counter() - began)
            table.writerow(
                [GRAINS, STEPS, *(f"{value:.3f}" for value in seconds), f"{seconds[1] / seconds[0]:.3f}"]
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
