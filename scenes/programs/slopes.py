"""A disc on straight walls next to closed forms: on a slope, and on a floor while gravity turns."""

from math import atan, cos, sin
from typing import Any

import numpy as np
from closed_forms import FRICTIONS, G, acceleration_on_a_slope, draw_accelerations
from sections import Numbers, Section, draw_orders, panels

import warpgrains as wg
from warpgrains.base.arrays import FloatArray

RADIUS = 0.1
TILT = 0.5  # angular velocity of gravity [rad/s]
STEPS = 0.02 * 2.0 ** -np.arange(4)  # time steps of the orders [s]


def way(start: FloatArray, wall: wg.Segment, duration: float, **fields: Any) -> float:
    """Return the distance that a disc moves on a straight wall within `duration` [s], from rest [m].

    `start` is its center at the start [m], and `fields` are further fields of the scene.
    """
    scene = wg.Scene(position=[start], radius=RADIUS, mass=1.0, walls=[wall], tolerance=1e-12, **fields)
    simulation = wg.Simulation(scene)
    simulation.run(duration=duration)
    return float(np.hypot(*(simulation.position - scene.position)[0]))


def way_on_a_slope(tangent: float, friction: float, scheme: str = "leapfrog", dt: float = 0.01) -> float:
    """Return the distance that a disc moves down a slope in half a second [m].

    `tangent` is tan(slope), `scheme` that of `Scene`, and `dt` the time step [s].
    """
    theta = atan(tangent)
    along, up = np.array([cos(theta), -sin(theta)]), np.array([sin(theta), cos(theta)])
    wall = wg.Segment(tuple(-5.0 * along), tuple(5.0 * along))
    return way(RADIUS * up, wall, 0.5, radius_out=10.0, friction=friction, scheme=scheme, dt=dt)


def way_when_tilted(friction: float, dt: float) -> float:
    """Return the distance that a disc moves on a floor in 2 s, while gravity turns by 1 rad [m]."""
    start, wall = np.array([0.0, RADIUS]), wg.Segment((-15.0, 0.0), (15.0, 0.0))
    fields = {"radius_out": 20.0, "gravity": {"angular_velocity": TILT}, "scheme": "leapfrog"}
    return way(start, wall, 2.0, friction=friction, dt=dt, **fields)


def exact_way_when_tilted(friction: float, time: float = 2.0) -> float:
    """Return the exact distance of `way_when_tilted` [m].

    At the time t, gravity has turned by TILT t. The disc rolls until tan(TILT t) = 3 friction, then it
    slides.
    """
    rolls = min(time, atan(3.0 * friction) / TILT)
    angle, end = TILT * rolls, TILT * time
    speed = 2.0 / 3.0 * G * (1.0 - cos(angle)) / TILT
    rolled = 2.0 / 3.0 * G * (angle - sin(angle)) / TILT**2
    at_first = speed + G * (cos(angle) + friction * sin(angle)) / TILT
    slid = G * (sin(angle) - sin(end) + friction * (cos(end) - cos(angle))) / TILT**2
    return rolled + at_first * (time - rolls) + slid


def slope() -> Section:
    """Draw accelerations of discs on slopes, and errors of their distances while gravity turns.

    Return the figure, the errors with respect to closed forms, and their orders in dt.
    """
    figure, (slopes, tilts) = panels(1, 2)
    worst = draw_accelerations(slopes, lambda *slope: way_on_a_slope(*slope) / 0.125)
    numbers: Numbers = {"leapfrog: worst error of the acceleration [m/s2]": worst}
    for name, tangent, friction in (("rolls", 0.5, 0.3), ("slides", 1.5, 0.3)):
        exact = 0.125 * acceleration_on_a_slope(tangent, friction)
        errors = [abs(way_on_a_slope(tangent, friction, "euler", dt) - exact) for dt in STEPS]
        numbers[f"text, {name}: order in dt"] = float(np.log2(errors[-2] / errors[-1]))
    for friction, marker in zip(FRICTIONS, "osd", strict=True):
        exact = exact_way_when_tilted(friction)
        errors = [abs(way_when_tilted(friction, dt) - exact) for dt in STEPS]
        tilts.loglog(STEPS, errors, f"{marker}-", label=f"friction {friction:g}")
        numbers[f"tilted, mu {friction:g}: relative error at dt 0.02 s"] = errors[0] / exact
        numbers[f"tilted, mu {friction:g}: order in dt"] = float(np.log2(errors[-2] / errors[-1]))
    draw_orders(tilts, STEPS, errors, ylabel="error of the way on a tilted floor [m]")
    for axes in (slopes, tilts):
        axes.legend()
    return figure, numbers
