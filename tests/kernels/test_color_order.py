"""The order by colors: the program in C run in that order gives the same bits, and both orders agree."""

from ctypes import CDLL

import numpy as np
import pytest
from graphs import first_fit_colors
from simulate import Simulate
from swept_order import follow_reference, swept_pairs

from warpgrains import Scene, Simulation
from warpgrains.accuracy import certify
from warpgrains.scene.fields import ORDERS


@pytest.mark.parametrize("order", ORDERS)
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
    """To what an independent solver proves of either."""
    start, tight = Simulation(name, wall="tangent"), {"tolerance": 1e-8, "max_iterations": 1_000_000}
    start.advance(steps)
    velocities, bounds = [], []
    for order in ORDERS:
        simulation = Simulation(start.scene, order=order, state=start.state(), **tight)
        assert simulation.step().converged
        velocities.append(simulation.velocity)
        bounds.append(certify(simulation).at_most)
    assert np.abs(velocities[0] - velocities[1]).max() <= sum(bounds) < 1e-4
