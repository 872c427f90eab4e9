"""Pictures of how zeta and the residual fall in the iterations of steps."""

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from warpgrains.arrays import FloatArray
from warpgrains.errors import SceneError
from warpgrains.files import read_table, require_place
from warpgrains.pictures.canvas import save_figure
from warpgrains.pictures.kinds import STILLS

_LABELS = {"zeta": "zeta: largest change [m/s]", "residual": "residual: error that is left [m/s]"}
_SIZE = (9.0, 3.8)  # inches
_MAP = "viridis"


def plot_history(table: str | Path, output: str | Path) -> list[int]:
    """Draw zeta and residual against the iteration, a line a step.

    Parameters
    ----------
    table : str or Path
        A .csv file of ``warpgrains run --step-by-step --history``.
    output : str or Path
        The picture, a .png, .pdf or .svg file.

    Returns
    -------
    list of int
        The steps drawn.

    Raises
    ------
    SceneError
        The table cannot be read, or the picture cannot be written there.
    """
    output = Path(output)
    require_place("picture", output, *STILLS)
    step, iteration, *values = _columns(Path(table))
    steps = np.unique(step)
    figure = Figure(_SIZE, layout="constrained")
    colors = ScalarMappable(Normalize(steps[0], max(steps[-1], steps[0] + 1)), colormaps[_MAP])
    all_axes = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, name, value in zip(all_axes, _LABELS, values, strict=True):
        for number in steps:
            of_step = step == number
            drawn = np.where(value[of_step] > 0.0, value[of_step], np.nan)  # there is no logarithm of 0
            marker = "." if of_step.sum() < 3 else ""
            axes.semilogy(
                iteration[of_step], drawn, color=colors.to_rgba(number), linewidth=0.8, marker=marker
            )
        axes.set(xlabel="iteration", title=_LABELS[name])
        axes.grid(alpha=0.3)
    figure.colorbar(colors, ax=all_axes, label="step")
    save_figure(figure, output)
    return [int(number) for number in steps]


def _columns(table: Path) -> list[FloatArray]:
    rows = read_table(table)
    try:
        columns = [np.array([float(row[name]) for row in rows]) for name in ("step", "iteration", *_LABELS)]
    except (KeyError, TypeError, ValueError):
        columns = []
    if not columns or not len(rows) or not all(np.isfinite(column).all() for column in columns):
        raise SceneError(f"'{table}' is no history of `warpgrains run --step-by-step --history`")
    return columns
