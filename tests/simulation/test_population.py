"""`Simulation.add` and `remove`: what continues, what is checked, and numbers that no two grains share."""

import pickle
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from command import exit_code
from same_bits import contents, run_of
from walled_scenes import OF_EVERY_KIND, ROLLING, ROUGH, chained, scattered

from warpgrains import Box, InputError, Recording, Scene, Segment, Simulation, SimulationError, State
from warpgrains.drawing.extent import extent_of
from warpgrains.scene.compatibility import allowed_overlap
from warpgrains.scene.state import Corrections, first_state

PISTON = Segment((-0.2, 0.6), (0.2, 0.6), force=-2.0, mass=1.0)
CORNERS = np.array([(-0.6, -0.2), (0.0, -0.5), (0.6, -0.3)])
SHELF, FLOOR = Segment((0.2, 3.0), (0.9, 3.0)), Segment((0.015, 0.3), (0.985, 0.3))


def on_a_wide_floor(**changes):
    """Return grains on a floor, some also on its image, below a shelf that has no images yet."""
    x, y = np.meshgrid(np.arange(8) * 0.12, np.arange(5) * 0.12 + 0.4)
    box = {"domain": Box((0.0, 1.0), (0.0, 4.0), periodic="x"), "walls": [SHELF, FLOOR], "dt": 2e-3}
    return Scene(position=np.stack([x.ravel(), y.ravel()], axis=1), radius=0.02, mass=0.1, **box, **changes)


STARTS = {
    "plain": scattered(60, 1, (0.0, 0.7), ()),
    "rough, leapfrog": scattered(
        60, 2, (0.0, 0.6), OF_EVERY_KIND, scheme="leapfrog", drag=0.2, spin_drag=1e-4, **ROUGH, **ROLLING
    ),
    "driven, accelerated": scattered(
        60, 3, (0.0, 0.3), [PISTON], method="accelerated", pressure=5.0, **ROUGH
    ),
    "periodic": on_a_wide_floor(friction=0.3),
    "moving": scattered(60, 4, (0.0, 0.4), chained(CORNERS, velocity=(0.0, 0.02)), restitution=0.3),
}


def resting(scene):
    """Return a simulation whose grains are a packing, more or less, after a change of a wall and gravity."""
    simulation = run_of(scene, 150, state=first_state(scene))  # whose grains overlap
    simulation.change(gravity=(1.0, -9.0), dt=0.9 * scene.dt)
    return simulation


def above(simulation, count, radius):
    """Return places for grains of a radius above all others [m], shape (count, 2)."""
    at, _ = extent_of(simulation.scene).center
    height = max(simulation.position[:, 1].max(), 0.62) + 1.1 * (radius + simulation.scene.radius.max())
    return np.stack(
        [at + 2.2 * radius * (np.arange(count) - count / 2 + 0.5), np.full(count, height)], axis=1
    )


def by_hand(before, stay, more):
    """Return the scene and the state that removing all but `stay`, and adding more, should give."""
    state, scene = before.state(), before.scene
    kept = state.corrections
    index = {grain: place for place, grain in enumerate(stay)}
    rows = {
        "pair": [k for k, (i, j) in enumerate(kept.pair.tolist()) if i in index and j in index],
        "wall": [k for k, (i, _) in enumerate(kept.wall.tolist()) if i in index],
    }
    of_contacts = {
        name: array if array is None else array[rows[name[:4]]] for name, array in vars(kept).items()
    }
    of_contacts["pair"] = np.vectorize(index.get, [np.int32])(of_contacts["pair"])
    of_contacts["wall"] = of_contacts["wall"].copy()
    of_contacts["wall"][:, 0] = [index[grain] for grain in of_contacts["wall"][:, 0].tolist()]
    added = len(more["position"])
    mass, radius = (np.append(getattr(scene, name)[stay], more[name]) for name in ("mass", "radius"))
    position = np.append(state.position[stay], more["position"], axis=0)
    thrown, turned = more["velocity"], more["spin"]
    if state.staggered:
        back = 0.5 * scene.dt * np.array(scene.gravity_at(before.time))
        thrown = (thrown - back) / (1.0 - scene.drag * scene.dt / (2.0 * more["mass"][:, None]))
        inertia = 0.5 * more["mass"] * more["radius"] * more["radius"]
        turned = turned / (1.0 - scene.spin_drag * scene.dt / (2.0 * inertia))
    own = {name: getattr(scene, name) for name in scene.__dataclass_fields__}
    grains = {"position": position, "radius": radius, "mass": mass, "spin": 0.0, "velocity": None}
    rotates = scene.has_friction
    return Scene.made(own | grains), State(
        steps=state.steps,
        position=position,
        velocity=np.append(state.velocity[stay], thrown, axis=0),
        corrections=Corrections(**of_contacts),
        staggered=state.staggered,
        last_staggered=state.last_staggered,
        spin=np.append(state.spin[stay], turned) if rotates else None,
        angle=np.append(state.angle[stay], np.zeros(added)) if rotates else None,
        driven=state.driven,
    )


