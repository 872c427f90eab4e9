"""Sources and sinks of a scene: when grains come and go, how many, and that interruptions change nothing."""

import pickle
from copy import copy

import numpy as np
import pytest
from command import exit_code
from same_bits import contents, run_of

from warpgrains import (
    Batch,
    Box,
    InputError,
    Recording,
    Scene,
    Segment,
    Simulation,
    SimulationError,
    Sink,
    Source,
    analysis,
)
from warpgrains.scene.reader import scene_document
from warpgrains.scene.state import first_state
from warpgrains.scene.toml import parameters_text, read_parameters
from warpgrains.simulation.checkpoint import read_checkpoint

SLOPES = [Segment((-0.7, 0.3), (-0.1, -0.1)), Segment((0.7, 0.3), (0.1, -0.1))]
TOP = {"region": {"x": (-0.3, 0.3), "y": (0.3, 0.7)}, "radius": (0.02, 0.03), "density": 80.0}
BELOW = {"y": (-1.0, -0.3)}
GRAIN = {"position": [(0.0, 0.2)], "radius": 0.02, "mass": 0.1}
ROUGH = {"friction": 0.3, "scheme": "leapfrog"}


def funnel(**changes):
    """Return a funnel that begins with one grain, and 60 that recirculate."""
    cycle = {"sources": [Source(count=60, name="top", **TOP)], "sinks": [Sink(region=BELOW, into="top")]}
    return Scene(**{**GRAIN, "radius_out": 1.0, "walls": SLOPES} | cycle | changes)


def periodic(**changes):
    """Return a box through which grains fall, from a source into two sinks, across a periodic side."""
    box = Box((0.0, 1.0), (0.0, 2.0), periodic="x")
    above = {"region": {"y": (1.5, 1.9)}, "radius": 0.03, "density": 10.0, "velocity": (2.0, 0.0)}
    sinks = [Sink(region={"x": (0.0, 0.5), "y": (0.0, 0.5)}), Sink(region={"x": (0.5, 1.0), "y": (0.0, 0.5)})]
    rain = {"sources": [Source(rate=200.0, seed=1, **above)], "sinks": sinks}
    return Scene(
        **{"position": [(0.5, 1.0)], "radius": 0.03, "mass": 0.1, "domain": box, "dt": 0.005} | rain | changes
    )


SCENES = {
    "funnel": funnel(),
    "rough": funnel(**ROUGH),
    "periodic": periodic(),
    "color": periodic(order="color"),
}


def flow(simulation):
    return [tuple(own) for own in (*simulation.inflow, *simulation.outflow)]


@pytest.mark.parametrize(
    ("how", "due"),
    [
        ({"count": 7}, {1: 7, 100: 7}),
        ({"rate": 10.0}, {1: 0, 10: 0, 11: 1, 20: 1, 21: 2, 91: 9, 100: 9}),
        ({"rate": 10.0, "count": 3}, {1: 3, 11: 4}),
        ({"rate": 10.0, "start_time": 0.42, "count": 2}, {45: 0, 46: 2, 51: 2, 61: 3}),
        ({"rate": 10.0, "start_time": 0.4, "end_time": 0.64}, {41: 0, 51: 1, 61: 2, 100: 2}),
        ({"rate": 10.0, "interval": 0.2}, {11: 0, 20: 0, 21: 2, 41: 4}),
        ({"rate": 100.0, "interval": 0.001}, {1: 0, 2: 1, 3: 2}),
    ],
)
def test_when_grains_are_due(how, due):
    """After a number of steps of 0.01 s, of which the last one begins with the exchange."""
    scene = Scene(**GRAIN, radius_out=1.0, sources=[Source(**TOP, **how)], gravity=(0.0, 0.0))
    for steps, count in due.items():
        simulation = run_of(scene, steps)
        assert simulation.inflow == [(count, count, 0, 0)], steps
        assert simulation.scene.n == 1 + count
        assert simulation.id.tolist() == [*range(1 + count)]
        later = Simulation(simulation.present_scene)  # what was due before is not due again
        later.step()
        assert later.inflow[0].entered <= 1


