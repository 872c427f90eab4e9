"""`Simulation.change`: what continues, what is checked, and the same bits without another engine."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from same_bits import contents, run_of
from walled_scenes import BUMPS, LID, boxed

from warpgrains import Disc, InputError, Recording, Scene, Segment, Simulation, analysis
from warpgrains.simulation.changes import change_of

FLOOR = Segment((-0.9, -0.4), (0.9, -0.4), velocity=(0.05, 0.0))


def pile(**changes):
    """Return grains that have fallen on a floor when 60 steps are done."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(-4, 5) * 0.13, np.arange(-2, 4) * 0.13)
    fields = {
        "position": np.stack([x.ravel(), y.ravel()], axis=1) + rng.uniform(-0.005, 0.005, (54, 2)),
        "radius": rng.uniform(0.04, 0.06, 54),
        "mass": rng.uniform(0.1, 0.3, 54),
        "radius_out": 1.0,
        "walls": [FLOOR],
        "friction": 0.3,
        "dt": 5e-3,
        "tolerance": 1e-5,
        "drag": 0.1,
    }
    return Scene(**fields | changes)


CHANGES = {
    "gravity": ({"gravity": (1.0, -9.0)}, "euler", "sequential"),
    "turning": ({"gravity": {"angular_velocity": 1.0}}, "leapfrog", "color"),
    "friction": ({"friction": 0.1, "wall_friction": 0.5, "tolerance": 1e-4}, "leapfrog", "sequential"),
    "surface": ({"angular_velocity_out": 1.0, "on_unconverged": "raise"}, "euler", "color"),
    "drag": ({"drag": 3.0}, "leapfrog", "sequential"),
    "rough wall": ({"walls": lambda floor: [replace(floor, friction=0.9)]}, "leapfrog", "color"),
    "motion": ({"walls": lambda floor: [replace(floor, velocity=(0.0, 0.3))]}, "euler", "sequential"),
    "dt": ({"dt": 1e-3}, "leapfrog", "color"),
    "scheme": ({"dt": 0.01, "drag": 0.1, "scheme": "euler"}, "leapfrog", "sequential"),
    "a wall more": ({"walls": lambda floor: [floor, Disc((0.0, 0.8), 0.05)]}, "leapfrog", "sequential"),
}
ELSEWHERE = ("drag", "dt", "scheme", "a wall more")
"""Changes that need another engine."""


@pytest.mark.parametrize("which", CHANGES)
def test_a_change_continues_from_the_contacts_of_the_last_step(which, tmp_path):
    """Parameters are rewritten where they are. Copies, checkpoints, and another engine continue alike.

    But in color order the list of another engine has only the contacts that carry, if walls move otherwise.
    """
    fields, scheme, order = CHANGES[which]
    simulation = run_of(pile(scheme=scheme, order=order), 60)
    floor, *_ = simulation.present_scene.walls
    fields = {name: own(floor) if callable(own) else own for name, own in fields.items()}
    engine, state, told = simulation._engine, simulation.state(), shown(simulation)
    change = change_of(simulation.scene, fields, simulation.steps, simulation.position, simulation.driven)
    simulation.change(**fields)
    assert (simulation._engine is engine) == (which not in ELSEWHERE)
    assert len(simulation.contacts().pair) > 20
    simulation.save(tmp_path / "changed.npz")
    others = [copy(simulation), Simulation.load(tmp_path / "changed.npz")]
    for each in (simulation, *others):
        assert shown(each) == told
    if change.keeps_list or order == "sequential":
        others.append(Simulation(change.scene, state=change.state_after(state)))
    for other in others:
        assert contents(other.scene) == contents(simulation.scene)
    for _ in range(40):
        expected = contents(simulation.step())
        for other in others:
            assert contents(other.step()) == expected
            assert contents(other.position) == contents(simulation.position)
            assert contents(other.spin) == contents(simulation.spin)
    assert simulation.state().last_scene is None
    assert shown(simulation) != told


def shown(simulation):
    """Return all numbers of the contacts, and what analysis finds from them."""
    contacts = simulation.contacts(), simulation.wall_contacts()
    found = (*analysis.snapshot(simulation).loads, analysis.step_energy_balance(simulation))
    return [contents(part) for part in (*contacts, *found)]


def test_forces_at_walls_that_change_are_dropped(tmp_path):
    """Wall 0 is another one afterwards: it neither takes over the force, nor is drawn with it."""
    ground, stone = Disc((0.0, -1.0), 0.5), Disc((1.2, 0.0), 0.2)
    scene = Scene(position=[(0.0, -0.39)], radius=0.1, mass=1.0, radius_out=2.0, walls=[ground, stone])
    simulation = run_of(scene, 20)
    assert simulation.wall_contacts().wall.tolist() == [[0, 0]]
    simulation.change(walls=[stone])
    assert len(simulation.wall_contacts().wall) == 0
    simulation.run(steps=5, record=tmp_path / "run.usdc", forces=True)
    assert len(Recording(tmp_path / "run.usdc").frame(0).wall) == 0


