"""Silos of grains with friction: Beverloo's law of the outflow, and Janssen's law of the bottom's load."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import curve_fit
from sections import Numbers, Section, panels

import warpgrains as wg
from warpgrains import analysis
from warpgrains.analysis.series import block_average
from warpgrains.base.arrays import FloatArray
from warpgrains.scene.layouts import random_layout

G = 9.81
DIAMETER = 0.04  # mean of the grains [m]
RADII = (0.016, 0.024)  # between these the radii are distributed uniformly [m]
DENSITY = 10.0  # kg/m2
FRACTION = 0.82  # packing fraction that sizes of boxes are computed with
LOOSER = 1.3  # area at the start, over that at rest

OPENINGS = (7.0, 9.0, 11.0, 13.0, 15.0)  # in diameters
COUNT = 2000
STEADY, END, BLOCKS = 2.0, 12.0, 10  # the measurement begins, ends [s]; parts of it that the errors are from
HALF, TOP, BELOW = 0.9, 2.4, -0.6  # of the silo, whose floor is at y = 0, and of what is below [m]
EVERY = 0.02  # time between two counts [s]

HEIGHTS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # of the filling, in widths
SIDE = 0.4  # width of the silo [m], ten diameters
SPEED = 0.04  # of the bottom, downwards [m/s]: a diameter a second
SETTLING, SHEARED, MOVED = 1.0, 1.5, 3.0  # the bottom begins to move, the measurement begins, ends [s]


def room(count: int) -> float:
    """Return the area that `count` grains at rest take, including the space between them [m2]."""
    low, high = RADII
    return count * np.pi * (low**2 + low * high + high**2) / 3.0 / FRACTION


def filled(
    domain: wg.Box,
    count: int,
    seed: int,
    x: tuple[float, float] | None = None,
    walls: Sequence[wg.Segment] = (),
    **fields: Any,
) -> wg.Scene:
    """Return a scene of `count` grains at random places in a box, looser than grains at rest.

    They lie above y = 0 and within the interval `x` [m], by default the whole width. `fields` are further
    fields of the scene.
    """
    left, right = x or domain.x
    region = {"x": [left, right], "y": [0.0, LOOSER * room(count) / (right - left)]}
    position, radius = random_layout(domain.space, radius=list(RADII), count=count, region=region, seed=seed)
    defaults = {
        "friction": 0.5,
        "dt": 0.004,
        "scheme": "leapfrog",
        "tolerance": 1e-4,
        "max_iterations": 300,
        "method": "accelerated",
        "order": "color",
    }
    grains = {"position": position, "radius": radius, "mass": DENSITY * np.pi * np.square(radius)}
    return wg.Scene(**{**grains, "domain": domain, "walls": walls, **defaults, **fields})


def straight_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return intercept and slope of the line of least squares."""
    intercept, slope = np.polynomial.Polynomial.fit(x, y, 1).convert().coef
    return float(intercept), float(slope)


def beverloo(opening: FloatArray, factor: float, k: float, exponent: float = 1.5) -> FloatArray:
    """Return the number of grains that leave per second by Beverloo's law [1/s].

    It is factor (opening - k)^exponent, with the opening in diameters.
    """
    return factor * (opening - k) ** exponent


def hopper_silo(opening: float, count: int = COUNT) -> wg.Scene:
    """Return a silo with an opening [diameters] in its flat floor.

    A sink removes the grains that leave, and a source drops them in again at the top.
    """
    half = 0.5 * opening * DIAMETER
    walls = [wg.Segment((left, 0.0), (right, 0.0)) for left, right in ((-HALF, -half), (half, HALF))]
    above = {"region": {"y": (TOP - 0.5, TOP)}, "radius": RADII, "density": DENSITY}
    source = wg.Source(name="top", interval=EVERY, **above)
    sink = wg.Sink(region={"y": (BELOW, -0.1)}, into="top", interval=EVERY)
    domain = wg.Box((-HALF, HALF), (BELOW, TOP))
    return filled(domain, count, 0, walls=walls, sources=[source], sinks=[sink])


def departures(scene: wg.Scene, end: float = END) -> tuple[FloatArray, FloatArray, int]:
    """Simulate a silo until the time `end` [s].

    Returns times [s], the number of grains that have left by each time, and the number of grains at the end,
    including those that wait in the source.
    """
    simulation = wg.Simulation(scene, threads=1)
    rows = simulation.measure("outflow_count", every=scene.steps_in(EVERY), duration=end).rows
    time, left = np.array([(row["time"], row["outflow_count"]) for row in rows]).T
    return time, left, simulation.scene.n + simulation.inflow[0].waiting


def rate(time: FloatArray, left: FloatArray, blocks: int = BLOCKS) -> tuple[float, float]:
    """Return the number of grains that leave per second in the steady state, and its standard error [1/s].

    `time` and `left` are those of `departures`. The error is from means over `blocks` blocks of time.
    """
    flow = np.diff(left[time >= STEADY]) / EVERY
    mean, error = block_average(flow, blocks, np.ones_like(flow))
    return float(mean), float(error)


