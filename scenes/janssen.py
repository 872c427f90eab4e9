"""The load on the bottom of a silo over its filling, held against Janssen's law."""

from pathlib import Path
from typing import Any

import numpy as np

import warpgrains as wg
from warpgrains.arrays import FloatArray
from warpgrains.scenes.exhibits import Numbers
from warpgrains.scenes.filled import DENSITY, FRACTION, G, filled, room
from warpgrains.scenes.style import panels

HEIGHTS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
"""Of the filling, in widths."""
SIDE = 0.4
"""Width of the silo [m], ten diameters."""
SPEED = 0.04
"""Of the bottom, downwards [m/s]: a diameter a second."""
SETTLING, SHEARED, MOVED = 1.0, 1.5, 3.0
"""Times at which the bottom begins to move, the measurement begins and ends [s]."""
EVERY = 5
"""Steps between two measurements."""
SEEDS = 6
BOTTOM = 2
"""Number of the bottom among the walls of a scene."""


def silo(height: float, seed: int, wall_friction: float = 0.5, **fields: Any) -> wg.Scene:
    """Return a silo whose bottom moves down like a piston, with a filling of some widths.

    `fields` replaces fields of the scene.
    """
    count = round(height * SIDE**2 / room(1))
    floor, half = -0.5 * height * SIDE, 0.5 * SIDE
    top = 0.75 * height * SIDE + 0.1
    walls = [
        wg.Segment((-half, floor), (half, floor), velocity=(0.0, -SPEED), from_time=SETTLING),
        *(wg.Segment((x, floor - 0.2), (x, top), friction=wall_friction) for x in (-half, half)),
    ]
    return filled(walls, (-half, half, floor), count, seed, float(np.hypot(half, top)) + 0.4, **fields)


def load(scene: wg.Scene) -> float:
    """Return the mean mass that weighs on the bottom while it moves [kg]."""
    simulation, loads = wg.Simulation(scene, threads=1), []
    simulation.advance(scene.steps_in(SHEARED))
    while simulation.time < MOVED:
        simulation.advance(EVERY)
        contacts = simulation.wall_contacts()
        loads.append(contacts.force[contacts.wall[:, 1] == BOTTOM].sum())
    return float(np.mean(loads)) / G


def janssen(mass: FloatArray, largest: float) -> FloatArray:
    """Return the mass that weighs on the bottom, where it is at most `largest` [kg]."""
    return largest * (1.0 - np.exp(-mass / largest))


def draw(path: Path) -> Numbers:
    """Fill silos, lower their bottoms, and draw the loads on them."""
    from scipy.optimize import curve_fit

    numbers: Numbers = {}
    rough, smooth = [], []
    for height in HEIGHTS:
        scenes = [silo(height, seed) for seed in range(SEEDS)]
        rough.append(np.mean([(scene.mass.sum(), load(scene)) for scene in scenes], axis=0))
        scene = silo(height, 0, 0.0, max_iterations=1000)
        smooth.append((scene.mass.sum(), load(scene)))
    mass, loaded = np.transpose(rough)
    ((largest,), _) = curve_fit(janssen, mass, loaded, p0=[loaded.max()])
    for height, one in zip(HEIGHTS, loaded / mass, strict=True):
        numbers[f"{height:g} widths: load on the bottom / weight"] = float(one)
    depth = float(largest) / (DENSITY * FRACTION * SIDE)
    numbers["largest load [kg]"] = float(largest)
    numbers["depth lambda of the fit [widths]"] = depth / SIDE
    numbers["ratio of stresses K"] = SIDE / (2.0 * 0.5 * depth)
    numbers["worst difference from the law / largest load"] = float(
        np.abs(loaded - janssen(mass, largest)).max() / largest
    )
    heavy, carried = np.transpose(smooth)
    numbers["smooth walls: worst difference from the weight / weight"] = float(
        np.abs(carried / heavy - 1.0).max()
    )
    figure, axes = panels()
    line = np.linspace(0.0, heavy.max(), 100)
    axes.plot(mass, loaded, "o", label="walls with friction 0.5")
    axes.plot(line, janssen(line, largest), "k:", label="Janssen's law")
    axes.plot(heavy, carried, "s", label="walls without friction")
    axes.plot(line, line, color="0.6", linewidth=0.8, label="the weight")
    axes.set(xlabel="mass of the filling [kg]", ylabel="load on the bottom / g [kg]")
    axes.legend()
    figure.savefig(path)
    return numbers
