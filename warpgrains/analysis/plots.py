"""Pictures of a recording: frames side by side with true radii, and curves over time below them.

Nothing here opens a window or knows of a display: the figure is drawn by Matplotlib's Agg.
"""

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure, SubFigure

from warpgrains.arrays import FloatArray
from warpgrains.errors import SceneError
from warpgrains.files import require_place
from warpgrains.pictures.canvas import FrameArtists, add_color_bar, save_figure
from warpgrains.pictures.kinds import STILLS
from warpgrains.pictures.shots import setting_of, shot_of
from warpgrains.usd.reader import RecordingReader, refusing_foreign_content

_FRAMES_IN_A_ROW = 5
_FRAME_SIZE = 2.4  # inches, and more where there are less than three
_CURVES_HEIGHT = 1.7  # inches
_LINE_WIDTH = 1.0  # points
_MARK_COLOR = "0.75"


def plot(
    recording: str | Path, output: str | Path, frames: Sequence[int] | None = None, curves: bool = True
) -> list[int]:
    """Draw frames of a recording, and what changes over time.

    Parameters
    ----------
    recording : str or Path
        The USD file.
    output : str or Path
        The picture, a .png, .pdf or .svg file.
    frames : sequence of int, optional
        Numbers of the frames to draw, negative ones from the end; by default five of them, evenly spaced.
    curves : bool
        Whether to draw energy, height and number of contacts over time.

    Returns
    -------
    list of int
        The frames drawn.

    Raises
    ------
    SceneError
        The recording cannot be read, is none or has no such frame, or the picture cannot be written there. A
        file that crashes USD or has no end is refused by the command ``warpgrains plot`` only.
    """
    output = Path(output)
    require_place("picture", output, *STILLS)
    with refusing_foreign_content(recording):
        reader = RecordingReader(recording)
        numbers = _numbers(frames, len(reader.time))
        save_figure(_draw(reader, numbers, curves and len(reader.time) > 1), output)
    return numbers


def _numbers(frames: Sequence[int] | None, count: int) -> list[int]:
    """Return the numbers of the frames to draw, none of them negative."""
    if frames is None:
        return sorted(set(np.linspace(0, count - 1, _FRAMES_IN_A_ROW).round().astype(int).tolist()))
    for frame in frames:
        if not -count <= frame < count:
            raise SceneError(f"there is no frame {frame}: the recording has {count}, from 0 to {count - 1}")
    return [frame % count for frame in frames]


def _draw(reader: RecordingReader, numbers: list[int], curves: bool) -> Figure:
    columns = min(len(numbers), _FRAMES_IN_A_ROW)
    rows = -(-len(numbers) // columns)
    size = max(_FRAME_SIZE, 3.0 * _FRAME_SIZE / columns)
    heights = [rows * size] + [_CURVES_HEIGHT] * curves
    figure = Figure(figsize=(columns * size, sum(heights)), layout="constrained")
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    upper, setting = figure.add_subfigure(grid[0]), setting_of(reader)
    places = upper.subplots(rows, columns, squeeze=False)
    for axes, number in zip_longest(places.flat, numbers):
        axes.set_axis_off()
        if number is not None:
            FrameArtists(axes, setting).show(shot_of(reader, number))
    if setting.scale is not None:
        add_color_bar(upper, places, setting.scale)
    if curves:
        _draw_curves(figure.add_subfigure(grid[1]), reader, reader.time[numbers])
    return figure


def _draw_curves(figure: SubFigure, reader: RecordingReader, marked: FloatArray) -> None:
    """Draw kinetic energy, height and number of contacts over time, and mark some moments [s]."""
    curves = measure(reader)
    for axes, (label, values) in zip(
        figure.subplots(1, len(curves), squeeze=False).flat, curves.items(), strict=True
    ):
        for moment in marked:
            axes.axvline(moment, color=_MARK_COLOR, linewidth=_LINE_WIDTH)
        axes.plot(reader.time, values, color="black", linewidth=_LINE_WIDTH)
        axes.set_title(label, fontsize="small")
        axes.tick_params(labelsize="small")
        axes.set_xlabel("t [s]", fontsize="small")
        axes.margins(x=0.0)


def measure(reader: RecordingReader) -> dict[str, FloatArray]:
    """Return each curve by its title, shape (f,).

    A recording holds no masses: energy and height are means over the grains, each counted alike.
    """
    frames = range(len(reader.time))
    energies = [0.5 * (reader.velocity(frame) ** 2).sum(axis=1).mean() for frame in frames]
    curves: dict[str, list[float]] = {"kinetic energy per mass [J/kg]": energies}
    curves["mean height [m]"] = [reader.position(frame)[:, 1].mean() for frame in frames]
    if reader.chain_scale is not None:
        curves["contacts that push"] = [len(reader.chains(frame).width) for frame in frames]
    return {title: np.array(values, dtype=np.float64) for title, values in curves.items()}