@pytest.mark.parametrize("which", SCENES)
def test_a_run_equals_removing_and_pouring_by_hand(which):
    scene = SCENES[which]
    every = round(0.05 / scene.dt)
    simulation = Simulation(scene)
    other = Simulation(scene.replace(sources=(), sinks=()))
    due, waiting = 0, 0
    for _ in range(12):
        for sink in scene.sinks:
            taken = other.id[sink.contains(scene.period.wrapped(other.position))]
            other.remove(taken[: other.scene.n - 1])
            waiting += len(taken) * (sink.into is not None)
        (source,) = scene.sources
        new, due = source.due(other.time) - due, source.due(other.time)
        how = {name: getattr(source, name) for name in ("radius", "density", "region", "velocity", "seed")}
        if count := new + waiting:
            waiting = min(waiting, count - len(other.pour(count, **how)))
        simulation.advance(every)
        other.advance(every)
        assert contents(simulation.position) == contents(other.position)
        assert contents(simulation.velocity) == contents(other.velocity)
        assert contents(simulation.id) == contents(other.id)
    assert simulation.scene.n > 20


@pytest.mark.parametrize("which", SCENES)
def test_what_went_in_came_out(which):
    """To the grain, and in mass to rounding."""
    simulation = Simulation(SCENES[which])
    entered, mass = 1, simulation.scene.mass.sum()
    for _ in range(60):
        known = simulation.id[-1]
        simulation.advance(round(0.05 / simulation.scene.dt))
        mass += simulation.scene.mass[simulation.id > known].sum()
        entered = 1 + sum(own.entered for own in simulation.inflow)
        taken = sum(own.grains for own in simulation.outflow)
        assert simulation.scene.n == entered - taken
        for due, came, missed, waiting in simulation.inflow:
            fed = taken if simulation.scene.sinks[0].into else 0
            assert due + fed == came + missed + waiting
    left = simulation.scene.mass.sum() + sum(own.mass for own in simulation.outflow)
    assert taken > 30
    assert left == pytest.approx(mass, rel=1e-13)  # sums of some hundred masses, each rounded by 1e-16
    series = analysis.quantities(simulation, ["flow"])
    assert [*series.values()] == [entered - 1, taken, sum(own.mass for own in simulation.outflow)]


@pytest.mark.parametrize("which", SCENES)
def test_steps_copies_and_threads_make_no_difference(which, tmp_path):
    scene, threads = SCENES[which], 2 if which == "color" else 1
    simulation, stepped = run_of(scene, 34), Simulation(scene, threads=threads)
    for _ in range(34):
        stepped.step()
    simulation.save(tmp_path / "saved.npz")
    others = [stepped, copy(simulation), pickle.loads(pickle.dumps(simulation))]
    others += [Simulation.load(tmp_path / "saved.npz", threads=threads)]
    others += [Simulation(simulation.scene, state=simulation.state())]
    simulation.advance(60)
    for other in others:
        for part in (5, 1, 30, 24):
            other.advance(part)
        assert contents(other.state()) == contents(simulation.state())
        assert flow(other) == flow(simulation)


def test_a_step_that_fails_and_is_repeated_exchanges_once():
    """Although the sink would take the grains that have just appeared."""
    pair = {"position": [(0.0, -0.5), (0.03, -0.5)], "radius": 0.02, "mass": 0.1, "radius_out": 1.0}
    flows = {"sources": [Source(count=40, **TOP)], "sinks": [Sink(region=TOP["region"])]}
    scene = Scene(**pair, **flows, max_iterations=1, tolerance=0.0, on_unconverged="raise")
    simulation = Simulation(scene, state=first_state(scene))
    for call in (simulation.step, lambda: simulation.advance(9)):
        with pytest.raises(SimulationError, match="not converged"):
            call()
        assert flow(simulation) == [(40, 40, 0, 0), (0, 0.0)]


@pytest.mark.parametrize("which", ["rough", "periodic"])
@pytest.mark.parametrize("steps", [40, 47])
def test_a_resumed_run_has_the_same_bits(which, steps, tmp_path, monkeypatch):
    """Also of its recording, whose scales are those of the start, and at a step with an exchange."""
    monkeypatch.chdir(tmp_path)
    how = {"forces": True, "color_by": "pressure", "draw_as": "discs"}
    whole, parts = Simulation(SCENES[which]), Simulation(SCENES[which])
    whole.run(steps=90, record="whole.usda", **how)
    parts.run(steps=steps, record="parts.usda", checkpoint="run.npz", every=10, **how)
    assert read_checkpoint(tmp_path / "run.npz").start.n == 1
    assert exit_code("run", "--resume", "run.npz", "--steps", 90) == 0
    assert contents(Simulation.load("run.npz").state()) == contents(whole.state())
    assert (tmp_path / "parts.usda").read_bytes() == (tmp_path / "whole.usda").read_bytes()
    assert len(Recording("parts.usda").frame(-1).id) == whole.scene.n


