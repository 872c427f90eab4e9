"""Fixtures that several tests of analysis share."""

import pytest

from warpgrains import Scene, Simulation


@pytest.fixture(scope="package")
def settled():
    """Return a pile of grains of several sizes, almost at rest."""
    simulation = Simulation(Scene.load("polydisperse"), method="accelerated", tolerance=1e-8)
    simulation.run(duration=3.0)
    return simulation