def shown(simulation):
    """Return the forces of contacts by the numbers of birth of their grains."""
    number, contacts, at_walls = simulation.id, *simulation.forces()
    pairs = zip(number[contacts.pair].tolist(), contacts.force, contacts.tangential_force, strict=True)
    walls = zip(at_walls.wall.tolist(), at_walls.force, at_walls.tangential_force, strict=True)
    return {tuple(pair): force for pair, *force in pairs} | {
        (int(number[grain]), simulation.scene.wall_names[wall]): force for (grain, wall), *force in walls
    }


@pytest.mark.parametrize("which", STARTS)
def test_a_step_after_it_is_that_of_a_new_simulation_with_the_same_corrections(which, tmp_path):
    """And copies, checkpoints and contacts of the grains that stay continue."""
    simulation, rng = resting(STARTS[which]), np.random.default_rng(7)
    born = simulation.scene.n
    for _ in range(3):
        before = copy(simulation)
        stay = np.sort(rng.permutation(before.scene.n)[3:]).tolist()
        more = {"radius": rng.uniform(0.01, 0.02, 4), "mass": rng.uniform(0.1, 0.3, 4)}
        more |= {"position": above(before, 4, 0.02), "velocity": rng.normal(0.0, 0.1, (4, 2))}
        more |= {"spin": rng.normal(0.0, 1.0, 4) * before.scene.has_friction}
        simulation.remove(np.delete(before.id, stay))
        assert simulation.add(**more).tolist() == [*range(born, born + 4)]
        born += 4
        assert simulation.id.tolist() == [*before.id[stay].tolist(), *range(born - 4, born)]
        told, was = shown(simulation), shown(before)
        assert len(told) > 20
        gone = {*before.id.tolist()} - {*simulation.id.tolist()}
        assert told == {ends: force for ends, force in was.items() if gone.isdisjoint(ends)}
        simulation.save(tmp_path / "saved.npz")
        others = [copy(simulation), Simulation.load(tmp_path / "saved.npz")]
        others.append(pickle.loads(pickle.dumps(simulation)))
        for other in others:
            assert shown(other) == told
            assert contents(other.state()) == contents(simulation.state())
            assert contents(other.scene) == contents(simulation.scene)
        scene, state = by_hand(before, stay, more)
        others.append(Simulation(scene, state=state))
        for _ in range(20):
            expected = contents(simulation.step())
            for other in others:
                assert contents(other.step()) == expected
                for name in ("position", "velocity", "spin", "angle", "driven"):
                    assert contents(getattr(other, name)) == contents(getattr(simulation, name)), name
        assert simulation.state().last_scene is None


def test_numbers_are_never_used_twice(tmp_path):
    simulation = run_of(Scene.load("annulus"), 5)
    simulation.remove(14)
    assert simulation.add(position=[(0.0, 1.5)], radius=0.1, mass=0.1).tolist() == [15]
    simulation.remove([15, 0])
    simulation.remove([])
    simulation.save(tmp_path / "saved.npz")
    for each in (simulation, Simulation.load(tmp_path / "saved.npz"), copy(simulation)):
        assert each.add(position=[(0.0, 1.5)], radius=0.1, mass=0.1).tolist() == [16]
        assert each.id.tolist() == [*range(1, 14), 16]


