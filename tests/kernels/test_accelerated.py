"""The residual against a twin that looks at all pairs, and the accelerated method against it."""

import numpy as np
import pytest
from residual_twin import free_velocity, twin_residual
from schemes import SCHEMES

from warpgrains import Scene, Simulation


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated"])
@pytest.mark.parametrize("name", ["annulus", "polydisperse", "no_inner_wall"])
def test_residual_is_that_of_all_pairs(name: str, method: str, scheme: dict[str, str]) -> None:
    simulation = Simulation(Scene.load(name), method=method, max_iterations=30, **scheme)
    # Corrections and gap rates of up to `size` m/s are added up in another order, a few dozen at a grain.
    for _ in range(60):
        free = free_velocity(simulation)
        report = simulation.step()
        twin = twin_residual(simulation, free)
        size = np.abs(free).max() + simulation.scene.radius_out / simulation.scene.dt
        assert abs(report.residual - twin) <= 100 * np.finfo(float).eps * size
        assert report.converged == (
            (report.residual if method == "accelerated" else report.zeta) <= simulation.scene.tolerance
        )


def test_long_solves_do_not_drift() -> None:
    """Sweeps past convergence only gather rounding errors, which rebuilt velocities take away."""
    scene = Scene.load("column").replace(
        method="accelerated", order="color", tolerance=0.0, max_iterations=20_000
    )
    simulation = Simulation(scene)
    # Each of the 100 sweeps between two rebuilds rounds a velocity up to five times (contacts, momentum,
    # the rebuilding itself), and momentum may repeat each of these errors in the sweeps that are left.
    repeated = 5 * 100 * 100 * np.finfo(float).eps
    for _ in range(3):
        size = np.abs(free_velocity(simulation)).max() + scene.dt * np.hypot(*scene.gravity)
        assert simulation.step().residual <= repeated * size
