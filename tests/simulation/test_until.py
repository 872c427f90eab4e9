"""Runs that end before their last step: at rest, or where a callable says so."""

import json

import numpy as np
import pytest
from command import exit_code
from same_bits import contents

from warpgrains import Scene, Segment, Simulation
from warpgrains.analysis import kinetic_energy
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.simulation.until import TEST_INTERVAL


def test_rest_is_where_a_twin_finds_it():
    """Step by step: the first look since which, at every look for the time, all was slow enough."""
    scene = Scene.load("annulus")
    simulation = Simulation(scene)
    summary = simulation.run(until="rest,speed=0.05,time=0.35", duration=20.0)
    assert summary.met
    twin, since = Simulation(scene), None
    while True:
        twin.run(steps=TEST_INTERVAL)
        calm = np.hypot(*twin.velocity.T).max() <= 0.05
        since = (twin.steps if since is None else since) if calm else None
        if since is not None and twin.steps - since >= 35:
            break
    assert summary.steps == simulation.steps == twin.steps < 800
    assert contents(simulation.state()) == contents(twin.state())


def test_by_default_nothing_moves_at_rest():
    simulation = Simulation(Scene.load("annulus"))
    assert simulation.run(until="rest", duration=20.0).met
    assert np.hypot(*simulation.velocity.T).max() <= 1e-3 * np.sqrt(9.81 * 0.2)


def floor(**motion):
    return {"walls": [Segment((-0.5, 0.0), (0.5, 0.0), **motion)]}


PISTON = Segment((-0.5, -0.5), (0.5, -0.5), force=-0.1, mass=1.0)
STIRRED = {
    "a gate that will open": (floor(velocity=(0.0, -0.5), start_time=3.0, end_time=3.5), 3.5),
    "a floor that creeps": (floor(velocity=(0.0, -4e-4)), np.inf),
    "a plate that will turn": (floor(angular_velocity=0.1, start_time=30.0), np.inf),
    "gravity that turns": ({"gravity": {"angular_velocity": 1e-5}}, np.inf),
    "a piston that falls": ({"walls": [*floor()["walls"], PISTON]}, np.inf),
    "nothing": (floor(), 0.0),
}


@pytest.mark.parametrize(("changes", "stirred_until"), STIRRED.values(), ids=STIRRED)
def test_nothing_rests_while_a_wall_will_move_or_gravity_turns(changes, stirred_until):
    """A grain on a wall at y = 0, or at the bottom of the circle."""
    fields = {"position": [(0.0, 0.1)], "radius": 0.1, "mass": 0.1, "radius_out": 2.0, "drag": 0.5}
    simulation = Simulation(Scene(**fields | changes))
    if np.isinf(stirred_until):
        with pytest.warns(UserWarning, match="rest was not reached within 4 s"):
            summary = simulation.run(until="rest", duration=4.0)
        assert (summary.met, summary.steps) == (False, 400)
    else:
        assert simulation.run(until="rest", duration=20.0).met
        assert simulation.time > stirred_until


def test_the_energy_bound_counts_rotation():
    """A disc that spins in free space loses m r^2 w^2 / 4 by its drag alone."""
    fields = {"radius": 0.1, "mass": 1.0, "radius_out": 2.0, "gravity": (0.0, 0.0), "friction": 0.5}
    scene = Scene(position=[(0.0, 0.5)], spin=10.0, spin_drag=0.01, **fields)
    simulation = Simulation(scene)
    assert kinetic_energy(simulation) == pytest.approx(0.25)
    assert simulation.run(until="rest,energy=1e-3,time=0.1", duration=20.0).met
    assert 0.0 < kinetic_energy(simulation) <= 1e-3


def test_a_callable_is_asked():
    simulation = Simulation(Scene.load("annulus"))
    summary = simulation.run(until=lambda other: other.position[:, 1].min() < -1.0)
    assert summary.met
    assert simulation.position[:, 1].min() < -1.0
    assert summary.steps % TEST_INTERVAL == 0
    twin = Simulation(Scene.load("annulus"))
    twin.run(steps=summary.steps - TEST_INTERVAL)
    assert twin.position[:, 1].min() >= -1.0


def test_a_resumed_run_ends_at_the_same_step(tmp_path, capfd, stop_at):
    whole, parts = tmp_path / "whole.npz", tmp_path / "parts.npz"
    options = ("--until", "rest,speed=0.05,time=1.0", "--duration", 20, "--json")
    assert exit_code("run", "annulus", "--checkpoint", whole, *options) == 0
    expected, kept = json.loads(capfd.readouterr().out), read_checkpoint(whole)
    assert expected["met"]
    assert kept.options.steps == 2000 > kept.statistics.steps == expected["steps"]
    assert 0.0 < kept.statistics.seconds < expected["seconds"]
    stop_at(expected["steps"] - 60)
    assert exit_code("run", "annulus", "--checkpoint", parts, "--every", 7, *options) == 130
    capfd.readouterr()
    assert exit_code("run", "--resume", parts, "--json") == 0
    resumed = json.loads(capfd.readouterr().out)
    assert {**resumed, "seconds": 0} == {**expected, "seconds": 0}
    assert contents(Simulation.load(parts).state()) == contents(Simulation.load(whole).state())
    assert exit_code("run", "--resume", parts, "--json") == 0  # it has ended
    assert json.loads(capfd.readouterr().out)["steps"] == expected["steps"]
    for more, every, steps, met in ((100, 7, 10, True), (15, 7, 15, False)):  # to the next test, or the end
        end = ("--steps", expected["steps"] + more, "--every", every, "--json")
        assert exit_code("run", "--resume", parts, *end) == 0
        longer = json.loads(capfd.readouterr().out)
        assert (longer["steps"], longer["met"]) == (expected["steps"] + steps, met)
