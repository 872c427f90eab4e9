"""Restitution: a ball that bounces, a gas of elastic discs in a periodic box, and a gas that cools.

Each function is one experiment. `section` draws them, and tests compare their numbers with theory.
"""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from sections import Section, panels

import warpgrains as wg
from warpgrains import analysis
from warpgrains.base.arrays import FloatArray

SIDE = 45  # discs along a side of the box
DIAMETER = 0.02
G, HEIGHT = 9.81, 0.5
FRACTIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
COOLING_FRACTION, COOLING = 0.2, 0.9  # packing fraction and restitution of the gas that cools


def ball(e: float, dt: float) -> tuple[FloatArray, FloatArray]:
    """Simulate a ball with restitution `e` that falls from 0.5 m, up to 1.1 times `time_of_rest`.

    Returns times [s] and heights [m] after all steps.
    """
    floor, end = wg.Segment((-5.0, 0.0), (5.0, 0.0)), 1.1 * time_of_rest(e)
    fields = {"radius": 0.1, "mass": 1.0, "radius_out": 9.0, "walls": [floor], "scheme": "leapfrog"}
    scene = wg.Scene(position=[(0.0, HEIGHT + 0.1)], gravity=(0.0, -G), restitution=e, dt=dt, **fields)
    simulation = wg.Simulation(scene)
    heights = [HEIGHT]
    for _ in range(round(end / dt)):
        simulation.step()
        heights.append(simulation.position[0, 1] - 0.1)
    return dt * np.arange(len(heights)), np.array(heights)


def time_of_rest(e: float) -> float:
    """Return the exact time at which a ball with restitution `e`, which fell from 0.5 m, comes to rest [s].

    Until then, it has bounced infinitely often.
    """
    return sqrt(2.0 * HEIGHT / G) * (1.0 + e) / (1.0 - e)


def tops(heights: FloatArray) -> FloatArray:
    """Return the maxima of heights [m], at the tops of the bounces."""
    return heights[1:-1][(heights[1:-1] > heights[:-2]) & (heights[1:-1] >= heights[2:])]


def gas(fraction: float, step: float, side: int = SIDE) -> wg.Scene:
    """Return side**2 elastic discs on a lattice in a periodic box, with Maxwellian velocities.

    They fill `fraction` of the area. The variance of a velocity component is 1 m2/s2. dt is `step` times the
    time in which a disc of 1 m/s moves by a diameter.
    """
    random, length = np.random.default_rng(1), side * DIAMETER * sqrt(pi / (4.0 * fraction))
    along = (np.arange(side) + 0.5) * length / side
    velocity = random.normal(0.0, 1.0, (side**2, 2))
    velocity -= velocity.mean(axis=0)
    return wg.Scene(
        position=np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2),
        velocity=velocity / np.sqrt(0.5 * (velocity**2).sum(axis=1).mean()),
        radius=0.5 * DIAMETER,
        mass=1.0,
        domain=wg.Box((0.0, length), (0.0, length), periodic="xy"),
        gravity=(0.0, 0.0),
        restitution=1.0,
        dt=step * DIAMETER,
        tolerance=1e-9,
    )


def henderson(fraction: float) -> float:
    """Return P A / (N m T) of a gas of elastic discs with this packing fraction (Henderson 1975).

    P is the pressure, A the area, N the number of discs, and T the variance of a velocity component.
    """
    return float((1.0 + fraction**2 / 8.0) / (1.0 - fraction) ** 2)


def contact_value(fraction: float) -> float:
    """Return the pair correlation g(r) of discs at contact, which follows from `henderson`."""
    return (henderson(fraction) - 1.0) / (2.0 * fraction)


class Equilibrium(NamedTuple):
    """Means over a simulation of a gas in equilibrium, and its final velocities."""

    pressure: float
    """Mean of P A / (N m T)."""
    lost: float
    """Fraction of the initial kinetic energy that was lost by errors of time integration."""
    velocity: FloatArray
    """Velocity components at the end, divided by their standard deviation, shape (2 n,)."""


def warm(fraction: float, time: float, side: int = SIDE) -> wg.Scene:
    """Return the gas of `gas` after a time, with its velocities scaled back to the temperature 1 m2/s2.

    The unit of the time is that in which a disc of 1 m/s moves by a diameter.
    """
    scene = gas(fraction, 0.01, side)
    simulation = wg.Simulation(scene)
    simulation.advance(round(time / 0.01))
    temperature = analysis.kinetic_energy(simulation) / scene.n
    return scene.replace(
        position=scene.period.wrapped(simulation.position), velocity=simulation.velocity / sqrt(temperature)
    )


