"""Error of a trajectory in which grains collide, by both schemes: CSV and a picture, ten random starts each.

    python -m tests.bench.schemes -o tests/bench/results/schemes.csv --picture scenes/schemes.png

Grains of the course's size, mass and drag are thrown into the course's annulus at random places and with
random velocities. All steps are solved to 1e-11 m/s. The error is the largest distance of a coordinate at the
end from a run of second order with 3,200 steps; from that run, one with 1,600 has the error in `own`.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from warpgrains import Scene, Simulation
from warpgrains.arrays import FloatArray
from warpgrains.report.rows import SCHEMES, SECOND_ORDER
from warpgrains.warp_start import start_warp

from .rows import open_table
from .timing import say

COLUMNS = ("grains", "time", "steps", "scheme", "seconds", "error", "error_min", "error_max", "own", "gain")
CASES = ((5, 0.8), (12, 0.8), (30, 0.6))  # grains, and time [s]
STEPS = (40, 80, 160, 320)
FINE = 3200
STARTS, REPEATS = 10, 5
RADIUS, RADIUS_IN, RADIUS_OUT = 0.1, 0.5, 2.0  # m
COLORS = dict(zip(SCHEMES, ("black", "#d55e00"), strict=True))


def thrown(grains: int, seed: int) -> Scene:
    """Return grains at random places, a little apart, with velocities of 1 m/s in either component."""
    rng = np.random.default_rng(seed)
    places: list[FloatArray] = []
    while len(places) < grains:
        place = rng.uniform(-RADIUS_OUT, RADIUS_OUT, 2)
        inside = RADIUS_IN + 1.05 * RADIUS < np.hypot(*place) < RADIUS_OUT - 1.05 * RADIUS
        if inside and all(np.hypot(*(place - other)) > 2.05 * RADIUS for other in places):
            places.append(place)
    return Scene(
        position=np.array(places),
        velocity=rng.normal(0.0, 1.0, (grains, 2)),
        radius=RADIUS,
        mass=0.1,
        radius_in=RADIUS_IN,
        radius_out=RADIUS_OUT,
        drag=0.5,
        method="accelerated",
        tolerance=1e-11,
        max_iterations=200_000,
    )


class Run(NamedTuple):
    """A trajectory."""

    end: FloatArray
    """Where the grains are after it [m], shape (n, 2)."""
    seconds: float
    """Spent on its steps, the least of some runs [s]."""


def run(scene: Scene, scheme: str, time: float, steps: int) -> Run:
    """Follow a scene for some time [s], in so many steps."""
    simulation = Simulation(scene, threads=1, dt=time / steps, **SCHEMES[scheme])
    start, seconds = simulation.state(), []
    for _ in range(REPEATS):
        simulation.restore(start)
        seconds.append(simulation.advance(steps).seconds)
    return Run(simulation.position, min(seconds))


def rows(grains: int, time: float, starts: int) -> Iterator[dict[str, Any]]:
    """Measure all steps of both schemes: medians of the starts, and how much less error than the text."""
    scenes = [thrown(grains, seed) for seed in range(starts)]
    truth = [run(scene, SECOND_ORDER, time, FINE).end for scene in scenes]
    own = _errors([run(scene, SECOND_ORDER, time, FINE // 2) for scene in scenes], truth)
    for steps in STEPS:
        text: FloatArray | None = None
        for scheme in SCHEMES:
            runs = [run(scene, scheme, time, steps) for scene in scenes]
            error = _errors(runs, truth)
            text = error if text is None else text
            yield {
                "grains": grains,
                "time": time,
                "steps": steps,
                "scheme": scheme,
                "seconds": np.median([one.seconds for one in runs]),
                "error": np.median(error),
                "error_min": error.min(),
                "error_max": error.max(),
                "own": np.median(own),
                "gain": np.median(text / error),
            }


def _errors(runs: list[Run], truth: list[FloatArray]) -> FloatArray:
    return np.array([np.abs(one.end - end).max() for one, end in zip(runs, truth, strict=True)])


def draw(measured: list[dict[str, Any]]) -> Figure:
    """Draw error over time, a column a number of grains: medians, and all starts as a band."""
    figure = Figure(figsize=(10.5, 3.6), layout="constrained")
    for axes, (grains, time) in zip(figure.subplots(1, len(CASES), sharey=True), CASES, strict=True):
        for scheme, color in COLORS.items():
            here = [row for row in measured if (row["grains"], row["scheme"]) == (grains, scheme)]
            spent = [1e3 * row["seconds"] for row in here]
            axes.fill_between(
                spent,
                [row["error_min"] for row in here],
                [row["error_max"] for row in here],
                color=color,
                alpha=0.12,
                linewidth=0.0,
            )
            axes.plot(
                spent, [row["error"] for row in here], color=color, marker="o", markersize=4, label=scheme
            )
        axes.set(xscale="log", yscale="log", xlabel="time for all steps, one thread [ms]")
        axes.set_title(f"{grains} grains, {time:g} s", fontsize="medium")
        axes.grid(color="0.9", linewidth=0.6)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    figure.axes[0].set_ylabel("error of the positions [m]")
    figure.axes[0].legend(fontsize="small", frameon=False)
    return figure


def main(arguments: list[str] | None = None) -> None:
    """Measure, write the figures down, and draw them."""
    summary = "Measure the error of trajectories in which grains collide, by both schemes."
    parser = argparse.ArgumentParser(prog="python -m tests.bench.schemes", description=summary)
    parser.add_argument("-o", "--output", type=Path, help="CSV file (default: standard output)")
    parser.add_argument("--picture", type=Path, help="picture of error over time")
    parser.add_argument("--starts", type=int, default=STARTS, help=f"random starts (default: {STARTS})")
    chosen = parser.parse_args(arguments)
    start_warp()
    measured: list[dict[str, Any]] = []
    with open_table(chosen.output, COLUMNS) as table:
        for grains, time in CASES:
            say(f"  {grains} grains")
            for row in rows(grains, time, chosen.starts):
                table.add({name: _shown(value) for name, value in row.items()})
                measured.append(row)
    if chosen.picture:
        draw(measured).savefig(chosen.picture, dpi=120, pil_kwargs={"optimize": True})


def _shown(value: Any) -> Any:
    return f"{value:.3g}" if isinstance(value, float) else value


if __name__ == "__main__":
    main()
