"""State out and in: a run continues with the same bits, also after a step that failed."""

from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from same_bits import contents

from warpgrains import Disc, Recording, Scene, Simulation, SimulationError, State, analysis
from warpgrains.scene.fields import ORDERS
from warpgrains.scene.scheme import free_velocity
from warpgrains.scene.state import VERLET_NUMBERS


@pytest.fixture(params=ORDERS)
def scene(request: pytest.FixtureRequest) -> Scene:
    return Scene.load("polydisperse").replace(order=request.param)


@pytest.mark.parametrize(
    "changes", [{}, {"method": "accelerated"}, {"friction": 0.3}, {"method": "accelerated", "friction": 0.3}]
)
def test_a_state_needs_no_more_than_it_keeps(scene: Scene, changes: dict) -> None:
    """A step from a state finds all of `VerletWork` before it uses it."""
    scene = scene.replace(**changes)
    simulation, fresh = Simulation(scene), Simulation(scene)
    simulation.run(steps=100)
    fresh.restore(simulation.state())
    verlet = fresh._engine.records.host["verlet"]
    assert verlet["numbers"].dtype.names == ("frame_shift", *VERLET_NUMBERS)
    work = verlet["work"]
    for name in work.dtype.names:
        work[name] = np.nan
    reports = [(simulation.step(), fresh.step()) for _ in range(20)]
    assert sum(one.rebuilds for one, _ in reports) > 0
    assert contents(simulation.state()) == contents(fresh.state())


@pytest.mark.parametrize(
    "changes", [{}, {"scheme": "leapfrog"}, {"pressure": 500.0, "wall_mass": 3.0, "wall": "tangent"}]
)
def test_contacts_of_a_restored_state(scene: Scene, changes: dict) -> None:
    """They are those of the state: their gaps and normals belong to the start of its last step."""
    scene = scene.replace(**changes)
    simulation, fresh = Simulation(scene), Simulation(scene)
    simulation.run(steps=100)
    fresh.restore(simulation.state())
    start = simulation.last_start().position
    for ours, theirs in zip(contacts_of(simulation), contacts_of(fresh), strict=True):
        assert len(ours.gap) > 0
        assert contents(ours) == contents(theirs)
    i, j = simulation.contacts().pair.T
    # x - dt v differs from the start by one rounding of x
    assert simulation.contacts().gap == pytest.approx(
        np.linalg.norm(start[j] - start[i], axis=1) - scene.radius[i] - scene.radius[j],
        abs=8 * np.finfo(float).eps * scene.radius_out,
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"dt": 1e-3},
        {"drag": 3.0},
        {"dt": 0.02, "drag": 0.1, "scheme": "text"},
        {"friction": 0.9},
        {"walls": [Disc((0.2, -0.55), 0.05), Disc((0.0, 0.0), 0.05)]},
    ],
    ids=lambda changes: ", ".join(changes),
)
def test_contacts_after_a_change_are_those_of_the_last_step(changes: dict, tmp_path: Path) -> None:
    walls = [Disc((0.2, -0.55), 0.05)]
    scene = Scene.load("polydisperse").replace(scheme="leapfrog", friction=0.2, walls=walls)
    simulation = Simulation(scene)
    simulation.run(steps=100)
    simulation.save(tmp_path / "before.npz")
    before = shown(simulation)
    energy = analysis.step_energy_balance(simulation)
    assert {2} <= set(simulation.wall_contacts().wall[:, 1].tolist())
    simulation.change(**changes)
    simulation.save(tmp_path / "after.npz")
    for changed in (simulation, copy(simulation), Simulation.load(tmp_path / "after.npz")):
        assert shown(changed) == before
        assert analysis.step_energy_balance(changed) == energy
        changed.step()
        assert changed.state().last_scene is None
        assert shown(changed) != before


def test_forces_at_walls_that_change_are_dropped(tmp_path: Path) -> None:
    """Wall 2 is another one afterwards: it neither takes over the force, nor is drawn with it."""
    ground, stone = Disc((0.0, -1.0), 0.5), Disc((1.2, 0.0), 0.2)
    scene = Scene(position=[(0.0, -0.39)], radius=0.1, mass=1.0, radius_out=2.0, walls=[ground, stone])
    simulation = Simulation(scene)
    simulation.advance(20)
    assert simulation.wall_contacts().wall.tolist() == [[0, 2]]
    simulation.change(walls=[stone])
    assert len(simulation.wall_contacts().wall) == 0
    simulation.run(steps=5, record=tmp_path / "run.usdc", forces=True)
    assert len(Recording(tmp_path / "run.usdc").frame(0).wall) == 0


