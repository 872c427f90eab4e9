"""Simulations that several tests of analysis share."""

import pytest
from moments import frictional

from warpgrains import Scene, Simulation


@pytest.fixture(scope="package")
def settled():
    """Return a pile of grains of several sizes, almost at rest."""
    simulation = Simulation(Scene.load("polydisperse"), method="accelerated", tolerance=1e-8)
    simulation.run(duration=3.0)
    return simulation


@pytest.fixture(scope="package")
def rolling():
    """Return grains with friction that still move, between walls that rotate."""
    simulation = Simulation(frictional())
    simulation.advance(60)
    return simulation
