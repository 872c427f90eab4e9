"""Curves of a recording: what changes over time."""

import numpy as np
from matplotlib.figure import SubFigure

from warpgrains.arrays import FloatArray
from warpgrains.usd.reader import RecordingReader

_LINE_WIDTH = 1.0  # points
_MARK_COLOR = "0.75"


def draw_curves(figure: SubFigure, reader: RecordingReader, marked: FloatArray) -> None:
    """Draw kinetic energy, height and number of contacts over time, as far as the recording tells them.

    Parameters
    ----------
    figure : SubFigure
        Where to draw.
    reader : RecordingReader
        The recording.
    marked : ndarray
        Moments to mark [s].
    """
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
    curves = {
        "kinetic energy per mass [J/kg]": [
            0.5 * (reader.velocity(frame) ** 2).sum(axis=1).mean() for frame in frames
        ],
        "mean height [m]": [reader.position(frame)[:, 1].mean() for frame in frames],
    }
    if reader.has_forces:
        curves["contacts that push"] = [len(reader.chains(frame).width) for frame in frames]
    return {title: np.array(values, dtype=np.float64) for title, values in curves.items()}
