"""What happens to a simulation and is over changes no bit of what follows, nor does asking for more."""

import os
import re
import signal
from copy import copy
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from hard_scenes import SOON
from same_bits import contents, run_of
from sample_scenes import bullet, dense_start, random_scene

from warpgrains import Batch, Scene, Simulation, SimulationError, analysis
from warpgrains.scene.fields import ORDERS
from warpgrains.scene.scheme import free_velocity
from warpgrains.scene.state import VERLET_NUMBERS

COLOR, ROUGH, FAST = {"order": "color"}, {"friction": 0.3}, {"method": "accelerated"}
SCENES = {
    "plain": {},
    "in color order": COLOR,
    "rough, leapfrog": ROUGH | {"scheme": "leapfrog"},
    "rough, accelerated, in color order": ROUGH | FAST | COLOR,
    "pressed, accelerated": FAST | {"pressure": 500.0, "wall_mass": 3.0, "wall": "tangent"},
    "pressed, in color order": COLOR | {"pressure": 500.0, "wall_mass": 3.0, "wall": "tangent"},
}


@cache
def started(which):
    return run_of(Scene.load("polydisperse").replace(max_iterations=60, **SCENES[which]), 100)


def restored(simulation):
    """Continue elsewhere from what a state keeps: a step finds other numbers before it uses them."""
    other = Simulation(simulation.scene, state=simulation.state())
    verlet = other._engine.records.host["verlet"]
    numbers = {name for name in verlet.dtype.names if verlet.dtype[name].base.kind == "f"}
    assert numbers > {"frame_shift", *VERLET_NUMBERS}
    for name in numbers - {"frame_shift", *VERLET_NUMBERS}:
        verlet[name] = np.nan
    return other


