"""The surface of a pile, in columns along gravity."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from warpgrains.analysis.region import Sides
from warpgrains.analysis.snapshot import Snapshot, upwards
from warpgrains.arrays import FloatArray

MOST_COLUMNS = 64


class Column(NamedTuple):
    """Space between two lines along gravity, below a level."""

    up: FloatArray
    """Unit vector against gravity, shape (2,)."""
    left: float
    right: float
    level: float
    bottom: float
    """Level below all walls [m], like the others."""

    @property
    def across(self) -> FloatArray:
        """Unit vector from left to right, shape (2,)."""
        return np.array([self.up[1], -self.up[0]])

    @property
    def sides(self) -> Sides:
        """Half planes whose intersection is the column."""
        return [(-self.across, -self.left), (self.across, self.right), (self.up, self.level)]


def columns_below_surface(now: Snapshot) -> list[Column]:
    """Return the columns that hold grains, up to a mean diameter below the uppermost center in each."""
    up, reach = upwards(now.scene.gravity_at(now.time)), now.scene.radius_out
    diameter = 2.0 * float(now.scene.radius.mean())
    count = max(1, min(MOST_COLUMNS, int(reach / diameter)))
    edges = np.linspace(-reach, reach, count + 1)
    grain = np.unique(now.loads.grain) if len(now.loads.grain) else np.arange(now.n)
    at = now.position[grain] @ np.array([up[1], -up[0]])
    column = np.clip(np.searchsorted(edges, at, "right") - 1, 0, count - 1)
    top = np.full(count, -np.inf)
    np.maximum.at(top, column, now.position[grain] @ up)
    edges[[0, -1]] *= 2.0  # beyond the wall, which bounds the outermost columns
    return [
        Column(up, float(edges[k]), float(edges[k + 1]), float(top[k] - diameter), -2.0 * reach)
        for k in np.flatnonzero(np.isfinite(top))
    ]


def staircases(columns: Sequence[Column]) -> list[FloatArray]:
    """Return the union of columns as polygons, one for each run of columns side by side."""
    runs: list[list[Column]] = []
    for column in columns:
        if runs and runs[-1][-1].right == column.left:
            runs[-1].append(column)
        else:
            runs.append([column])
    polygons = []
    for run in runs:
        first, last = run[0], run[-1]
        corner = [(first.left, first.bottom), (last.right, last.bottom)]
        corner += [(x, one.level) for one in reversed(run) for x in (one.right, one.left)]
        polygons.append(np.array(corner) @ np.stack([first.across, first.up]))
    return polygons
