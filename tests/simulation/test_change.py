"""`Simulation.change`: what goes on, what is checked, and the same bits without another engine."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from same_bits import contents
from walled_scenes import BUMPS, LID, boxed

from warpgrains import Disc, InputError, Scene, Segment, Simulation
from warpgrains.simulation.changes import change_of

FLOOR = Segment((-0.9, -0.4), (0.9, -0.4), velocity=(0.05, 0.0))


def pile(**changes: Any) -> Scene:
    """Return grains that have fallen on a floor when 60 steps are done."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(-4, 5) * 0.13, np.arange(-2, 4) * 0.13)
    fields: dict[str, Any] = {
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


@pytest.mark.parametrize(("scheme", "order"), [("text", "sequential"), ("leapfrog", "color")])
@pytest.mark.parametrize(
    "fields",
    [
        {"gravity": (1.0, -9.0)},
        {"gravity": {"rotate": 1.0}},
        {"friction": 0.1, "wall_friction": 0.5, "tolerance": 1e-4},
        {"angular_velocity_out": 1.0, "on_unconverged": "raise"},
        {"walls": lambda now: [replace(now.walls[0], friction=0.9)]},
        {"walls": lambda now: [replace(now.walls[0], velocity=(0.0, 0.3), angular_velocity=0.1)]},
    ],
    ids=["gravity", "turning", "friction", "surface", "wall friction", "motion"],
)
def test_a_change_in_place_has_the_bits_of_another_engine(
    fields: dict[str, Any], scheme: str, order: str, tmp_path: Path
) -> None:
    """Parameters are rewritten where they are. What a checkpoint restores, and another engine, go on alike.

    But in color order the list of another engine has only the contacts that carry, if walls move otherwise.
    """
    simulation = Simulation(pile(scheme=scheme, order=order))
    simulation.advance(60)
    fields = {name: own(simulation.present_scene) if callable(own) else own for name, own in fields.items()}
    engine, state = simulation._engine, simulation.state()
    change = change_of(simulation.scene, fields, simulation.steps, simulation.position, simulation.driven)
    simulation.change(**fields)
    assert simulation._engine is engine
    assert len(simulation.contacts().pair) > 20
    simulation.save(tmp_path / "changed.npz")
    others = [Simulation.load(tmp_path / "changed.npz")]
    if change.keeps_list or order == "sequential":
        others.append(Simulation(change.scene, state=change.state_after(state)))
    for other in others:
        assert contents(other.scene) == contents(simulation.scene)
    for _ in range(40):
        expected = contents(simulation.step())
        for other in others:
            assert contents(other.step()) == expected
            assert np.array_equal(other.position, simulation.position)
            assert np.array_equal(other.spin, simulation.spin)


def test_new_walls_are_checked_where_grains_are_now() -> None:
    """A place that a grain has left is free, and one that it has reached is not."""
    scene = Scene(position=[(0.0, 0.5)], radius=0.1, mass=1.0, radius_out=2.0, radius_in=0.05)
    simulation = Simulation(scene)
    simulation.advance(20)
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
    simulation.step()


def test_a_scene_with_a_wall_over_its_first_grains_is_kept_in_copies(tmp_path: Path) -> None:
    simulation = Simulation(Scene(position=[(0.0, 0.5)], radius=0.1, mass=1.0, radius_out=2.0))
    simulation.advance(40)
    simulation.change(walls=[Disc((0.0, 0.5), 0.2)])
    simulation.save(tmp_path / "state.npz")
    assert contents(Simulation.load(tmp_path / "state.npz").state()) == contents(simulation.state())


def test_driven_walls_are_put_where_a_change_says() -> None:
    """Those with the same ends continue, also with another force; another radius is taken at once."""
    piston = Segment((0.9, 0.3), (-0.9, 0.3), force=2.0, mass=1.0)
    scene = Scene(
        position=[(0.0, -0.5)], radius=0.1, mass=1.0, radius_out=1.0, pressure=0.1, walls=[piston], dt=1e-3
    )
    simulation = Simulation(scene)
    simulation.advance(200)
    before, engine = simulation.driven, simulation._engine
    assert before is not None
    assert before[1, 0] > 0.03
    simulation.change(walls=[replace(piston, force=1.0)], pressure=0.2)
    assert simulation._engine is engine
    assert np.array_equal(simulation.driven, before)
    simulation.step()
    assert 0.0 < before[0, 0] - simulation.present_scene.radius_out < 1e-3
    simulation.change(radius_out=1.2)
    (radius, speed), (way, _) = simulation.driven
    assert (radius, speed) == (1.2, 0.0)
    assert way > before[1, 0]
    simulation.advance(5)
    simulation.change(walls=[replace(piston, start=(0.9, 0.2), end=(-0.9, 0.2))])
    assert simulation.driven[0, 0] < 1.2
    assert (simulation.driven[1] == 0.0).all()
    simulation.advance(5)
    assert simulation.driven[1, 1] > 0.0
    with pytest.raises(InputError, match="no wall can be added or removed while a force drives one"):
        simulation.change(walls=[piston, piston])


def test_sides_of_a_box_go_on_but_for_those_that_change() -> None:
    """Another pressure drives the lid from where it is, and a belt has begun when it did."""
    lid = {"pressure": 2.0, "mass": 4.0}
    box = {"x": (0.0, 2.0), "y": (0.0, 1.0), "periodic": "x", "top": lid, "bottom": {"velocity": (0.3, 0.0)}}
    grain = {"position": [(0.5, 0.2)], "radius": 0.1, "mass": 1.0, "gravity": (0.0, 0.0), "dt": 1e-3}
    simulation = Simulation(Scene(**grain, domain=box))
    simulation.advance(10)
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
    still = Simulation(Scene(**grain, domain=box | {"top": None}))
    still.advance(10)
    still.change(walls=[disc])
    still.change(domain=box | {"x": (0.0, 2.5), "top": None})
    assert still.scene.period.tolist() == [2.5, 0.0]
    assert still.scene.wall_names[2:] == ("Disc0", "bottom", "top")
    still.step()


def test_discs_of_a_moving_lid_go_on_when_its_pressure_or_its_velocity_changes() -> None:
    """They and their contacts stay where they are, and the velocity is that of the line and of its discs."""
    scene = boxed("rough lid", top=(lid := LID | {"roughness": BUMPS, "velocity": (0.5, 0.0)}))
    simulation = Simulation(scene)
    simulation.advance(40)
    for change in ({"pressure": 60.0}, {"velocity": (0.25, 0.0)}):
        was, driven, now = simulation.present_scene.walls, simulation.driven, simulation.time
        lid |= change
        simulation.change(domain=replace(scene.domain, top=lid))
        assert np.array_equal(simulation.driven, driven)
        for wall, before in zip(simulation.present_scene.walls, was, strict=True):
            assert wall.at(now).point == pytest.approx(before.at(now).point, abs=1e-15)
            assert wall.velocity == (lid["velocity"] if wall.name == "top" else (0.0, 0.0))
        simulation.advance(5)


def test_spins_of_the_start_do_not_keep_friction_from_being_turned_off() -> None:
    simulation = Simulation(pile(spin=1.0))
    simulation.advance(2)
    simulation.change(friction=0.0)
    assert not simulation.scene.spin.any()
    simulation.step()


def test_changes_are_listed_once() -> None:
    """A run that is steered in every step does not write longer and longer texts."""
    simulation = Simulation("annulus")
    for k in range(5):
        simulation.change(drag=0.1 * k)
    assert simulation.scene.text.endswith("\n# changed afterwards: drag")
    assert simulation.scene.text.count("changed afterwards") == 1
