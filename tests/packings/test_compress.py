"""Jammed packings: what `compress` returns, by Python and by the command."""

import json

import numpy as np
import pytest
from command import exit_code
from walled_scenes import filled

import warpgrains as wg
from warpgrains import Scene, analysis

FEW = ["grains.count=60", "solver.tolerance=1e-7"]


@pytest.fixture(scope="module")
def packing():
    return wg.compress(Scene.load("jamming", FEW))


def test_a_packing_carries_the_pressure(packing):
    assert packing.at_rest
    assert packing.run.unconverged == 0
    assert packing.pressure == pytest.approx(1.0, rel=1e-3)
    assert packing.contacts == pytest.approx(4.0, abs=0.1)
    scene = packing.simulation.present_scene
    assert packing.radius == scene.radius_out
    assert packing.fraction == pytest.approx(np.pi * (scene.radius**2).sum() / scene.area)
    assert 0.7 < packing.fraction < 0.85
    gap = scene.side(0, packing.simulation.position, scene.radius).gap
    assert gap.min() == pytest.approx(0.0, abs=1e-6)
    force = analysis.contact_forces(packing.simulation)
    assert np.abs(force).max() < 1e-2 * packing.mean_force


ROUGH = {"roughness": {"radius": 0.02, "spacing": 0.05}}


@pytest.mark.parametrize(("friction", "contacts", "rough"), [(0.0, (3.9, 4.1), ROUGH), (0.5, (2.5, 3.9), {})])
def test_a_lid_presses_grains_beyond_periodic_sides(friction, contacts, rough):
    """With friction, fewer contacts carry the pressure."""
    lid = {"pressure": 2.0, "mass": 2.0, **rough}
    packing = wg.compress(filled(top=lid, friction=friction, max_iterations=2000), pressure=1.0)
    assert packing.at_rest
    assert packing.pressure == pytest.approx(1.0, rel=1e-3)
    assert contacts[0] < packing.contacts < contacts[1]
    walls, simulation = packing.simulation.wall_contacts(), packing.simulation
    assert walls.force[walls.wall[:, 1] == 0].sum() == pytest.approx(0.5, rel=1e-2)  # on the bottom, too
    assert packing.lengths == pytest.approx((0.5, 0.6 - simulation.driven[:, 0].max()))
    assert packing.results()["radius"] is None
    space = np.prod(packing.lengths) - bool(rough) * 5.0 * np.pi * 0.02**2  # without ten half discs
    assert packing.fraction == pytest.approx(np.pi * (simulation.scene.radius**2).sum() / space)
    assert 0.7 < packing.fraction < 0.86
    assert packing.summary()["box"].startswith("0.5 m by 0.")


def test_the_command_prints_the_same(packing, tmp_path, capfd):
    options = [word for override in FEW for word in ("--set", override)]
    assert exit_code("compress", "jamming", "--json", "-o", str(tmp_path / "jammed.npz"), *options) == 0
    printed = json.loads(capfd.readouterr().out)
    assert printed["radius"] == packing.radius
    assert printed["contacts"] == packing.contacts
    assert printed["at_rest"] is True
    assert printed["bulk_fraction"] is None  # there is too little away from the wall
    again = wg.Simulation.load(tmp_path / "jammed.npz")
    assert np.array_equal(again.position, packing.simulation.position)
    assert again.step().converged


def test_a_run_that_is_too_short_says_so(capfd):
    assert exit_code("compress", "jamming", "--pressure", "2", "--duration", "0.1", "--set", FEW[0]) == 0
    printed = capfd.readouterr().out
    assert "steps             5, not at rest" in printed
    assert "N/m of contacts, 2 N/m given" in printed
    assert "contacts          0.000 a grain, without 60 rattlers" in printed
