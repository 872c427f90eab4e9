"""The common style of the pictures in the gallery."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
"""Settings of Matplotlib, for `matplotlib.rc_context`."""


def panels(rows: int = 1, columns: int = 1, height: float = 3.2, **options: Any) -> tuple["Figure", Any]:
    """Return a figure with a height [inches] for curves, and its axes, as `Figure.subplots` does."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.7, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **options)
