"""The common style of the pictures in the gallery."""

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
WIDTH = 9.7
"""Width of a picture with curves [inches]."""
