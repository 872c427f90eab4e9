"""Plots of a recording and of a history of steps, drawn by Matplotlib's Agg without a window."""

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Unpack

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, SubFigure

from warpgrains.analysis.energy import kinetic_energy
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.base.files import read_table, require_writable_path
from warpgrains.base.locks import Lock
from warpgrains.drawing.kinds import STILLS
from warpgrains.drawing.looks import Looks
from warpgrains.drawing.painter import Painter
from warpgrains.pictures.still import DOTS_PER_INCH, FrameArtists, add_color_bar, save_figure, shares
from warpgrains.usd.recording import Recording, painter_of

_FRAMES_IN_A_ROW = 5
_FRAME_SIZE = 2.4  # inches per frame; larger for fewer than three frames
_CURVES_HEIGHT = 1.7  # inches
_LINE_WIDTH = 1.0  # points
_MARK_COLOR = "0.75"
_LABELS = {"zeta": "zeta: largest change [m/s]", "residual": "residual: error that is left [m/s]"}
_HISTORY_SIZE = (9.0, 3.8)  # inches
_STEPS_MAP = "viridis"


def plot(
    recording: str | Path,
    output: str | Path,
    frames: Sequence[int] | None = None,
    curves: bool = True,
    **looks: Unpack[Looks],
) -> list[int]:
    """Draw frames of a recording and, with `curves`, curves over time; return the indices of the frames.

    `frames` are indices, and may be negative; by default five frames are drawn, from the first to the last.
    The picture looks like the recording, except for the options in `looks`, see `RunOptions`.
    """
    output = Path(output)
    require_writable_path("picture", output, *STILLS)
    source = Recording(recording)
    numbers = _numbers(frames, len(source))
    with Lock(output):
        painter = painter_of(source, **looks)
        save_figure(_draw(source, painter, numbers, curves and len(source) > 1), output)
    return numbers


def _numbers(frames: Sequence[int] | None, count: int) -> list[int]:
    """Return `frames` as indices >= 0 in a recording of `count` frames; for None, those of five frames.

    A negative index counts from the end. InputError if an index is too large, or `frames` is empty.
    """
    if frames is None:
        return sorted(set(np.linspace(0, count - 1, _FRAMES_IN_A_ROW).round().astype(int).tolist()))
    if not len(frames):
        raise InputError("frames is empty: name one frame or more")
    return [checks.whole_number("frames", frame, least=-count, most=count - 1) % count for frame in frames]


def _draw(source: Recording, painter: Painter, numbers: list[int], curves: bool) -> Figure:
    columns = min(len(numbers), _FRAMES_IN_A_ROW)
    rows = -(-len(numbers) // columns)
    size = max(_FRAME_SIZE, 3.0 * _FRAME_SIZE / columns)
    snapshots = [source.frame(number, source.has_forces) for number in numbers]
    painter.show_all(*snapshots)
    across, along = shares(painter.view)
    heights = [rows * along * size] + [_CURVES_HEIGHT] * curves
    inches = columns * across * size, float(sum(heights))
    if (pixels := painter.look.pixels) is not None:
        inches = pixels[0] / DOTS_PER_INCH, pixels[1] / DOTS_PER_INCH
    figure = Figure(figsize=inches, facecolor=painter.background, layout="constrained")
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    upper = figure.add_subfigure(grid[0])
    places = upper.subplots(rows, columns, squeeze=False)
    for axes, now in zip_longest(places.flat, snapshots):
        axes.set_axis_off()
        if now is not None:
            FrameArtists(axes, painter).show(now)
    add_color_bar(upper, places, painter)
    if curves:
        _draw_curves(figure.add_subfigure(grid[1]), source, numbers)
    return figure


def _draw_curves(figure: SubFigure, source: Recording, marked: list[int]) -> None:
    """Draw the curves of `measure` over time, and mark the times of the frames with indices `marked`."""
    curves, time = measure(source), np.array([source.times.time(k) for k in range(len(source))])
    for axes, (label, values) in zip(
        figure.subplots(1, len(curves), squeeze=False).flat, curves.items(), strict=True
    ):
        for frame in marked:
            axes.axvline(time[frame], color=_MARK_COLOR, linewidth=_LINE_WIDTH)
        axes.plot(time, values, color="black", linewidth=_LINE_WIDTH)
        axes.set_title(label, fontsize="small")
        axes.tick_params(labelsize="small")
        axes.set_xlabel("t [s]", fontsize="small")
        axes.margins(x=0.0)


def measure(source: Recording) -> dict[str, FloatArray]:
    """Return curves of a recording with f frames, shape (f,) each, by their titles with units.

    They are kinetic energy per mass, mean height and, if forces are recorded, the number of contacts.
    """
    energies, heights, contacts = list[float](), list[float](), list[float]()
    for k in range(len(source)):
        now = source.frame(k, source.has_forces)
        energies.append(kinetic_energy(now) / float(now.scene.mass.sum()))
        heights.append(float((now.position @ now.scene.up_at(now.time)).mean()))
        contacts.append(len(now.force) + len(now.wall_force))
    curves = {"kinetic energy per mass [J/kg]": energies, "mean height [m]": heights}
    curves |= {"contacts that push": contacts} if source.has_forces else {}
    return {title: np.array(values, dtype=np.float64) for title, values in curves.items()}


def plot_history(table: str | Path, output: str | Path) -> list[int]:
    """Draw zeta and residual over the iterations of each step in a history table; return the steps.

    `warpgrains run --history` writes such a table.
    """
    output = Path(output)
    require_writable_path("picture", output, *STILLS)
    step, iteration, *values = _columns(Path(table))
    steps = np.unique(step)
    figure = Figure(_HISTORY_SIZE, layout="constrained")
    colors = ScalarMappable(Normalize(steps[0], max(steps[-1], steps[0] + 1)), colormaps[_STEPS_MAP])
    all_axes = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, name, value in zip(all_axes, _LABELS, values, strict=True):
        for number in steps:
            of_step = step == number
            drawn = np.where(value[of_step] > 0.0, value[of_step], np.nan)  # the logarithm of 0 is not drawn
            marker = "." if of_step.sum() < 3 else ""
            axes.semilogy(
                iteration[of_step], drawn, color=colors.to_rgba(number), linewidth=0.8, marker=marker
            )
        axes.set(xlabel="iteration", title=_LABELS[name])
        axes.grid(alpha=0.3)
    figure.colorbar(colors, ax=all_axes, label="step")
    with Lock(output):
        save_figure(figure, output)
    return [int(number) for number in steps]


def _columns(table: Path) -> list[FloatArray]:
    rows = read_table(table)
    try:
        columns = [np.array([float(row[name]) for row in rows]) for name in ("step", "iteration", *_LABELS)]
    except (KeyError, TypeError, ValueError):
        columns = []
    if not columns or not len(rows) or not all(np.isfinite(column).all() for column in columns):
        raise InputError(f"'{table}' is not a history: `warpgrains run --step-by-step --history` writes one")
    return columns
