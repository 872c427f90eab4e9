"""The order by colors: the program in C run in that order gives the same bits, and both orders agree."""

from ctypes import CDLL

import numpy as np
import pytest
from graphs import first_fit_colors
from optimality import solve_one_step
from simulate import Simulate
from swept_order import follow_reference, swept_pairs

from warpgrains import Scene, Simulation


@pytest.mark.parametrize("order", ["sequential", "color"])
def test_iteration_by_iteration(c_library: CDLL, simulate: Simulate, order: str) -> None:
    """Two steps of k = 1, 2, 3, ... iterations; the second one starts warm."""
    simulation = Simulation(Scene.load("polydisperse"))
    simulation.run(steps=max(20, simulate.of(60)))
    scene = simulation.scene.replace(position=simulation.position, velocity=simulation.velocity)
    for k in range(1, 41):
        cut = scene.replace(order=order, tolerance=0.0, max_iterations=k)
        follow_reference(cut, 2, c_library, simulate)


def test_pairs_are_swept_by_first_fit_colors() -> None:
    """Those of a new list, and those of a list that is used again."""
    simulation, rebuilds = Simulation(Scene.load("polydisperse"), order="color"), []
    for _ in range(200):
        rebuilds.append(simulation.step().rebuilds)
        swept = swept_pairs(simulation)
        listed = swept[np.lexsort(swept.T[::-1])]
        in_order = np.argsort(first_fit_colors(listed), kind="stable")
        assert np.array_equal(swept, listed[in_order])
    assert 30 < np.count_nonzero(rebuilds) < 170


@pytest.mark.parametrize("name", ["column", "no_inner_wall", "polydisperse"])
@pytest.mark.parametrize("steps", [40, 120])
def test_both_orders_agree(name: str, steps: int) -> None:
    simulation = Simulation(Scene.load(name))
    simulation.run(steps=steps)
    start = {"position": simulation.position, "velocity": simulation.velocity, "wall": "tangent"}
    scene = simulation.scene.replace(**start, tolerance=1e-8, max_iterations=1_000_000)
    one, other = (solve_one_step(scene.replace(order=order)) for order in ("sequential", "color"))
    for solved in (one, other):
        # A correction makes its own delta 0. Others, after it in the last iteration, are <= zeta, and each
        # changes that delta by at most its share, which is <= 1.
        assert np.abs(solved.delta).max() <= solved.others * scene.tolerance + solved.delta_rounding
    # With M (v - v*) + J^T lambda = M e and complementarity for b + delta,
    # |v1 - v2|^2 <= |lambda1 - lambda2|^T |delta1 - delta2| + |v1 - v2| |e1 - e2| in the norm of M.
    delta = np.abs(one.delta - other.delta) + one.delta_rounding + other.delta_rounding
    rounding = np.sqrt(2.0 * scene.mass.sum()) * (one.velocity_rounding + other.velocity_rounding)
    bound = np.sqrt(np.abs(one.impulse - other.impulse) @ delta) + rounding
    difference = np.sqrt(scene.mass @ ((one.velocity - other.velocity) ** 2).sum(axis=1))
    assert difference <= bound
