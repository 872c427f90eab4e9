"""Grains at straight walls: two slopes, a hopper, and the collapse of a column."""

from math import cos, radians, sin
from pathlib import Path

import numpy as np

import warpgrains as wg
from warpgrains.scenes.exhibits import Numbers, Row, moments
from warpgrains.scenes.run_out import front, top

BELOW = -0.1
"""Height of the opening of the hopper [m]."""


def draw_slope(path: Path) -> Numbers:
    """Draw the grains on both slopes, and hold their ways against the closed forms."""
    scene, time = wg.Scene.load("slope"), 0.6
    simulation, _ = moments(path, scene, (0.2, 0.4, time), "spin")
    g, theta, friction = -scene.gravity[1], radians(30.0), scene.wall_frictions[3]
    rolls, slides = 2.0 / 3.0 * g * sin(theta), g * (sin(theta) - friction * cos(theta))
    ways = np.hypot(*(simulation.position - scene.position).T)
    return {
        "way of the upper grain [m]": float(ways[0]),
        "2/3 g sin(30) t^2 / 2 [m]": 0.5 * rolls * time**2,
        "way of the lower grain [m]": float(ways[1]),
        "g (sin(30) - 0.1 cos(30)) t^2 / 2 [m]": 0.5 * slides * time**2,
    }


def draw_hopper(path: Path) -> Numbers:
    """Draw the hopper, and count the grains that have left it."""
    scene = wg.Scene.load("hopper")
    simulation, row = wg.Simulation(scene), Row(path, 3)
    left = {}
    for time in (0.5, 1.0, 1.5, 2.0, 2.5):
        simulation.run(duration=time - simulation.time)
        left[time] = int((simulation.position[:, 1] < BELOW).sum())
        if time in (0.5, 1.5, 2.5):
            row.show(simulation)
    return {f"grains that have left after {time} s": number for time, number in left.items()}


def draw_collapse(path: Path) -> Numbers:
    """Draw the column before and after the gate opens, and measure it."""
    scene = wg.Scene.load("collapse")
    simulation, row = wg.Simulation(scene), Row(path, 4)
    for time in (0.5, 0.8, 1.1, scene.duration):
        simulation.run(duration=time - simulation.time)
        row.show(simulation)
        if time == 0.5:
            height = top(simulation) + 0.3
    width = 0.3
    return {
        "height of the column over its width": height / width,
        "run-out over its width": (front(simulation) + 0.6) / width,
        "height that remains over its width": (top(simulation) + 0.3) / width,
    }
