"""Accelerated against plain Gauss-Seidel while 1,000 grains settle from rows: sweeps, and the true error.

    python -m tests.bench.settling -o tests/bench/results/settling.csv --steps 200

No time is measured, so the machine may be busy. All 200 steps, 2 s, take several minutes, nearly all of it in
plain Gauss-Seidel; the default is a part of them, in which the first grains have landed.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from warpgrains import Scene, Simulation
from warpgrains.scene.fields import ORDERS
from warpgrains.warp_start import start_warp

from .rows import SPEEDUP, Subject, open_table, row
from .timing import say

SETTLING = 200  # steps of dt 0.01 s
TOLERANCE = 1e-6  # m/s
MOST = 50_000  # sweeps a step, where the tolerance is to end it
FEW = 100  # sweeps a step, where their number is
EXACTLY = {"method": "accelerated", "stop": "residual", "tolerance": 1e-10, "max_iterations": 50_000}
"""How the solution is found that errors are measured against; what residual it reached is said."""


@dataclass
class Run:
    """What a run has done.

    Attributes
    ----------
    sweeps, unconverged : int
        Sweeps in all, and steps that ended at the most sweeps allowed.
    errors : list
        max |v - v_exact| of the steps looked at [m/s].
    floor : float
        Largest residual of a v_exact [m/s]: no error below it means anything.
    """

    sweeps: int = 0
    unconverged: int = 0
    errors: list[float] = field(default_factory=list)
    floor: float = 0.0


def settle(steps: int, every: int, **solver: object) -> Run:
    """Let the grains settle by one method; look at the true error now and then."""
    scene = Scene.load("pile", ["time.dt=0.01"]).replace(**solver)
    simulation, exact, run = Simulation(scene), Simulation(scene, **EXACTLY), Run()
    for step in range(1, steps + 1):
        looked_at = step % every == 0
        if looked_at:
            exact.restore(simulation.state())
        report = simulation.step()
        run.sweeps += report.iterations
        run.unconverged += not report.converged
        if looked_at:
            run.floor = max(run.floor, exact.step().residual)
            run.errors.append(np.abs(simulation.velocity - exact.velocity).max())
            say(f"  step {step}: {run.sweeps:,} sweeps, error {run.errors[-1]:.2g} m/s")
    return run


def compare(steps: int, every: int, order: str) -> Iterator[dict[str, str]]:
    """Both methods, to the same tolerance and with the same number of sweeps."""
    whole = steps == SETTLING
    solvers = {
        f"to {TOLERANCE:g} m/s": {"tolerance": TOLERANCE, "max_iterations": MOST},
        f"{FEW} sweeps a step": {"tolerance": 0.0, "max_iterations": FEW},
    }
    for name, solver in solvers.items():
        ours, plain = (
            settle(steps, every, order=order, method=method, **solver)
            for method in ("accelerated", "gauss-seidel")
        )
        for run in (ours, plain):
            say(f"{name}: {run.sweeps:,} sweeps, {run.unconverged} steps short, v_exact to {run.floor:.1g}")
        few = solver["max_iterations"] == FEW
        rows = {
            "sweeps": ([ours.sweeps], "", [plain.sweeps], "" if few else ">= 12"),
            "median true error": (ours.errors, "m/s", plain.errors, ">= 10" if few else ">= 1"),
            "worst true error": ([max(ours.errors)], "m/s", [max(plain.errors)], ""),
        }
        for what, (values, unit, its, target) in rows.items():
            subject = Subject(f"settling from rows, {steps} steps, {name}: {what}", 1_000, order)
            yield row(subject, values, unit, "plain Gauss-Seidel", its, SPEEDUP, target if whole else "")


def main() -> None:
    """Measure, and write the figures down one by one."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.settling", description=__doc__.splitlines()[0]
    )
    parser.add_argument("-o", "--output", type=Path, help="CSV file (default: standard output)")
    parser.add_argument("--steps", type=int, default=60, help=f"of {SETTLING} (default: 60)")
    parser.add_argument("--every", type=int, default=10, help="steps between two errors (default: 10)")
    parser.add_argument("--order", choices=ORDERS, default="sequential")
    chosen = parser.parse_args()
    start_warp()
    with open_table(chosen.output) as table:
        for cells in compare(chosen.steps, chosen.every, chosen.order):
            table.add(cells)


if __name__ == "__main__":
    main()