def equilibrium(start: wg.Scene, step: float, time: float = 2.0) -> Equilibrium:
    """Simulate a gas for a time in steps of `step`, both in the time unit of `warm`.

    The pressure is computed from the contact forces by the virial theorem.
    """
    simulation = wg.Simulation(start, dt=step * DIAMETER)
    virial, kinetic, steps = 0.0, [analysis.kinetic_energy(simulation)], round(time / step)
    for _ in range(steps):
        simulation.step()
        contacts = simulation.contacts()
        virial += 0.5 * float(contacts.force @ (contacts.gap + DIAMETER))
        kinetic.append(analysis.kinetic_energy(simulation))
    velocity = simulation.velocity.ravel() / sqrt(kinetic[-1] / start.n)
    return Equilibrium(1.0 + virial / sum(kinetic[1:]), 1.0 - kinetic[-1] / kinetic[0], velocity)


def cooling(start: wg.Scene, e: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Simulate a gas with restitution `e` that cools; return times and temperatures.

    Times are in units of Haff's tau, temperatures in units of the first one. For tau, a disc collides at the
    rate 2 n d g sqrt(pi T), and a collision of two discs loses the energy (1 - e^2) m T on average. Here n is
    the number density, d the diameter, m the mass, g `contact_value`, and T the variance of a velocity
    component. `step` is that of `gas`.
    """
    fraction = start.n * pi * DIAMETER**2 / (4.0 * start.period.lengths.prod())
    rate = 8.0 * fraction * contact_value(fraction) / (sqrt(pi) * DIAMETER)
    tau, simulation = 4.0 / ((1.0 - e**2) * rate), wg.Simulation(start, dt=step * DIAMETER, restitution=e)
    times, temperatures = [0.0], [1.0]
    while times[-1] < 1.0:
        simulation.advance(round(0.1 * tau / simulation.scene.dt))
        times.append(simulation.time / tau)
        temperatures.append(analysis.kinetic_energy(simulation) / start.n)
    return np.array(times), np.array(temperatures)


def section() -> Section:
    """Draw the bounces of a ball, the pressure of a gas, its loss of energy over dt, and Haff's law.

    Return the figure and the numbers that are compared with theory.
    """
    figure, ((over_time, over_fraction), (over_dt, over_tau)) = panels(2, 2, height=6.4)
    numbers: dict[str, float] = {}
    for e in (0.5, 0.7, 0.9):
        over_time.plot(*ball(e, 1e-3), label=f"e = {e:g}")
        over_time.plot(time_of_rest(e), 0.0, "k^", clip_on=False, label="time of rest" * (e == 0.9))
        for dt in (2e-3, 1e-3):
            time, heights = ball(e, dt)
            found = tops(heights)[:4] / np.array([HEIGHT, *tops(heights)[:3]])
            numbers[f"e {e:g}, dt {dt:g} s: worst error of a ratio of heights"] = float(
                np.abs(found - e**2).max()
            )
            rest = time[np.flatnonzero(np.abs(heights) > 1e-6)[-1]] - time_of_rest(e)
            numbers[f"e {e:g}, dt {dt:g} s: time of rest, late by [s]"] = float(rest)
    steps, found, curve = (4e-3, 2e-3), {}, np.linspace(0.05, 0.62)
    for fraction in FRACTIONS:
        start = warm(fraction, 3.0)
        found[fraction] = [equilibrium(start, step) for step in steps]
        for step, one in zip(steps, found[fraction], strict=True):
            key = f"phi {fraction:g}, step {step:g} d"
            numbers[f"{key}: pressure / Henderson's"] = one.pressure / henderson(fraction)
            numbers[f"{key}: energy lost"] = one.lost
        numbers[f"phi {fraction:g}: mean of v^4"] = float((found[fraction][-1].velocity ** 4).mean())
    over_fraction.plot(curve, [henderson(one) for one in curve], "k:", label="Henderson")
    over_fraction.plot(FRACTIONS, [one[-1].pressure for one in found.values()], "o", label="2,025 discs")
    for fraction in FRACTIONS[2:]:
        over_dt.loglog(steps, [one.lost for one in found[fraction]], "o-", label=f"phi = {fraction:g}")
    start = warm(COOLING_FRACTION, 10.0)
    for step in (1e-2, 5e-3, 2.5e-3):
        time, temperature = cooling(start, COOLING, step)
        over_tau.plot(time, temperature**-0.5, label=f"step {step:g} d")
        slope = float(np.polyfit(time, temperature**-0.5, 1)[0])
        numbers[f"cooling, step {step:g} d: tau / theory"] = 1.0 / slope
    over_tau.plot(time, 1.0 + time, "k:", label="Haff")
    over_time.set(xlabel="t [s]", ylabel="height [m]")
    over_fraction.set(xlabel="packing fraction", ylabel="P A / (N m T)")
    over_dt.set(xlabel="way of a disc in a step [d]", ylabel="energy lost in 2 d / v")
    over_dt.set_xticks(steps, [f"{step:g}" for step in steps])
    over_dt.minorticks_off()
    over_tau.set(xlabel="t / tau", ylabel="(T0 / T)^(1/2)")
    for axes in (over_time, over_fraction, over_dt, over_tau):
        axes.legend(fontsize="x-small")
    return figure, numbers
