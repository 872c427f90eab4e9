"""Stress from contact forces, after Love and Weber; compression is positive.

    sigma = 1 / A sum_c f_c l_c n n^T,

l_c n from the centre of a grain to its contact c, f_c the force there, A an area of the grains [m2]: in the
plane a stress is a force by length [N/m]. Contacts carry no friction, so it is symmetric.
"""

import numpy as np

from warpgrains.analysis.packing import cell_areas
from warpgrains.analysis.snapshot import HasState, Snapshot, snapshot
from warpgrains.arrays import FloatArray


def grain_stresses(of: Snapshot | HasState, area: FloatArray | None = None) -> FloatArray:
    """Return the stress of every grain [N/m], shape (n, 2, 2).

    Parameters
    ----------
    of : Snapshot or Simulation
    area : ndarray, optional
        What the stress is spread over [m2], shape (n,); by default the cells of `cell_areas`, which needs
        scipy. Weighted by it, stresses add up to `mean_stress`.

    Raises
    ------
    SceneError
        scipy is not installed; it comes with the extra ``[report]``.

    Examples
    --------
    >>> analysis.grain_stresses(simulation).shape
    (15, 2, 2)
    """
    moment = snapshot(of)
    area = cell_areas(moment) if area is None else area
    return _moments(moment) / area[:, np.newaxis, np.newaxis]


def mean_stress(of: Snapshot | HasState) -> FloatArray:
    """Return the stress averaged over the space between the walls [N/m], shape (2, 2).

    Examples
    --------
    >>> analysis.mean_stress(simulation).round(4)
    array([[0.2089, 0.0003],
           [0.0003, 0.1808]])
    """
    moment = snapshot(of)
    return _moments(moment).sum(axis=0) / moment.scene.walls.area


def pressure(of: Snapshot | HasState) -> float:
    """Return half the trace of the mean stress [N/m].

    Examples
    --------
    >>> f"{analysis.pressure(simulation):.4f} N/m"
    '0.1948 N/m'
    """
    return float(np.trace(mean_stress(of)) / 2.0)


def _moments(moment: Snapshot) -> FloatArray:
    """Return the sum of f l n n^T over the contacts of each grain [N m], shape (n, 2, 2)."""
    grain, normal, force = moment.loads
    weight = force * moment.scene.radius[grain]
    product = {
        (a, b): np.bincount(grain, weight * normal[:, a] * normal[:, b], moment.n)
        for a, b in ((0, 0), (0, 1), (1, 1))
    }
    rows = [[product[0, 0], product[0, 1]], [product[0, 1], product[1, 1]]]
    return np.array(rows).transpose(2, 0, 1)
