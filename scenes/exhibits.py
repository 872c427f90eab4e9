"""Exhibits: functions that draw a picture and return the numbers it shows, and a program for them."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import warpgrains as wg
from warpgrains.scenes.style import STYLE
from warpgrains.solver.statistics import RunStatistics

Numbers = dict[str, float]
Exhibits = Mapping[str, Callable[[Path], Numbers]]


class Row:
    """Moments side by side."""

    def __init__(self, path: Path, panels: int) -> None:
        from matplotlib.figure import Figure

        self._path = path
        self._figure = Figure(figsize=(3.0 * panels + 0.7, 3.0), layout="constrained")
        self._axes = self._figure.subplots(1, panels, squeeze=False)[0]
        self._shown = 0

    def show(self, simulation: wg.Simulation, color_by: str = "speed", largest: float | None = None) -> None:
        """Draw the present state in the next panel; `largest` is that of `Painter`."""
        from warpgrains.pictures.shots import Painter
        from warpgrains.pictures.still import FrameArtists, add_color_bar

        painter = Painter(simulation.scene, color_by, forces=True, largest=largest)
        FrameArtists(self._axes[self._shown], painter.setting).show(painter.shot_of(simulation))
        self._shown += 1
        if self._shown == len(self._axes):
            if painter.setting.scale is not None:
                add_color_bar(self._figure, self._axes, painter.setting.scale)
            self._figure.savefig(self._path)


def moments(
    path: Path, scene: wg.Scene, times: Sequence[float], color_by: str = "speed"
) -> tuple[wg.Simulation, wg.Summary]:
    """Draw a scene at some times [s]; return it at the last, with what was done."""
    simulation, done, row = wg.Simulation(scene), RunStatistics(), Row(path, len(times))
    for begin, end in pairwise([0, *(scene.steps_in(time) for time in times)]):
        done.add(simulation.advance(end - begin))
        row.show(simulation, color_by)
    return simulation, done.summary(None)


def draw_exhibits(
    exhibits: Exhibits, description: str | None, folder: str, arguments: Sequence[str] | None = None
) -> dict[str, Numbers]:
    """Draw the exhibits that the arguments name, by default all, and print their numbers."""
    from matplotlib import rc_context

    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("-o", "--output", metavar="DIR", default=folder)
    parser.add_argument("names", metavar="NAME", nargs="*", help=f"of {', '.join(exhibits)}")
    chosen = parser.parse_args(arguments)
    output = Path(chosen.output)
    output.mkdir(parents=True, exist_ok=True)
    found = {}
    for name in chosen.names or exhibits:
        with rc_context(STYLE):
            found[name] = exhibits[name](output / f"{name}.png")
        print(name)
        for what, value in found[name].items():
            print(f"  {what:<40} {value:.6g}")
    return found