def test_a_start_with_staggered_velocities_has_its_energy_balance(scene: Scene) -> None:
    """As a packing of the leapfrog scheme, which begins at step 0."""
    simulation = Simulation(scene.replace(scheme="leapfrog"))
    simulation.advance(50)
    fresh = Simulation(simulation.scene)
    fresh.restore(replace(simulation.state(), steps=0))
    for each in (simulation, fresh):
        each.step()
    balance = analysis.step_energy_balance(simulation)
    assert balance.drag_loss > 0.0
    assert analysis.step_energy_balance(fresh) == balance


def shown(simulation: Simulation) -> list:
    """Return all numbers of the contacts, and of the forces that analysis takes from them."""
    return [contents(part) for part in (*contacts_of(simulation), *analysis.snapshot(simulation).loads)]


def contacts_of(simulation: Simulation) -> tuple:
    return simulation.contacts(), simulation.wall_contacts()


def test_the_last_start_is_known_after_an_advance_that_was_interrupted(scene: Scene) -> None:
    simulation = Simulation(scene)

    def interrupt(done: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulation.advance(5, interrupt)
    assert simulation.steps == 5
    start = simulation.last_start()
    assert np.array_equal(start.position + scene.dt * simulation.velocity, simulation.position)


def test_the_first_list_of_a_state_without_one_is_made_after_the_warm_start(scene: Scene) -> None:
    """Of all its contacts, whatever the number of threads: those that act on a grain take turns."""
    simulation, fresh = Simulation(scene), Simulation(scene)
    simulation.run(steps=200)
    state = simulation.state()
    fresh.restore(replace(state, lists=None))
    assert fresh.step().rebuilds == 1
    (i, j), (grain, _), dv = state.corrections.pair.T, state.corrections.wall.T, state.corrections
    expected = free_velocity(scene, state.velocity, state.staggered)
    impulse = dv.pair_correction[:, np.newaxis] * scene.pair_frames(state.position, dv.pair)[0]
    mass = scene.contact_mass
    share = (mass[j] / (mass[i] + mass[j]))[:, np.newaxis]
    np.subtract.at(expected, i, share * impulse)
    np.add.at(expected, j, (1.0 - share) * impulse)
    normal, _ = scene.wall_frames(state.position, dv.wall)
    np.subtract.at(expected, grain, dv.wall_correction[:, np.newaxis] * normal)
    # sums of at most some ten corrections below 1 m/s, in another order
    assert np.abs(fresh._engine.records.array(0, "verlet.reference_velocity") - expected).max() < 1e-13


def test_first_list_of_a_state_without_one() -> None:
    """It is made for a grain that its wall holds, not for one that falls through it."""
    scene = Scene(position=[[0.0, -1.9]], radius=0.1, mass=1.0, radius_out=2.0, gravity=(0.0, -9.81), dt=0.01)
    simulation, fresh = Simulation(scene), Simulation(scene)
    simulation.run(steps=3)
    state = simulation.state()
    fresh.restore(State(state.steps, state.position, state.velocity, state.corrections))
    fresh.step()
    expected = fresh._engine.records.array(0, "verlet.reference_velocity")
    assert np.abs(expected).max() < 1e-12


def test_step_that_is_not_finite(scene: Scene) -> None:
    """It names the grain, changes nothing, and a good state continues as if nothing had happened."""
    simulation = Simulation(scene)
    simulation.run(steps=100)
    good = simulation.state()
    velocity = good.velocity.copy()
    velocity[3] = [1e308, -1e308]
    bad = replace(good, velocity=velocity, lists=None)
    simulation.restore(bad)
    for _ in range(2):
        with pytest.raises(SimulationError, match=r"step 101, .*: grain \d+ reached"):
            simulation.step()
        assert contents(replace(simulation.state(), lists=None)) == contents(bad)
    simulation.restore(good)
    simulation.run(steps=20)
    undisturbed = Simulation(scene)
    undisturbed.restore(good)
    undisturbed.run(steps=20)
    assert contents(simulation.state()) == contents(undisturbed.state())
