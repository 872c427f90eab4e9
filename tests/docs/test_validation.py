"""The validation of friction and walls: quick numbers, smaller experiments, and how they measure."""

from dataclasses import replace

import bouncing
import closed_forms
import collapse
import numpy as np
import pytest
import shear
import silos
import slopes
import steps
import validation

from warpgrains import Scene, Simulation
from warpgrains.analysis import snapshot


def test_closed_forms_are_met(tmp_path):
    picture = tmp_path / "closed_forms.png"
    found = validation.main(["-o", str(tmp_path), "closed_forms"])["closed_forms"]
    assert picture.stat().st_size > 10_000
    for mu in ("0.05", "0.3", "2"):
        assert found[f"slide to roll, mu {mu}: error [m/s]"] <= 1e-5
    assert found["impact: worst error of the impulse ratio"] <= 3e-7
    assert found["slope: worst error of the acceleration [m/s2]"] <= 1e-5
    assert found["pendulum: relative error of the period at dt 0.01 s"] <= 4e-5
    assert found["pendulum: order in dt"] == pytest.approx(2.0, abs=0.1)
    assert found["three discs, mu 0.265: fallen in 1 s [m]"] > 1e-3
    assert abs(found["three discs, mu 0.27: fallen in 1 s [m]"]) < 1e-4


def test_pressure_of_a_gas():
    found = bouncing.equilibrium(bouncing.warm(0.4, 5.0, side=20), 0.004)
    # 400 discs meet 1,600 times, which scatters the part of collisions by 3 %
    assert found.pressure == pytest.approx(bouncing.henderson(0.4), rel=0.05)
    assert 0.0 <= found.lost < 0.05
    assert found.velocity.var() == pytest.approx(1.0, rel=0.01)


def test_friction_of_a_heap_on_a_flat_floor():
    assert closed_forms.heap_friction(0.0) == pytest.approx(np.tan(np.radians(15.0)), rel=1e-12)


@pytest.mark.parametrize("angle", [-10.0, 0.0, 25.0])
def test_slope_of_a_surface(angle):
    along = np.arange(-0.8, 0.81, 0.04)
    slope = np.radians(angle)
    position = along[:, np.newaxis] * [np.cos(slope), np.sin(slope)] + [0.0, -0.1]
    scene = Scene(position=position, radius=0.02, mass=1.0, radius_out=1.0)
    i = np.arange(len(along) - 1, dtype=np.int32)
    pair = np.stack([i, i + 1], axis=1)
    chain = replace(
        snapshot(Simulation(scene)), pair=pair, force=np.ones(len(i)), tangential_force=np.ones(len(i))
    )
    # the highest grain of a slice is within one spacing of its end
    assert validation.surface_angle(chain) == pytest.approx(angle, abs=1.5)


def test_starts_are_within_the_bound_of_coulomb():
    scene = steps.falling(0.8, seed=0)
    simulation = Simulation(scene)
    simulation.advance(60)
    state, rng = simulation.state(), np.random.default_rng(0)
    start = steps.other_start(state.corrections, 0.8, rng)
    assert (np.abs(start.pair_friction) <= 0.8 * start.pair_correction).all()
    assert start.pair_correction.any()
    found = steps.solved(scene, state, rng)
    assert found.shape == (steps.STARTS, 3 * scene.n)


def test_short_steps_are_found_and_solved_again():
    scene = steps.falling(0.5, seed=0).replace(tolerance=1e-9, max_iterations=2)
    count, states = steps.short_steps(scene, 60)
    assert count > steps.KEPT == len(states)
    assert [state.steps for state in states] == sorted({state.steps for state in states})
    few, many = steps.residuals(scene, states[-1], "gauss-seidel")[[0, -1]]
    assert many < few


@pytest.mark.parametrize("friction", [0.1, 0.6], ids=["slides", "rolls"])
def test_discs_on_slopes_follow_closed_forms(friction):
    for tangent in (0.25, 1.0, 1.7):
        exact = 0.125 * closed_forms.acceleration_on_a_slope(tangent, friction)
        assert slopes.way_on_a_slope(tangent, friction) == pytest.approx(exact, rel=1e-9)
    exact = slopes.exact_way_when_tilted(friction)
    errors = [abs(slopes.way_when_tilted(friction, dt) - exact) for dt in (0.02, 0.01)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


@pytest.mark.slow
def test_a_silo_that_is_refilled_flows_at_a_constant_rate():
    time, left, count = silos.departures(silos.hopper_silo(10.0, count=1000), end=5.0)
    mean, error = silos.rate(time, left, blocks=6)
    assert 300 < mean < 450  # 388 by the fit of the page
    assert error < 0.05 * mean
    assert count == 1000


@pytest.mark.slow
def test_a_column_runs_out():
    found = collapse.collapsed(1.0, count=500)  # 0.90 to 0.99 of the law with five seeds
    assert found.run_out == pytest.approx(collapse.law(np.array(found.aspect)), rel=0.2)


@pytest.mark.slow
def test_side_walls_carry_a_filling():
    smooth, rough = silos.piston_silo(2.0, 0, 0.0, max_iterations=1000), silos.piston_silo(2.0, 0)
    assert silos.load(smooth) == pytest.approx(smooth.mass.sum(), rel=0.01)
    assert 0.45 < silos.load(rough) / rough.mass.sum() < 0.7


@pytest.mark.slow
def test_discs_flow_under_a_rough_lid():
    friction, number, fraction = shear.measured(0.3).mean(axis=0)
    assert 0.15 < number < 0.25
    assert friction == pytest.approx(0.259 + 0.97 * number, abs=0.05)  # the lines of the page
    assert fraction == pytest.approx(0.821 - 0.38 * number, abs=0.02)
