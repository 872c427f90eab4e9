"""Validation of straight walls: slopes, the flow of a hopper, the collapse of a column, and a piston.

python -m warpgrains.scenes.walls -o validation [NAME ...]
"""

from functools import partial
from math import atan, cos, sin
from pathlib import Path
from typing import Any

import numpy as np

import warpgrains as wg
from warpgrains.arrays import FloatArray
from warpgrains.scenes import beverloo, janssen, run_out
from warpgrains.scenes.closed_forms import FRICTIONS, acceleration_on_a_slope, draw_accelerations
from warpgrains.scenes.exhibits import Exhibits, Numbers, draw_exhibits
from warpgrains.scenes.filled import G
from warpgrains.scenes.style import panels

RADIUS = 0.1
TILT = 0.5
"""Angular velocity of gravity [rad/s]."""
STEPS = 0.02 * 2.0 ** -np.arange(4)
"""Time steps of the orders [s]."""


def rolled(start: FloatArray, wall: wg.Segment, duration: float, **fields: Any) -> wg.Simulation:
    """Return a disc that starts at rest on a straight wall, after a while [s]."""
    scene = wg.Scene(position=[start], radius=RADIUS, mass=1.0, walls=[wall], tolerance=1e-12, **fields)
    simulation = wg.Simulation(scene)
    simulation.run(duration=duration)
    return simulation


def on_a_slope(tangent: float, friction: float, scheme: str = "leapfrog", dt: float = 0.01) -> wg.Simulation:
    """Return a disc after half a second on a straight wall of a slope."""
    theta = atan(tangent)
    along, up = np.array([cos(theta), -sin(theta)]), np.array([sin(theta), cos(theta)])
    wall = wg.Segment(tuple(-5.0 * along), tuple(5.0 * along))
    return rolled(RADIUS * up, wall, 0.5, radius_out=10.0, friction=friction, scheme=scheme, dt=dt)


def way(simulation: wg.Simulation) -> float:
    """Return the way that the disc has gone [m]."""
    return float(np.hypot(*(simulation.position - simulation.scene.position)[0]))


def tilted(friction: float, dt: float, scheme: str = "leapfrog") -> wg.Simulation:
    """Return a disc on a level floor after 2 s, in which gravity has turned by 1 rad."""
    start, wall = np.array([0.0, RADIUS]), wg.Segment((-15.0, 0.0), (15.0, 0.0))
    turning = {"rotate": TILT}
    return rolled(start, wall, 2.0, radius_out=20.0, gravity=turning, friction=friction, scheme=scheme, dt=dt)


def way_when_tilted(friction: float, time: float) -> float:
    """Return the way on a floor that is tilted by TILT t [m].

    The disc rolls up to tan(TILT t) = 3 mu, then it slides.
    """
    rolls = min(time, atan(3.0 * friction) / TILT)
    angle, end = TILT * rolls, TILT * time
    speed = 2.0 / 3.0 * G * (1.0 - cos(angle)) / TILT
    rolled = 2.0 / 3.0 * G * (angle - sin(angle)) / TILT**2
    at_first = speed + G * (cos(angle) + friction * sin(angle)) / TILT
    slid = G * (sin(angle) - sin(end) + friction * (cos(end) - cos(angle))) / TILT**2
    return rolled + at_first * (time - rolls) + slid


def draw_slope(path: Path) -> Numbers:
    """Let discs roll and slide on slopes, and on a floor that is tilted; draw them next to closed forms."""
    figure, (slopes, tilts) = panels(1, 2)
    worst = draw_accelerations(slopes, lambda *slope: way(on_a_slope(*slope)) / 0.125)
    numbers: Numbers = {"leapfrog: worst error of the acceleration [m/s2]": worst}
    for name, tangent, friction in (("rolls", 0.5, 0.3), ("slides", 1.5, 0.3)):
        exact_way = 0.125 * acceleration_on_a_slope(tangent, friction)
        errors = [abs(way(on_a_slope(tangent, friction, "text", dt)) - exact_way) for dt in STEPS]
        numbers[f"text, {name}: order in dt"] = float(np.log2(errors[-2] / errors[-1]))
    for friction, marker in zip(FRICTIONS, "osd", strict=True):
        exact_way = way_when_tilted(friction, 2.0)
        errors = [abs(way(tilted(friction, dt)) - exact_way) for dt in STEPS]
        tilts.loglog(STEPS, errors, f"{marker}-", label=f"friction {friction:g}")
        numbers[f"tilted, mu {friction:g}: relative error at dt 0.02 s"] = errors[0] / exact_way
        numbers[f"tilted, mu {friction:g}: order in dt"] = float(np.log2(errors[-2] / errors[-1]))
    tilts.loglog(STEPS, errors[0] * (STEPS / STEPS[0]) ** 2, "k:", label="second order")
    tilts.set(xlabel="dt [s]", ylabel="error of the way on a tilted floor [m]")
    tilts.set_xticks(STEPS, [f"{dt:g}" for dt in STEPS])
    tilts.minorticks_off()
    for axes in (slopes, tilts):
        axes.legend()
    figure.savefig(path)
    return numbers


EXHIBITS: Exhibits = {
    "slope": draw_slope,
    "hopper": beverloo.draw,
    "collapse": run_out.draw,
    "piston": janssen.draw,
}
main = partial(draw_exhibits, EXHIBITS, __doc__, "validation")


if __name__ == "__main__":
    main()