def hopper() -> Section:
    """Measure the outflow of silos with openings of several widths, and fit Beverloo's law.

    Return the figure, the outflows, and the parameters of the fit with errors.
    """
    figure, (counts, law, differences) = panels(1, 3)
    openings, rates, numbers, lost = np.array(OPENINGS), [], {}, 0
    for opening in OPENINGS:
        time, left, count = departures(hopper_silo(opening))
        rates.append(rate(time, left))
        lost += abs(COUNT - count)
        counts.plot(time, left, label=f"D = {opening:g} d")
        numbers[f"D = {opening:g} d: grains a second"], numbers[f"D = {opening:g} d: error"] = rates[-1]
    counts.set(xlabel="t [s]", ylabel="grains that have left")
    counts.legend()
    mean, error = np.transpose(rates)
    (factor, k), spread = curve_fit(beverloo, openings, mean, (15.0, 2.0), error, absolute_sigma=True)
    free, other = curve_fit(beverloo, openings, mean, (factor, k, 1.5), error, absolute_sigma=True)
    fitted = beverloo(openings, factor, k)
    law.plot(openings, mean ** (2 / 3), "o", label="grains")
    law.axline((k, 0.0), slope=factor ** (2 / 3), color="k", linestyle=":", label="(D - k d)$^{3/2}$")
    law.set(xlabel="opening [diameters]", ylabel="(grains a second)$^{2/3}$")
    law.set(xlim=(0.0, None), ylim=(0.0, None))
    law.legend()
    differences.errorbar(
        openings, 100.0 * (mean / fitted - 1.0), 100.0 * error / fitted, fmt="o", capsize=3.0
    )
    differences.axhline(0.0, color="k", linestyle=":")
    differences.set(xlabel="opening [diameters]", ylabel="grains a second / fit - 1 [%]")
    return figure, numbers | {
        "grains lost": lost,
        "k of the fit with exponent 3/2": float(k),
        "error of k": float(np.sqrt(spread[1, 1])),
        "worst difference from the fit / error": float(np.abs((mean - fitted) / error).max()),
        "exponent of the fit with any k": float(free[2]),
        "error of the exponent": float(np.sqrt(other[2, 2])),
    }


def piston_silo(height: float, seed: int, wall_friction: float = 0.5, **fields: Any) -> wg.Scene:
    """Return a silo whose bottom moves down like a piston. `height` is that of its filling [widths]."""
    side, bottom = {"friction": wall_friction}, {"velocity": (0.0, -SPEED), "start_time": SETTLING}
    domain = wg.Box((0.0, SIDE), (0.0, 2.0 * height * SIDE), left=side, right=side, bottom=bottom)
    return filled(domain, round(height * SIDE**2 / room(1)), seed, **fields)


def load(scene: wg.Scene) -> float:
    """Return the mean force on the bottom while it moves, divided by g [kg]. It is measured every 5 steps."""
    simulation, loads = wg.Simulation(scene, threads=1), []
    simulation.advance(scene.steps_in(SHEARED))
    while simulation.time < MOVED:
        simulation.advance(5)
        loads.append(analysis.wall_forces(simulation)["bottom"].normal)
    return float(np.mean(loads)) / G


def janssen(mass: FloatArray, largest: float) -> FloatArray:
    """Return the force on the bottom, divided by g, by Janssen's law [kg].

    `mass` are masses of the filling [kg]; `largest` is the limit for large masses [kg].
    """
    return largest * (1.0 - np.exp(-mass / largest))


def piston() -> Section:
    """Draw the loads on the bottoms of silos, as these move down, over the mass of the filling.

    Return the figure, the loads, and the parameters of Janssen's law that fit them.
    """
    rough, smooth = [], []
    for height in HEIGHTS:
        scenes = [piston_silo(height, seed) for seed in range(6)]
        rough.append(np.mean([(scene.mass.sum(), load(scene)) for scene in scenes], axis=0))
        scene = piston_silo(height, 0, 0.0, max_iterations=1000)
        smooth.append((scene.mass.sum(), load(scene)))
    (mass, loaded), (heavy, carried) = np.transpose(rough), np.transpose(smooth)
    largest = float(curve_fit(janssen, mass, loaded, p0=[loaded.max()])[0][0])
    depth = largest / (DENSITY * FRACTION * SIDE)
    numbers: Numbers = {
        f"{height:g} widths: load on the bottom / weight": float(one)
        for height, one in zip(HEIGHTS, loaded / mass, strict=True)
    }
    numbers |= {
        "largest load [kg]": largest,
        "depth lambda of the fit [widths]": depth / SIDE,
        "ratio of stresses K": SIDE / (2.0 * 0.5 * depth),
        "worst difference from the law / largest load": np.abs(loaded - janssen(mass, largest)).max()
        / largest,
        "smooth walls: worst difference from the weight / weight": np.abs(carried / heavy - 1.0).max(),
    }
    figure, axes = panels()
    line = np.linspace(0.0, heavy.max(), 100)
    axes.plot(mass, loaded, "o", label="walls with friction 0.5")
    axes.plot(line, janssen(line, largest), "k:", label="Janssen's law")
    axes.plot(heavy, carried, "s", label="walls without friction")
    axes.plot(line, line, color="0.6", linewidth=0.8, label="the weight")
    axes.set(xlabel="mass of the filling [kg]", ylabel="load on the bottom / g [kg]")
    axes.legend()
    return figure, numbers
