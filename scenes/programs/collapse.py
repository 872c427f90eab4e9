"""The collapse of columns of several aspect ratios, compared with the laws of Staron and Hinch (2005)."""

from typing import Any, NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components
from sections import Section, panels
from silos import G, filled, room, straight_line

import warpgrains as wg
from warpgrains.base.arrays import FloatArray

ASPECTS = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)  # height of the column over its width
BREAK = 2.0  # aspect ratio at which the law changes
COUNT = 1000
SEEDS = (0, 1, 2)


class Collapse(NamedTuple):
    """Result of a collapse: height of the column, growth of its width, and final height.

    All three are divided by the initial width of the column.
    """

    aspect: float
    run_out: float
    height: float


def column(aspect: float, seed: int = 0, count: int = COUNT, **fields: Any) -> tuple[wg.Scene, float]:
    """Return the scene of a column of grains between a wall and a gate, and the width of the column [m].

    `aspect` is its height over its width after settling, `count` the number of grains, and `fields` are
    further fields of the scene.
    """
    width = float(np.sqrt(room(count) / aspect))
    height, reach = aspect * width, (1.6 + 4.0 * aspect) * width
    domain = wg.Box((0.0, reach), (0.0, 2.0 * height))
    gate = wg.Segment((width, 0.0), (width, domain.y[1]))
    return filled(domain, count, seed, (0.0, width), [gate], **fields), width


def opened(scene: wg.Scene, settling: float) -> wg.Simulation:
    """Let grains settle for a time [s], and remove the gate, which is the first wall.

    Returns a simulation that continues from there.
    """
    closed = wg.Simulation(scene, threads=1)
    closed.run(duration=settling)
    state = {"position": closed.position, "velocity": closed.velocity, "spin": closed.spin}
    return wg.Simulation(scene.replace(**state, walls=scene.walls[1:]), threads=1)


def front(simulation: wg.Simulation) -> float:
    """Return the largest x of the pile [m].

    The pile consists of the grains that are connected to the leftmost one through close neighbors.
    """
    position, radius = simulation.position, simulation.scene.radius
    apart = np.hypot(*(position[:, np.newaxis] - position).transpose(2, 0, 1))
    _, pile = connected_components(apart < 2.2 * radius.max())
    held = pile == pile[np.argmin(position[:, 0])]
    return float((position[held, 0] + radius[held]).max())


def top(simulation: wg.Simulation) -> float:
    """Return the largest y at the top of a grain [m]."""
    return float((simulation.position[:, 1] + simulation.scene.radius).max())


def collapsed(aspect: float, seed: int = 0, count: int = COUNT, **fields: Any) -> Collapse:
    """Let a column settle for 0.8 s and then collapse; return its shape before and after.

    The arguments are those of `column`.
    """
    scene, width = column(aspect, seed, count, **fields)
    simulation = opened(scene, 0.8)
    tall = top(simulation)
    simulation.run(duration=round(1.0 + 4.0 * float(np.sqrt(tall / G)), 2))
    run_out = (front(simulation) - width) / width
    return Collapse(tall / width, run_out, top(simulation) / width)


def law(aspect: FloatArray) -> FloatArray:
    """Return the run-out, divided by the width, at aspect ratios a (Staron and Hinch 2005).

    It is 2.5 a for a up to 2, and 3.25 a^0.7 above.
    """
    return np.where(aspect <= BREAK, 2.5 * aspect, 3.25 * aspect**0.7)


def collapse() -> Section:
    """Let columns collapse, and draw their run-out and final height over the aspect ratio.

    Return the figure, the run-outs, and the fitted power laws.
    """
    runs = [[collapsed(aspect, seed) for aspect in ASPECTS] for seed in SEEDS]
    aspect, run_out, rest = np.mean(runs, axis=0).T
    spread = np.std(runs, axis=0, ddof=1)[:, 1]
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
    numbers = {f"a = {a:.2f}: run-out / width": length for a, length in zip(aspect, run_out, strict=True)}
    numbers["standard deviation of the seeds, in run-outs"] = float(np.mean(spread / run_out))
    for name, own in (("a up to 2", aspect < 1.2 * BREAK), ("a from 2", aspect > 0.8 * BREAK)):
        intercept, exponent = straight_line(np.log(aspect[own]), np.log(run_out[own]))
        numbers |= {f"{name}: exponent": exponent, f"{name}: factor": float(np.exp(intercept))}
    return figure, numbers