def test_new_walls_are_checked_where_grains_are_now(tmp_path):
    """A place that a grain has left is free, and one that it has reached is not."""
    scene = Scene(position=[(0.0, 0.5)], radius=0.1, mass=1.0, radius_out=2.0, radius_in=0.05)
    simulation = run_of(scene, 20)
    (x, y), state = simulation.position[0].tolist(), contents(simulation.state())
    for fields, message in (
        ({"walls": [Disc((x, y), 0.2)]}, r"position of grain 0 .*inside walls\[0\]"),
        ({"radius_out": 0.9 * y}, "position of grain 0 .*outside the outer wall"),
        ({"radius_in": 1.1 * y}, "position of grain 0 .*inside the inner wall"),
    ):
        with pytest.raises(InputError, match=message):
            simulation.change(**fields)
        assert contents(simulation.state()) == state
    simulation.change(walls=[Disc((0.0, 0.5), 0.1)], radius_out=0.48)
    simulation.save(tmp_path / "state.npz")
    assert contents(Simulation.load(tmp_path / "state.npz").state()) == contents(simulation.state())
    simulation.step()


def test_driven_walls_are_put_where_a_change_says():
    """Those with the same ends continue; another radius is taken at once."""
    piston = Segment((0.9, 0.3), (-0.9, 0.3), force=2.0, mass=1.0)
    scene = Scene(
        position=[(0.0, -0.5)], radius=0.1, mass=1.0, radius_out=1.0, pressure=0.1, walls=[piston], dt=1e-3
    )
    simulation = run_of(scene, 200)
    before, engine = simulation.driven, simulation._engine
    assert before is not None
    assert before[0, 0] > 0.03
    simulation.change(walls=[replace(piston, force=1.0)], pressure=0.2)
    assert simulation._engine is engine
    assert np.array_equal(simulation.driven, before)
    simulation.step()
    assert 0.0 < before[1, 0] - simulation.present_scene.radius_out < 1e-3
    simulation.change(radius_out=1.2)
    (way, _), (radius, speed) = simulation.driven
    assert (radius, speed) == (1.2, 0.0)
    assert way > before[0, 0]
    simulation.advance(5)
    simulation.change(walls=[replace(piston, start=(0.9, 0.2), end=(-0.9, 0.2))])
    assert simulation.driven[1, 0] < 1.2
    assert (simulation.driven[0] == 0.0).all()
    simulation.advance(5)
    assert simulation.driven[0, 1] > 0.0
    with pytest.raises(InputError, match="no wall can be added or removed while a force drives one"):
        simulation.change(walls=[piston, piston])


def test_sides_of_a_box_go_on_but_for_those_that_change():
    """Another pressure drives the lid from where it is, and a belt has begun when it did."""
    lid = {"pressure": 2.0, "mass": 4.0}
    box = {"x": (0.0, 2.0), "y": (0.0, 1.0), "periodic": "x", "top": lid, "bottom": {"velocity": (0.3, 0.0)}}
    grain = {"position": [(0.5, 0.2)], "radius": 0.1, "mass": 1.0, "gravity": (0.0, 0.0), "dt": 1e-3}
    simulation = run_of(Scene(**grain, domain=box), 10)
    before, engine, (belt, _) = simulation.driven, simulation._engine, simulation.scene.walls
    simulation.change(domain=box | {"top": lid | {"pressure": 6.0}})
    assert simulation._engine is engine
    assert np.array_equal(simulation.driven, before)
    assert simulation.scene.walls[0] is belt
    simulation.advance(10)
    # each step of 1e-3 s adds p L / m dt to the speed of a lid that nothing touches
    assert simulation.driven[-1, 1] == pytest.approx(10 * 1e-3 + 10 * 3e-3, rel=1e-13)
    (_, lid_now), disc = simulation.present_scene.walls, Disc((0.5, 0.5), 0.1)
    assert simulation.present_scene.replace(walls=[disc]).walls[-1] == lid_now
    assert lid_now.point == (1.0, 1.0 - simulation.driven[-1, 0])
    still = run_of(Scene(**grain, domain=box | {"top": None}), 10)
    still.change(walls=[disc])
    still.change(domain=box | {"x": (0.0, 2.5), "top": None})
    assert still.scene.period.lengths.tolist() == [2.5, 0.0]
    assert still.scene.wall_names == ("Disc0", "bottom", "top")
    still.step()


def test_discs_of_a_moving_lid_go_on_when_its_pressure_or_its_velocity_changes():
    """They and their contacts stay where they are, and the velocity is that of the line and of its discs."""
    scene = boxed("rough lid", top=(lid := LID | {"roughness": BUMPS, "velocity": (0.5, 0.0)}))
    simulation = run_of(scene, 40)
    for change in ({"pressure": 60.0}, {"velocity": (0.25, 0.0)}):
        was, driven, now = simulation.present_scene.walls, simulation.driven, simulation.time
        lid |= change
        simulation.change(domain=replace(scene.domain, top=lid))
        assert np.array_equal(simulation.driven, driven)
        for wall, before in zip(simulation.present_scene.walls, was, strict=True):
            assert wall.at(now).point == pytest.approx(before.at(now).point, abs=1e-15)
            assert wall.velocity == (lid["velocity"] if wall.name == "top" else (0.0, 0.0))
        simulation.advance(5)


def test_spins_of_the_start_do_not_keep_friction_from_being_turned_off():
    simulation = run_of(pile(spin=1.0), 2)
    simulation.change(friction=0.0)
    assert not simulation.scene.spin.any()
    simulation.step()


def test_changes_are_listed_once():
    simulation = Simulation("annulus")
    for k in range(5):
        simulation.change(drag=0.1 * k)
    assert simulation.scene.text.endswith("\n# changed afterwards: drag")
    assert simulation.scene.text.count("changed afterwards") == 1