@pytest.mark.parametrize("scheme", ["euler", "leapfrog"])
def test_an_added_grain_falls_as_one_of_the_start(scheme):
    """It has its velocity where it is: half a step behind in the leapfrog scheme, as the others are."""
    fields = {
        "radius_out": 9.0,
        "drag": 0.3,
        "spin_drag": 1e-3,
        "friction": 0.1,
        "scheme": scheme,
        "dt": 0.01,
    }
    grain = {"position": [(0.0, 5.0)], "velocity": [(0.5, 1.0)], "spin": 2.0, "radius": 0.1, "mass": 1.0}
    simulation = run_of(Scene(position=[(0.0, -5.0)], radius=0.1, mass=1.0, **fields), 30)
    simulation.add(**grain)
    alone = Simulation(Scene(**grain, **fields))
    for _ in range(50):
        simulation.step()
        alone.step()
        # the speeds, up to 6 m/s, have errors of some eps in each of 50 steps, and so have the paths
        assert np.abs(simulation.velocity[1] - alone.velocity[0]).max() < 50 * 4 * 6.0 * np.finfo(float).eps
        assert np.abs(simulation.position[1] - alone.position[0]).max() < 50 * 4 * 6.0 * np.finfo(float).eps
        assert abs(simulation.spin[1] - alone.spin[0]) < 50 * 4 * 2.0 * np.finfo(float).eps


def test_images_of_a_wall_come_and_go_with_large_grains():
    """Forces at the wall stay what they are, whatever number its images have."""
    simulation = run_of(on_a_wide_floor(tolerance=1e-9), 400)
    told, walls = shown(simulation), len(simulation.scene.walls)
    assert any(simulation.scene.walls[wall].image for wall in simulation.wall_contacts().wall[:, 1])
    (large,) = simulation.add(position=[(0.5, 2.0)], radius=0.1, mass=1.0)
    assert len(simulation.scene.walls) == walls + 2
    assert shown(simulation) == told
    simulation.step()
    told = {ends: force for ends, force in shown(simulation).items() if large not in ends}
    simulation.remove(large)
    assert len(simulation.scene.walls) == walls
    assert shown(simulation) == told
    simulation.advance(10)


def test_what_overlaps_is_refused_by_its_depth_or_moved_apart():
    simulation = resting(STARTS["rough, leapfrog"])
    place, scene = simulation.position, simulation.scene
    inside = {"position": [(0.0, 0.8), place[7] + (0.0, 0.5 * scene.radius[7])], "radius": 0.01, "mass": 0.1}
    depth = 0.01 + 0.5 * scene.radius[7]
    simulation.remove(3)  # so that numbers are not indices
    state = contents(simulation.state())
    with pytest.raises(InputError, match=f"added grain 1 is .*overlaps grain 7 by {depth:.1e} m"):
        simulation.add(**inside)
    for more, complaint in (
        ({"position": [(0.0, 0.8), (0.0, 0.805)]}, "added grain 1 is .*overlaps added grain 0 by 1.5e-02 m"),
        ({"position": [(0.02, 0.875)]}, "added grain 0 is .*overlaps Disc4 by 5.0e-03 m"),
        ({"position": [(0.0, 0.8)], "radius": 2.0}, "fit between the walls"),
        ({"position": [(0.0, -0.5)]}, r"position of added grain 0 .*inside walls\[0\]"),
    ):
        with pytest.raises(InputError, match=complaint):
            simulation.add(**inside | more)
    assert contents(simulation.state()) == state
    told = simulation.state().corrections
    simulation.add(**inside, separate=True)
    assert simulation.present_scene.count_overlaps().largest < allowed_overlap(scene)
    kept = simulation.state().corrections
    assert contents(kept.pair_correction) == contents(told.pair_correction)
    simulation.step()
    assert np.hypot(*simulation.velocity.T).max() < depth / simulation.scene.dt  # a step that undoes it
    simulation.add(position=[(0.0, 0.8)], radius=0.01, mass=0.1, separate=True)


def test_a_run_continues_with_other_grains(tmp_path, monkeypatch):
    """Runs between two changes are recorded, saved and resumed; within one, nothing comes or goes."""
    monkeypatch.chdir(tmp_path)
    simulation = resting(STARTS["rough, leapfrog"])
    simulation.remove(simulation.id[::7])
    simulation.add(position=above(simulation, 3, 0.02), radius=0.02, mass=0.2)
    whole = copy(simulation)
    simulation.run(steps=20, record="run.usdc", forces=True, checkpoint="run.npz", every=10)
    assert exit_code("run", "--resume", "run.npz", "--steps", "190") == 0
    whole.run(steps=40, record="whole.usdc", forces=True)
    assert contents(Simulation.load("run.npz").state()) == contents(whole.state())
    recording = Recording("run.usdc")
    assert recording.position.shape[1] == whole.scene.n
    assert np.array_equal(recording.position, Recording("whole.usdc").position)
    for change in (
        lambda now: now.remove(1),
        lambda now: now.add(position=[(0.0, 0.9)], radius=0.01, mass=0.1),
    ):
        with pytest.raises(SimulationError, match="callback"):
            whole.run(steps=10, until=change)


