"""Silos of grains with friction: Beverloo's law of the flow out of one, and Janssen's law of its load."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import curve_fit
from sections import Numbers, Section, panels

import warpgrains as wg
from warpgrains import analysis
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
FIRST, LAST = 100, 600  # grains between whose departures the rate is measured
K = 1.4  # Beverloo's reduction of the opening, in diameters
HALF, TOP, BELOW = 0.9, 2.7, -1.2  # of the silo, whose floor is at y = 0, and of what is below [m]
EVERY = 0.02  # time between two counts [s]

HEIGHTS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # of the filling, in widths
SIDE = 0.4  # width of the silo [m], ten diameters
SPEED = 0.04  # of the bottom, downwards [m/s]: a diameter a second
SETTLING, SHEARED, MOVED = 1.0, 1.5, 3.0  # the bottom begins to move, the measurement begins, ends [s]


def room(count: int) -> float:
    """Return the area that grains at rest take, including the space between them [m2]."""
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
    """Return grains at random in a box, above y = 0 within x [m] or the whole width, looser than at rest."""
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


def opened(scene: wg.Scene, settling: float) -> wg.Simulation:
    """Let grains settle for a time [s]; return a simulation from then on without the gate, the first wall."""
    closed = wg.Simulation(scene, threads=1)
    closed.run(duration=settling)
    state = {"position": closed.position, "velocity": closed.velocity, "spin": closed.spin}
    return wg.Simulation(scene.replace(**state, walls=scene.walls[1:]), threads=1)


def straight_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return intercept and slope of the line of least squares."""
    intercept, slope = np.polynomial.Polynomial.fit(x, y, 1).convert().coef
    return float(intercept), float(slope)


def hopper_silo(opening: float, seed: int, count: int = COUNT) -> wg.Scene:
    """Return a silo with a flat floor, which has an opening [diameters] in its middle, closed by a gate."""
    half = 0.5 * opening * DIAMETER
    ends = (-half, half), (-HALF, -half), (half, HALF)
    walls = [wg.Segment((left, 0.0), (right, 0.0)) for left, right in ends]
    return filled(wg.Box((-HALF, HALF), (BELOW, TOP)), count, seed, walls=walls)


def departures(scene: wg.Scene, last: int = LAST, longest: float = 8.0) -> tuple[FloatArray, FloatArray]:
    """Return times since the gate opened [s], and the numbers of grains that have left, up to `last`."""
    simulation, left = opened(scene, 0.6), [0]
    while left[-1] < last and simulation.time < longest:
        simulation.advance(round(EVERY / scene.dt))
        left.append(int((simulation.position[:, 1] < 0.0).sum()))
    return EVERY * np.arange(len(left)), np.array(left)


def rate(time: FloatArray, left: FloatArray, first: int = FIRST) -> float:
    """Return the number of grains that leave per second, after the first ones [1/s]."""
    steady = left >= first
    return straight_line(time[steady], left[steady])[1]


def hopper() -> Section:
    """Empty silos through openings of several widths, and fit Beverloo's law."""
    figure, (counts, law) = panels(1, 2)
    mean, numbers = [], {}
    for opening in OPENINGS:
        runs = [departures(hopper_silo(opening, seed)) for seed in range(2)]
        rates = [rate(*run) for run in runs]
        mean.append(np.mean(rates))
        counts.plot(*runs[-1], label=f"D = {opening:g} d")
        numbers[f"D = {opening:g} d: grains a second"] = float(mean[-1])
        numbers[f"D = {opening:g} d: difference of the seeds"] = float(np.ptp(rates))
    counts.set(xlabel="t [s]", ylabel="grains that have left")
    counts.legend()
    power = np.array(mean) ** (2.0 / 3.0)
    intercept, slope = straight_line(np.array(OPENINGS), power)
    law.plot(OPENINGS, power, "o", label="grains")
    law.axline((0.0, intercept), slope=slope, color="k", linestyle=":", label="(D - k d)$^{3/2}$")
    law.set(xlabel="opening [diameters]", ylabel="(grains a second)$^{2/3}$")
    law.set(xlim=(0.0, None), ylim=(0.0, None))
    law.legend()
    numbers["k of the fit with exponent 3/2"] = -intercept / slope
    numbers["exponent with k = 1.4"] = straight_line(np.log(np.array(OPENINGS) - K), np.log(mean))[1]
    return figure, numbers


def piston_silo(height: float, seed: int, wall_friction: float = 0.5, **fields: Any) -> wg.Scene:
    """Return a silo whose bottom moves down like a piston; its filling has a height [widths]."""
    side, bottom = {"friction": wall_friction}, {"velocity": (0.0, -SPEED), "start_time": SETTLING}
    domain = wg.Box((0.0, SIDE), (0.0, 2.0 * height * SIDE), left=side, right=side, bottom=bottom)
    return filled(domain, round(height * SIDE**2 / room(1)), seed, **fields)


def load(scene: wg.Scene) -> float:
    """Return the mean mass that weighs on the bottom while it moves, measured every 5 steps [kg]."""
    simulation, loads = wg.Simulation(scene, threads=1), []
    simulation.advance(scene.steps_in(SHEARED))
    while simulation.time < MOVED:
        simulation.advance(5)
        loads.append(analysis.wall_forces(simulation)["bottom"].normal)
    return float(np.mean(loads)) / G


def janssen(mass: FloatArray, largest: float) -> FloatArray:
    """Return the mass that weighs on the bottom [kg] for filled masses [kg]; its limit is `largest` [kg]."""
    return largest * (1.0 - np.exp(-mass / largest))


def piston() -> Section:
    """Fill silos, lower their bottoms, and draw the loads on the bottoms."""
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
