"""What a page plays, without the page."""

from pathlib import Path

import numpy as np
import pytest
from recordings import make_frames, record
from same_bits import contents

from warpgrains import Scene, Simulation
from warpgrains.grade.grader import Grader
from warpgrains.usd.recording import Recording
from warpgrains.view.homework import Homework
from warpgrains.view.players import AXES, ENERGY, FRAMES, PLACEHOLDER, ZETA, Live, Pace, Replay


@pytest.fixture
def simulation():
    return Simulation(Scene.load("annulus"))


@pytest.fixture
def plain():
    return Simulation(Scene.load("annulus"))


def test_stops_steps_and_looks_change_no_bit_and_numbers_are_those_of_the_step(simulation, plain):
    live = Live(simulation)
    before = live.readout()
    assert PLACEHOLDER in before.values()
    for steps in (1, 1, 30, 1, 7):
        live.change(drag=live.scene.drag)
        live.advance(steps)
        live.set_style("pressure", forces=True)
        assert live.painter.chains(live.snapshot()) is not None
        assert live.readout()["steps"] == str(live.steps)
        assert set(live.curves()) == set(AXES)
    plain.run(steps=39)
    report, told = plain.step(), live.readout()
    assert contents(simulation.state()) == contents(plain.state())
    assert list(told) == list(before)
    assert PLACEHOLDER not in told.values()
    assert told["iterations"] == f"{report.iterations}"
    assert told["zeta"] == f"{report.zeta:.2e} m/s"
    energy = 0.5 * (plain.scene.mass * (plain.velocity**2).sum(axis=1)).sum()
    assert told["kinetic energy"] == f"{energy:.4g} J"
    assert live.curves()[ENERGY][1]["energy"][-1] == pytest.approx(energy)
    iteration, curves = live.curves()[ZETA]
    assert iteration.tolist() == list(range(1, report.iterations + 1))
    assert curves["zeta"][-1] == np.log10(report.zeta)
    live.restart()
    assert live.readout() == before
    simulation.advance(40)
    assert np.array_equal(simulation.position, plain.position)
    assert np.array_equal(simulation.velocity, plain.velocity)


def test_grains_that_come_and_go_are_drawn(simulation):
    live = Live(simulation)
    live.set_style("radius", forces=True)
    simulation.add(position=[(0.0, 1.5)], radius=0.15, mass=0.1)
    for gone in ([], [3], [15]):
        simulation.remove(gone)
        live.advance(3)
        now = live.snapshot()
        assert live.painter.color(now).shape == (simulation.scene.n, 3)
        assert live.painter.look.color_by == "radius"
        assert live.painter.chains(now) is not None
    number = simulation.id.tolist()
    live.restart()
    assert (live.steps, simulation.id.tolist()) == (0, number)
    assert simulation.add(position=[(0.0, 1.5)], radius=0.1, mass=0.1).tolist() == [16]


def test_a_step_that_fails_ends_it_and_is_told():
    live = Live(Simulation(Scene.load("annulus"), max_iterations=1, on_unconverged="raise"))
    live.advance(100)
    assert live.has_ended
    assert "converged" in live.readout()["error"]
    live.restart()
    assert not live.has_ended


RIGHT = (Path(__file__).parents[1] / "grade" / "right" / "plain.c").read_text()


@pytest.fixture(scope="module")
def grader(tmp_path_factory):
    return Grader(tmp_path_factory.mktemp("grader"))


@pytest.fixture
def play(tmp_path, grader):
    players = []

    def played(*change):
        source = tmp_path / f"homework{len(players)}.c"
        source.write_text(RIGHT.replace(*change) if change else RIGHT)
        players.append(Homework(Scene.load("annulus"), lambda: grader.run(source), "homework"))
        return players[-1]

    yield played
    for player in players:
        player.close()


def test_a_right_homework_differs_nowhere(play, simulation):
    player = play()
    while player.readout()["step"] != "22":  # of which the last two have many contacts
        player.advance(1)
        assert player.readout()["largest difference of v"] == "none"
        assert len(np.unique(player.painter.color(player.snapshot()), axis=0)) == 1
    assert simulation.advance(21).iterations_max >= 20
    assert np.array_equal(player.snapshot().position, simulation.position)
    assert player.snapshot().time == pytest.approx(simulation.time)
    assert set(player.curves()) <= set(AXES)


def test_a_wrong_homework_is_colored_where_it_differs(play):
    player = play("- vx[j] * nx - vy[j] * ny", "+ vx[j] * nx + vy[j] * ny")
    while player.readout()["largest difference of v"] == "none":
        player.advance(1)
    assert player.readout()["stage"] == "iteration 1"
    worst = int(player.readout()["largest difference of v"].split()[-1])
    color = player.painter.color(player.snapshot())
    assert color[:, 1].argmin() == worst
    assert len(np.unique(color, axis=0)) > 1