def test_states_of_other_grains_are_refused():
    simulation = run_of(Scene.load("annulus"), 5)
    state = first_state(simulation.scene)
    n = simulation.scene.n
    simulation.remove(2)
    with pytest.raises(InputError, match="position of the state is"):
        simulation.restore(state)
    simulation = Simulation("annulus")
    for own, complaint in (
        ({"id": np.arange(n)}, "id of the state must be in ascending order, from 0 to below born, 0"),
        ({"id": np.arange(n)[::-1].copy(), "born": n}, "id of the state must be in ascending order"),
        ({"id": np.arange(n) - 1, "born": n}, "id of the state must be in ascending order"),
        ({"id": np.arange(n - 1), "born": n}, "id of the state is int64"),
        ({"id": list(range(n)), "born": n}, "id of the state is a list"),
        ({"born": 3}, "born of the state is 3: it must be 0 without id"),
        ({"born": -3}, "born is -3: it must be between 0"),
    ):
        with pytest.raises(InputError, match=complaint):
            simulation.restore(replace(state, **own))


@pytest.mark.parametrize("which", STARTS)
def test_grains_are_poured_where_there_is_room(which, tmp_path):
    """Until there is none; and the same ones after a checkpoint, with any number of threads."""
    simulation = resting(STARTS[which])
    left, bottom, right, top = extent_of(simulation.scene)
    region = {"x": (0.7 * left + 0.3 * right, 0.5 * (left + right)), "y": (0.5 * (bottom + top), 0.8 * top)}
    how = {"radius": (0.01, 0.03), "density": 10.0, "region": region, "velocity": (0.0, -0.1)}
    simulation.save(tmp_path / "saved.npz")
    other = Simulation.load(tmp_path / "saved.npz", threads=2)
    deepest, counts = simulation.present_scene.count_overlaps().largest, []
    while not counts or counts[-1]:
        n = simulation.scene.n
        number = simulation.pour(40, **how)
        assert contents(number) == contents(other.pour(40, **how))
        assert contents(simulation.state()) == contents(other.state())
        assert number.tolist() == simulation.id[n:].tolist()
        counts.append(len(number))
        place, radius = simulation.position[n:].T, simulation.scene.radius[n:]
        for (low, high), along in zip(region.values(), place, strict=True):
            assert ((along - radius >= low) & (along + radius <= high)).all()
        assert radius.min(initial=0.01) >= 0.01
        assert simulation.scene.mass[n:] == pytest.approx(10.0 * np.pi * radius**2, rel=1e-15)
        # as deep as before, or to rounding of places
        assert simulation.present_scene.count_overlaps().largest <= max(deepest, 1e-12)
    assert counts[0] > 20
    assert sum(counts) < 400
    state = contents(simulation.state())
    assert simulation.pour(40, **how).tolist() == []
    assert contents(simulation.state()) == state
    simulation.advance(5)


def test_what_went_in_came_out():
    """Grains that recirculate through a funnel are counted to the grain."""
    x, y = np.meshgrid(np.linspace(-0.3, 0.3, 8), np.linspace(0.2, 0.5, 5))
    slopes = [Segment((-0.7, 0.3), (-0.1, -0.1)), Segment((0.7, 0.3), (0.1, -0.1))]
    simulation = Simulation(
        Scene(
            position=np.stack([x.ravel(), y.ravel()], 1), radius=0.02, mass=0.1, radius_out=1.0, walls=slopes
        )
    )
    taken = poured = owed = 0
    for _ in range(20):
        simulation.run(duration=0.05)
        below = simulation.id[simulation.position[:, 1] < -0.3]
        simulation.remove(below)
        owed += len(below)
        number = (
            simulation.pour(owed, radius=0.02, density=80.0, region={"x": (-0.3, 0.3), "y": (0.4, 0.7)})
            if owed
            else []
        )
        owed, taken, poured = owed - len(number), taken + len(below), poured + len(number)
        assert simulation.scene.n + owed == 40
        assert len({*simulation.id.tolist()}) == simulation.scene.n
    assert taken > 20
    assert simulation.id[-1] == 39 + poured
