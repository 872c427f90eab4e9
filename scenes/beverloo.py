"""The flow out of a silo over the width of its opening, held against Beverloo's law."""

from pathlib import Path

import numpy as np

import warpgrains as wg
from warpgrains.arrays import FloatArray
from warpgrains.scenes.exhibits import Numbers
from warpgrains.scenes.filled import DIAMETER, filled, opened, straight_line
from warpgrains.scenes.style import panels

OPENINGS = (7.0, 9.0, 11.0, 13.0, 15.0)
"""In diameters."""
COUNT, SEEDS = 2000, 2
FIRST, LAST = 100, 600
"""Grains between whose departures the rate is measured."""
K = 1.4
"""Beverloo's reduction of the opening, in diameters."""
HALF, FLOOR, TOP, RADIUS_OUT = 0.9, -0.9, 1.8, 2.1
SETTLING = 0.6
"""Time before the gate opens [s]."""
EVERY = 0.02
"""Time between two counts [s]."""


def silo(opening: float, seed: int, count: int = COUNT) -> wg.Scene:
    """Return a silo with a flat floor, an opening in its middle, in diameters, and a gate in the opening."""
    half = 0.5 * opening * DIAMETER
    walls = [wg.Segment((sign * HALF, FLOOR), (sign * half, FLOOR)) for sign in (-1.0, 1.0)]
    walls += [wg.Segment((sign * HALF, FLOOR), (sign * HALF, TOP)) for sign in (-1.0, 1.0)]
    walls.append(wg.Segment((-half, FLOOR), (half, FLOOR)))
    return filled(walls, (-HALF, HALF, FLOOR), count, seed, RADIUS_OUT)


def departures(scene: wg.Scene, last: int = LAST, longest: float = 8.0) -> tuple[FloatArray, FloatArray]:
    """Return times since the gate opened [s], and the numbers of grains below the floor, until `last` are."""
    simulation, left = opened(scene, SETTLING), [0]
    while left[-1] < last and simulation.time < longest:
        simulation.advance(round(EVERY / scene.dt))
        left.append(int((simulation.position[:, 1] < FLOOR).sum()))
    return EVERY * np.arange(len(left)), np.array(left)


def rate(time: FloatArray, left: FloatArray, first: int = FIRST) -> float:
    """Return the flow rate once `first` grains have left [1/s]."""
    steady = left >= first
    return straight_line(time[steady], left[steady])[1]


def draw(path: Path) -> Numbers:
    """Empty silos through several openings, and fit Beverloo's law."""
    figure, (counts, law) = panels(1, 2)
    rates, numbers = np.zeros((SEEDS, len(OPENINGS))), {}
    for k, opening in enumerate(OPENINGS):
        for seed in range(SEEDS):
            time, left = departures(silo(opening, seed))
            rates[seed, k] = rate(time, left)
        counts.plot(time, left, label=f"D = {opening:g} d")
        numbers[f"D = {opening:g} d: grains a second"] = float(rates[:, k].mean())
        numbers[f"D = {opening:g} d: difference of the seeds"] = float(np.ptp(rates[:, k]))
    opening, mean = np.array(OPENINGS), rates.mean(axis=0)
    intercept, slope = straight_line(opening, mean ** (2.0 / 3.0))
    exponent = straight_line(np.log(opening - K), np.log(mean))[1]
    counts.set(xlabel="t [s]", ylabel="grains that have left")
    counts.legend()
    law.plot(OPENINGS, mean ** (2.0 / 3.0), "o", label="grains")
    law.axline((0.0, intercept), slope=slope, color="k", linestyle=":", label="(D - k d)$^{3/2}$")
    law.set(
        xlabel="opening [diameters]", ylabel="(grains a second)$^{2/3}$", xlim=(0.0, None), ylim=(0.0, None)
    )
    law.legend()
    figure.savefig(path)
    return numbers | {"k of the fit with exponent 3/2": -intercept / slope, "exponent with k = 1.4": exponent}