def interrupted(simulation):
    """Interrupt it after five steps: what it tells of contacts belongs to the start of the last one."""

    def interrupt(done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulation.advance(5, interrupt)
    scene, start, contacts = simulation.scene, simulation.last_start().position, simulation.contacts()
    assert np.array_equal(start + scene.dt * simulation.velocity, simulation.position)
    i, j = contacts.pair.T
    gap = np.linalg.norm(start[j] - start[i], axis=1) - scene.radius[i] - scene.radius[j]
    assert len(gap) > 0
    # some operations on lengths of the scene
    assert contacts.gap == pytest.approx(gap, abs=8 * np.finfo(float).eps * scene.radius_out)
    return simulation


def raised(simulation):
    """Have steps that do not converge raise, in the same words each time: the state is that before them."""
    state, said = simulation.state(), set()
    cut = Simulation(simulation.scene, state=state, max_iterations=2, tolerance=0.0, on_unconverged="raise")
    for _ in range(2):
        with pytest.raises(SimulationError, match=rf"^step {state.steps + 1}, from t = ") as failure:
            cut.step()
        said.add(str(failure.value))
        assert contents(replace(cut.state(), lists=None)) == contents(replace(state, lists=None))
    (message,) = said
    criterion = "residual" if simulation.scene.method == "accelerated" else "zeta"
    expected = (
        rf" = {simulation.time} s: not converged after 2 iterations.*{criterion} .*tolerance 0.000e\+00 m/s"
    )
    assert re.search(expected, message)
    return simulation


def failed(simulation):
    """Take a step that is not finite: it names the grain, and changes nothing."""
    good = simulation.state()
    velocity = good.velocity.copy()
    velocity[3] = [1e308, -1e308]
    bad = replace(good, velocity=velocity, lists=None)
    simulation.restore(bad)
    for _ in range(2):
        with pytest.raises(SimulationError, match=rf"step {good.steps + 1}, .*: grain \d+ reached"):
            simulation.step()
        assert contents(replace(simulation.state(), lists=None)) == contents(bad)
    simulation.restore(good)
    return simulation


def forked(simulation):
    """Leave the steps to a child first."""
    expected = contents(run_of(simulation.scene, simulation.steps + 10).position)
    child = os.fork()
    if child == 0:
        signal.alarm(60)  # ends it if it waits for a thread that it has not
        simulation.advance(10)
        os._exit(0 if contents(simulation.position) == expected else 1)
    assert os.waitpid(child, 0)[1] == 0
    return simulation


CASES = [*product((restored, interrupted, raised, failed), SCENES), (forked, "plain")]


@pytest.mark.parametrize(("happens", "which"), CASES)
def test_nothing_of_it_stays(happens, which):
    whole, rebuilds = copy(started(which)), 0
    simulation = happens(copy(whole))
    whole.advance(simulation.steps - whole.steps)
    for _ in range(21):
        for seen in (Simulation.state, Simulation.contacts, Simulation.wall_contacts):
            assert contents(seen(simulation)) == contents(seen(whole))
        report = simulation.step()
        assert report == whole.step()
        rebuilds += report.rebuilds
    assert rebuilds > 0


SMALL = random_scene(1).replace(tolerance=1e-6, max_iterations=200)
EXACT = {"method": "exact", "tolerance": 1e-9}
ASKED = {
    "plain": (SMALL, 20, 10),
    "in color order": (SMALL.replace(**COLOR), 20, 10),
    "accelerated": (SMALL.replace(**FAST, **COLOR), 20, 10),
    "accelerated to zeta": (SMALL.replace(**FAST, stop="zeta"), 20, 10),
    "to the residual": (SMALL.replace(stop="residual"), 20, 10),
    "cut off": (SMALL.replace(max_iterations=7, tolerance=0.0), 20, 10),
    "solved again": (bullet(), 0, 30),
    "solved by the host": (Scene.load("annulus").replace(**SOON), 260, 8),
    # after sweep 100 of the fourth step, a rejected one, only the history needs the residual
    "a rejected sweep": (dense_start(2, 0.7, **EXACT, max_iterations=3000), 3, 1),
}
"""Scenes, the steps before, and those whose history is asked for."""


@pytest.mark.parametrize("which", ASKED)
def test_a_step_that_tells_its_history_is_the_same(which):
    """It ends with what the report tells; zeta is that of the last sweep, also where the host solves."""
    scene, before, steps = ASKED[which]
    plain = run_of(scene, before)
    told, restarts, factorizations = copy(plain), 0, 0
    for _ in range(steps):
        without, report = plain.step(), told.step(history=True)
        assert without.history is None
        assert report == without
        assert contents(told.state()) == contents(plain.state())
        history = report.history
        assert history is not None
        assert len(history.zeta) == len(history.residual) == report.iterations
        assert history.residual[-1] == report.residual
        assert history.zeta[-1] == report.zeta or report.factorizations > 0
        restarts += report.restarts
        factorizations += report.factorizations
    assert restarts > 0 or which != "solved again"
    assert factorizations > 0 or which != "solved by the host"
    assert told.step().history is None
    plain.advance(1)
    assert contents(told.state()) == contents(plain.state())


@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated"])
def test_entries_of_a_history_are_what_a_step_cut_off_there_reports(method):
    simulation = run_of(Scene.load("annulus").replace(method=method, tolerance=1e-4), 45)
    state, history = simulation.state(), simulation.step(history=True).history
    assert history is not None
    assert len(history.zeta) > 5
    for k, entry in enumerate(zip(*history, strict=True), start=1):
        report = Simulation(simulation.scene, state=state, max_iterations=k).step()
        assert (report.iterations, report.zeta, report.residual) == (k, *entry)


@pytest.mark.parametrize("order", ORDERS)
def test_the_first_list_of_a_state_without_one_is_made_after_the_warm_start(order):
    """Of all its contacts, whatever the number of threads: those that act on a grain take turns."""
    scene = Scene.load("polydisperse").replace(order=order)
    state = run_of(scene, 200).state()
    fresh = Simulation(scene, state=replace(state, lists=None))
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


def test_a_start_with_staggered_velocities_has_its_energy_balance():
    """As a packing of the leapfrog scheme, which begins at step 0."""
    simulation = run_of(Scene.load("polydisperse").replace(scheme="leapfrog"), 50)
    fresh = Simulation(simulation.scene, state=replace(simulation.state(), steps=0))
    for each in (simulation, fresh):
        each.step()
    balance = analysis.step_energy_balance(simulation)
    assert balance.drag_loss > 0.0
    assert analysis.step_energy_balance(fresh) == balance


@pytest.mark.parametrize("fields", [{}, {"drag": 0.5}, {"friction": 0.3, "spin_drag": 1e-3, "spin": 20.0}])
def test_a_scene_of_the_present_falls_on(fields):
    """Made anew every ten steps, it falls and turns as it would: (17) is half a kick, and (16)."""
    scene = Scene(position=[(0.0, 0.0)], radius=0.1, mass=1.0, radius_out=50.0, scheme="leapfrog", **fields)
    whole, anew = Simulation(scene), Simulation(scene)
    for _ in range(20):
        whole.advance(10)
        anew.advance(10)
        assert np.abs(anew.position - whole.position).max() < 2000 * np.finfo(float).eps
        assert np.abs(anew.spin - whole.spin).max() < 2000 * np.finfo(float).eps * 20.0
        anew = Simulation(anew.present_scene)


LOADERS = {
    "made": lambda scene, state: Simulation(scene, state=state),
    "restored": lambda scene, state: Simulation(scene).restore(state),
    "in a batch": lambda scene, state: Batch([scene]).restore(0, state),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("load", LOADERS.values(), ids=LOADERS)
def test_a_state_with_overlaps_is_named(load):
    """But none of a run, whose overlaps are of second order in the paths of a step."""
    simulation = Simulation("annulus")
    for _ in range(8):
        simulation.advance(50)
        load(simulation.scene, simulation.state())
    position = simulation.position.copy()
    position[0] = position[1] + (1e-3, 0.0)
    with pytest.warns(UserWarning, match=r"grains of the state overlap by up to 2\.0e-01 m, which the next"):
        load(simulation.scene, replace(simulation.state(), position=position))
