"""Sections of a page, and the program that draws them.

A section is a function that does an experiment, and returns a figure and the numbers of the page by name.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

import warpgrains as wg
from warpgrains.analysis.snapshot import snapshot
from warpgrains.drawing.chains import ChainScale
from warpgrains.drawing.looks import Look
from warpgrains.drawing.painter import Painter
from warpgrains.pictures.still import FrameArtists, add_color_bar
from warpgrains.solver.statistics import Summary

Numbers = dict[str, float]
Section = tuple[Figure, Numbers]
Sections = Mapping[str, Callable[[], Section]]
STYLE = {
    "font.size": 9.0,
    "legend.fontsize": "small",
    "legend.frameon": False,
    "lines.markersize": 4.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "0.9",
    "axes.axisbelow": True,
    "savefig.dpi": 110,
}


def panels(rows: int = 1, columns: int = 1, height: float = 3.2, **options: Any) -> tuple[Figure, Any]:
    """Return a figure for curves with a height [inches], and its axes, see `Figure.subplots`."""
    figure = Figure(figsize=(9.7, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **options)


def draw_orders(axes: Any, dt: Any, errors: Any, **labels: Any) -> None:
    """Add the line of errors of second order in dt, through the first error, to logarithmic axes.

    `dt` are the time steps [s], which become ticks, and `errors` the errors at these. `labels` are properties
    of the axes, such as `ylabel`.
    """
    axes.loglog(dt, errors[0] * (dt / dt[0]) ** 2, "k:", label="second order")
    axes.set(xlabel="dt [s]", **labels)
    axes.set_xticks(dt, [f"{one:g}" for one in dt])
    axes.minorticks_off()


class Row:
    """A figure with `count` panels side by side, into which `show` draws states of simulations."""

    def __init__(self, count: int) -> None:
        self.figure = Figure(figsize=(3.0 * count + 0.7, 3.0), layout="constrained")
        self.axes = self.figure.subplots(1, count)
        self._free = list(self.axes)

    def show(
        self,
        simulation: wg.Simulation,
        color_by: str = "speed",
        largest: float | None = None,
        frame: str | None = None,
        range: str | None = None,
    ) -> None:
        """Draw the present state of a simulation in the next free panel, with force chains.

        If `largest` is given, it is the force of a chain of full width [N]. Colors of pressures then end at
        `largest` divided by the diameter of a mean grain. The other arguments are fields of `Look`.
        """
        scene = simulation.scene
        painter = Painter(scene, Look(color_by=color_by, forces=True, frame=frame, range=range))
        if largest is not None:
            painter.chain_scale = ChainScale(largest, scene.smallest_radius)
            if painter.colors.scale is not None and color_by == "pressure":
                high = largest / (2.0 * float(scene.radius.mean()))
                painter.colors.scale = replace(painter.colors.scale, high=high)
        FrameArtists(self._free.pop(0), painter).show(snapshot(simulation))
        if not self._free:
            add_color_bar(self.figure, self.axes, painter)


def moments(
    scene: wg.Scene, times: Sequence[float], color_by: str = "speed"
) -> tuple[Figure, wg.Simulation, wg.Summary]:
    """Simulate a scene and draw it at some times [s].

    Returns the figure, the simulation at the last time, and the summary of all its steps.
    """
    simulation, done, row = wg.Simulation(scene), Summary(), Row(len(times))
    for begin, end in pairwise([0, *(scene.steps_in(time) for time in times)]):
        done.add(simulation.advance(end - begin))
        row.show(simulation, color_by)
    return row.figure, simulation, done


def draw_sections(
    sections: Sections, description: str | None, folder: str, arguments: Sequence[str] | None = None
) -> dict[str, Numbers]:
    """Draw the sections that command line arguments name, by default all; print and return their numbers.

    `sections` holds the functions by name, and `description` is the text of ``--help``. Pictures are written
    to `folder`, unless ``-o`` names another one. Without `arguments`, those of the process are parsed.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("-o", "--output", metavar="DIR", type=Path, default=folder)
    parser.add_argument("names", metavar="NAME", nargs="*", help=f"of {', '.join(sections)}")
    chosen, found = parser.parse_args(arguments), {}
    if unknown := set(chosen.names) - sections.keys():
        parser.error(f"unknown section '{min(unknown)}': one of {', '.join(sections)}")
    chosen.output.mkdir(parents=True, exist_ok=True)
    for name in chosen.names or sections:
        with rc_context(STYLE):
            figure, found[name] = sections[name]()
            figure.savefig(chosen.output / f"{name}.png")
        print(name)
        for what, value in found[name].items():
            print(f"  {what:<40} {value:.6g}")
    return found
