"""The collapse of columns of several aspect ratios, held against the laws of Staron and Hinch (2005)."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

import warpgrains as wg
from warpgrains.arrays import FloatArray
from warpgrains.scenes.exhibits import Numbers
from warpgrains.scenes.filled import G, filled, opened, room, straight_line
from warpgrains.scenes.style import panels

ASPECTS = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
"""Height of the column over its width."""
BREAK = 2.0
"""Aspect ratio at which the law changes."""
COUNT = 1000
SETTLING = 0.8
"""Time before the gate is removed [s]."""


class Collapse(NamedTuple):
    """Results of a collapse."""

    aspect: float
    """Height of the column over its width, before the gate is removed."""
    run_out: float
    """Length by which the pile has grown, over the width of the column."""
    height: float
    """Height of the pile at the end, over the width of the column."""


def column(aspect: float, seed: int = 0, count: int = COUNT) -> tuple[wg.Scene, float]:
    """Return a column between a wall and a gate, the last of the walls, and its width [m]."""
    width = float(np.sqrt(room(count) / aspect))
    height, reach = aspect * width, (1.6 + 4.0 * aspect) * width
    left, top = -0.5 * reach, 1.2 * height + 0.1
    radius_out = float(np.hypot(0.5 * reach, top)) + 0.1
    walls = [
        wg.Segment((left - 0.05, 0.0), (radius_out, 0.0)),
        wg.Segment((left, 0.0), (left, top)),
        wg.Segment((left + width, 0.0), (left + width, top)),
    ]
    return filled(walls, (left, left + width, 0.0), count, seed, radius_out), width


def front(simulation: wg.Simulation) -> float:
    """Return x of the front [m] of the grains that are connected with the leftmost one, by near grains."""
    from scipy.sparse.csgraph import connected_components

    position, radius = simulation.position, simulation.scene.radius
    apart = np.hypot(*(position[:, np.newaxis] - position).transpose(2, 0, 1))
    _, pile = connected_components(apart < 2.2 * radius.max())
    held = pile == pile[np.argmin(position[:, 0])]
    return float((position[held, 0] + radius[held]).max())


def top(simulation: wg.Simulation) -> float:
    """Return y of the highest point of a grain [m]."""
    return float((simulation.position[:, 1] + simulation.scene.radius).max())


def collapse(aspect: float, seed: int = 0, count: int = COUNT) -> tuple[wg.Simulation, Collapse]:
    """Let a column settle and collapse; return the simulation at the end, and its results."""
    scene, width = column(aspect, seed, count)
    simulation = opened(scene, SETTLING)
    tall = top(simulation)
    simulation.run(duration=round(1.0 + 4.0 * float(np.sqrt(tall / G)), 2))
    foot = scene.walls[1].start[0]
    run_out = (front(simulation) - foot - width) / width
    return simulation, Collapse(tall / width, run_out, top(simulation) / width)


def law(aspect: FloatArray) -> FloatArray:
    """Return the run-out over the width of Staron and Hinch: 2.5 a up to 2, then 3.25 a^0.7."""
    return np.where(aspect <= BREAK, 2.5 * aspect, 3.25 * aspect**0.7)


def draw(path: Path) -> Numbers:
    """Let columns collapse, and draw their run-out over the aspect ratio."""
    found = [collapse(aspect)[1] for aspect in ASPECTS]
    aspect, run_out, rest = np.transpose(found)
    figure, (shown, heights) = panels(1, 2)
    line = np.geomspace(aspect.min(), aspect.max(), 50)
    shown.loglog(aspect, run_out, "o", label="grains")
    shown.loglog(line, law(line), "k:", label="2.5 a, 3.25 a$^{0.7}$")
    shown.set(xlabel="height / width, a", ylabel="run-out / width")
    heights.loglog(aspect, rest, "o", label="grains")
    heights.set(xlabel="height / width, a", ylabel="height at the end / width")
    for axes in (shown, heights):
        axes.minorticks_off()
        axes.set_xticks([0.5, 1.0, 2.0, 4.0, 8.0], ["0.5", "1", "2", "4", "8"])
    shown.set_yticks([1.0, 2.0, 5.0, 10.0], ["1", "2", "5", "10"])
    heights.set_yticks([0.5, 1.0, 1.5], ["0.5", "1", "1.5"])
    shown.legend()
    figure.savefig(path)
    numbers: Numbers = {}
    for one in found:
        numbers[f"a = {one.aspect:.2f}: run-out / width"] = one.run_out
    for name, own in (("a up to 2", aspect < 1.2 * BREAK), ("a from 2", aspect > 0.8 * BREAK)):
        intercept, exponent = straight_line(np.log(aspect[own]), np.log(run_out[own]))
        numbers[f"{name}: exponent"] = exponent
        numbers[f"{name}: factor"] = float(np.exp(intercept))
    return numbers