def test_what_finds_no_room_is_counted_and_what_sinks_feed_waits(capfd, tmp_path):
    narrow = {"region": {"x": (-0.05, 0.05), "y": (0.6, 0.7)}, "radius": 0.03, "density": 1.0}
    whole = {"region": {"y": (-1.0, 0.5)}, "into": "narrow"}
    scene = Scene(
        position=[(0.5, 0.6), *((0.2 * k, 0.0) for k in range(-3, 4))],
        radius=0.02,
        mass=0.1,
        radius_out=1.0,
        gravity=(0.0, 0.0),
        sources=[Source(count=5, name="narrow", **narrow)],
        sinks=[whole],
    )
    simulation = run_of(scene, 1)
    for _ in range(2):
        assert simulation.inflow == [(5, 1, 4, 7)]
        simulation.advance(5)
    simulation.remove(8)
    simulation.advance(5)
    assert simulation.inflow == [(5, 2, 4, 6)]
    assert simulation.id.tolist() == [0, 9]
    simulation = run_of(scene.replace(sinks=[Sink(region={"x": (-9.0, 9.0)})], sources=()), 20)
    assert simulation.id.tolist() == [7]  # the last grain stays
    assert simulation.outflow == [(7, pytest.approx(0.7, rel=1e-15))]
    table = parameters_text(scene.replace(duration=0.1))
    grains = f"[grains]\nposition = {scene.position.tolist()}\nradius = 0.02\nmass = 0.1\n"
    (tmp_path / "narrow.toml").write_text(table + grains)
    assert exit_code("run", tmp_path / "narrow.toml") == 0
    printed = capfd.readouterr().out
    assert "1 grain; 4 found no room, 7 wait for it" in printed
    assert "7 grains, 0.7 kg" in printed


def test_scene_files_and_recordings_have_the_same_sources(tmp_path):
    text = """
        [domain]
        radius_out = 1.0
        [grains]
        position = [[0.0, 0.2]]
        radius = 0.02
        mass = 0.1
        [[sources]]
        name = "top"
        region = {x = [-0.3, 0.3], y = [0.3, 0.7]}
        radius = {distribution = "lognormal", mean = 0.02, deviation = 0.005, largest = 0.04}
        density = 80
        rate = 10
        [[sinks]]
        region = {distance = [0.5, 1.0]}
        into = "top"
    """
    path = tmp_path / "mine.toml"
    path.write_text(text)
    scene = Scene.load(path, ["sources.0.rate=20", "sinks.0.interval=0.1"])
    lognormal = {"distribution": "lognormal", "mean": 0.02, "deviation": 0.005, "largest": 0.04}
    own = {"radius": lognormal, "name": "top"}
    expected = Source(**TOP | own, rate=20.0, start_time=0.0)
    assert scene.sources == (expected,)
    assert scene.sinks == (Sink(region={"distance": (0.5, 1.0)}, into="top", interval=0.1, start_time=0.0),)
    again = Scene(**GRAIN, **read_parameters(parameters_text(scene)))
    assert (again.sources, again.sinks) == (scene.sources, scene.sinks)
    assert exit_code("init", tmp_path / "other.toml", "--from", path) == 0
    assert scene_document((tmp_path / "other.toml").read_text(), path)[0]["sinks"][0]["into"] == "top"


def test_only_simulations_take_them():
    scene = funnel()
    with pytest.raises(InputError, match="the scene has sources or sinks, which only `run` and Simulation"):
        Batch([scene])
    with pytest.raises(InputError, match="inflow of the state is missing: the scene has sources"):
        Simulation(scene, state=first_state(scene.replace(sources=(), sinks=())))


def test_a_restored_start_pours_again():
    simulation = run_of(funnel(sinks=()), 20)
    n = simulation.scene.n
    simulation.restore(first_state(simulation.scene))
    simulation.advance(1)
    assert simulation.inflow[0].due == 60
    assert np.isin(simulation.id[:n], np.arange(n)).all()