def test_a_homework_that_ends_is_told_and_restarts(play):
    player = play("double zeta = 0.0;", "double zeta = 0.0; if (iter == 1) getchar();")
    player.advance(50)
    assert player.has_ended
    assert "it reads the keyboard" in player.readout()["error"]
    player.restart()
    assert (player.has_ended, player.steps) == (False, 0)
    player.advance(1)
    assert player.readout()["stage"] == "velocities by Newton's law"


SPEEDS = (0.1, 0.5, 1.0, 1.3, 10.0)


@pytest.mark.parametrize("dt", [1 / 24, 1 / 30, 1 / 60, 0.3, 0.01, 0.005, 1e-4])
def test_playback_never_is_a_step_away_from_its_speed(dt):
    for speed in SPEEDS:
        paced, played = Pace(dt), 0
        for frame in range(1, 301):
            played += paced.due(speed)
            owed = speed * frame / FRAMES / dt - played
            assert -1e-6 <= owed < 1.0  # steps; rounding of the sum of 300 is 300 eps of the sum


def test_frames_keep_their_rate_and_do_not_hurry_after_a_slow_one(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("warpgrains.view.players.perf_counter", lambda: now[0])
    monkeypatch.setattr("warpgrains.view.players.sleep", lambda seconds: now.__setitem__(0, now[0] + seconds))
    paced, at = Pace(0.01), []
    for work in [0.02] * 10 + [0.2] + [0.001] * 10:
        now[0] += work
        paced.wait()
        at.append(now[0] * FRAMES)
    late = 0.2 * FRAMES
    assert at == pytest.approx([*range(1, 11), *(10 + late + k for k in range(11))])


def test_recording_ends_with_its_last_frame(tmp_path):
    frames = make_frames(4)
    played = Replay(Recording(record(tmp_path / "run.usdc", frames, forces=True)))
    played.advance(2)
    assert np.allclose(played.snapshot().position, frames[2, 0], atol=1e-6)  # float32
    played.advance(7)
    assert (played.steps, played.has_ended) == (3, True)
    played.set_style("speed", forces=False)
    assert played.painter.chains(played.snapshot()) is None
    played.restart()
    assert played.readout() == {"time": "0 s", "frame": "0 of 3", "contacts": "5"}


def test_friction_is_switched_on_and_off(simulation, plain):
    live = Live(simulation)
    live.advance(50)
    live.set_friction(2.0, -1.0, 0.5, 0.1)
    scene = simulation.scene
    assert (scene.friction, scene.angular_velocity_out, scene.angular_velocity_in) == (0.5, 2.0, -1.0)
    live.set_style("mobilized", forces=True)
    live.advance(50)
    plain.advance(50)
    plain.change(friction=0.5, rolling_friction=0.1, angular_velocity_out=2.0, angular_velocity_in=-1.0)
    plain.advance(50)
    assert contents(simulation.state()) == contents(plain.state())
    assert np.array_equal(live.snapshot().angle, plain.angle)
    energy = 0.5 * plain.scene.mass * ((plain.velocity**2).sum(axis=1) + (0.1 * plain.spin) ** 2 / 2.0)
    assert live.readout()["kinetic energy"] == f"{energy.sum():.4g} J"
    assert live.readout()["rotation of the walls"] == "2, -1 rad/s"
    live.set_friction(2.0, -1.0, 0.0, 0.1)
    assert simulation.scene.angular_velocity_out == simulation.scene.rolling_friction == 0.0
    assert live.colorings == ("palette", "bands", "radius", "id", "height", "speed", "pressure", "force")
    live.set_style("speed", forces=False)
    assert not live.snapshot().scene.has_friction


def test_friction_that_the_scene_has_is_kept():
    scene = Scene.load("annulus").replace(friction=0.3, wall_friction=0.2, spin=4.0, spin_drag=1e-4)
    live = Live(Simulation(scene))
    live.set_friction(1.0, 0.0, 0.0)  # walls have their own
    assert (live.scene.at_walls["friction"][0], live.scene.angular_velocity_out) == (0.2, 1.0)
    assert (live.scene.spin == 4.0).all()
    live = Live(Simulation(scene.replace(wall_friction=None, method="exact", exact_budget=50.0)))
    live.set_friction(1.0, 0.0, 0.0)
    assert not live.scene.has_friction
    live.set_friction(1.0, 0.0, 0.4)
    live.restart()
    assert (live.scene.spin_drag, live.scene.angular_velocity_out) == (1e-4, 1.0)
    assert (live.snapshot().angle == 0.0).all()
    live.advance(1)
    assert live.snapshot().angle == pytest.approx(0.01 * 4.0, rel=0.1)


def test_restitution_is_switched_on_and_off():
    scene = Scene.load("annulus").replace(restitution=0.5, restitution_speed=0.1)
    live, plain = Live(Simulation(scene)), Simulation(scene)
    for e, least in ((0.0, 0.0), (0.8, 0.1)):
        live.set_restitution(e)
        assert (live.scene.restitution, live.scene.restitution_speed) == (e, least)
        live.advance(20)
        plain.change(restitution=e, restitution_speed=least)
        plain.advance(20)
    assert np.array_equal(live.snapshot().position, plain.position)
