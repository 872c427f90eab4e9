"""Grains that overlap at the start: moved apart without speeds, and said where they are not."""

import re
import warnings

import numpy as np
import pytest
from command import exit_code
from walled_scenes import DRIVEN, OF_ALL_LAWS, ROUGH, STILL, boxed, pressed, stirred

import warpgrains as wg
from warpgrains import Scene, SimulationError, analysis
from warpgrains.scene.fields import FIELDS
from warpgrains.space.geometry import overlapping_pairs

NEAR = 0.05  # gap of neighbors, in sums of their radii

KICKED = {"position": [[0.5, 0.0], [0.69, 0.0]], "radius": 0.1, "mass": 0.1, "radius_out": 2.0}


@pytest.mark.parametrize("dt", [1e-2, 1e-5])
def test_an_overlap_gives_no_speed(dt):
    scene = Scene(**KICKED, gravity=(0.0, 0.0), dt=dt)
    with pytest.warns(UserWarning, match=re.escape(f"into {0.01 / dt:.1e} m/s: warpgrains.separate")):
        kicked = wg.Simulation(scene)
    kicked.advance(3)
    assert abs(kicked.velocity).max() == pytest.approx(0.005 / dt)
    separation = wg.separate(scene)
    assert separation.shift == pytest.approx(0.005)
    assert separation.overlap <= max(1e-6 * dt, 1e-10)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation = wg.Simulation(separation.scene)
    simulation.advance(3)
    assert abs(simulation.velocity).max() <= separation.overlap / dt


def neighbors(scene):
    """Return the pairs that touch, or nearly."""
    found = overlapping_pairs(scene.position, (1.0 + NEAR) * scene.radius)
    return {pair for i, j in found for pair in zip(i.tolist(), j.tolist(), strict=True)}


def test_a_packing_keeps_its_neighbors_and_rests():
    """Its grains overlap by 1 % of their diameters, five times what soft-sphere programs leave."""
    rest = wg.pack("polydisperse").simulation.scene
    grown = rest.replace(radius=1.01 * rest.radius, radius_out=1.01 * rest.radius_out)
    separation = wg.separate(grown)
    before, after = (neighbors(of) for of in (rest, separation.scene))
    assert len(before & after) >= 0.97 * len(before)
    simulation = wg.Simulation(separation.scene)
    assert simulation.run(until="rest", duration=30.0).met
    top = separation.scene.position[:, 1].max()
    assert simulation.position[:, 1].max() < top + rest.radius.max()
    weight = 9.81 * rest.mass.sum()
    simulation.step()
    assert analysis.contact_forces(simulation)[:, 1].sum() == pytest.approx(weight, rel=0.01)


SCENES = {
    "pressure": pressed(40, walls=(DRIVEN, STILL), **ROUGH, spinning=3.0),
    "walls in motion": stirred(40, **OF_ALL_LAWS, spinning=3.0),
    "lid": boxed("rough lid", 40),
    "restitution": boxed("bouncing", 40),
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_only_positions_change(scene):
    """Walls that move, or that forces drive, do neither; grains that overlap them move."""
    assert scene.count_overlaps().largest > 0.01
    found = wg.separate(scene).scene
    assert found.count_overlaps().largest <= 1e-8
    for name in FIELDS:
        assert np.array_equal(getattr(found, name), getattr(scene, name)) == (name != "position"), name


def test_grains_that_cannot_be_moved_apart_are_named():
    jammed = Scene(position=[[0.0, -0.5], [0.0, 0.5]], radius=0.6, mass=1.0, radius_out=1.0)
    with pytest.raises(SimulationError, match="grains 0, 1 cannot be moved apart"):
        wg.separate(jammed)


def test_the_command_separates(tmp_path, capsys):
    (tmp_path / "grains.csv").write_text("x,y,radius,mass\n0.5,0,0.1,0.1\n0.69,0,0.1,0.1\n")
    scene = tmp_path / "scene.toml"
    scene.write_text('[domain]\nradius_out = 2.0\n[grains]\nfile = "grains.csv"\n')
    assert exit_code("run", scene, "--steps", 3) == 0
    printed = capsys.readouterr()
    assert "warning: grains overlap by up to 1.0e-02 m" in printed.err
    assert "1 between grains, 0 with a wall, up to 1.00e-02 m" in printed.out
    assert exit_code("run", scene, "--steps", 3, "--separate") == 0
    printed = capsys.readouterr()
    assert "separated the grains: largest shift 5.00e-03 m" in printed.err
    assert "warning" not in printed.err
    assert "0 between grains, 0 with a wall\n" in printed.out
