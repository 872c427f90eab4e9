"""Contacts, rattlers, stress and energy: closed forms, identities of mechanics, other libraries."""

from copy import copy
from dataclasses import replace

import networkx
import numpy as np
import pytest
from moments import EPS, energy_balance, frictional
from schemes import EULER, SCHEMES, SECOND_ORDER, contact_mass, without_contacts

from warpgrains import Scene, Simulation, analysis
from warpgrains.scene.scheme import free_spin

G = 9.81


@pytest.mark.parametrize("n", [1, 2, 6])
def test_column(n):
    """Grains one above the other on the lowest point, at rest from the first step on."""
    position = np.column_stack([np.zeros(n), -0.95 + 0.1 * np.arange(n)])
    fields = {"radius": 0.05, "mass": 0.2, "radius_out": 1.0}
    column = Simulation(Scene(position=position, **fields, tolerance=0.0, max_iterations=3000))
    column.step()
    carried = np.arange(n, 0, -1) * 0.2 * G  # by the lower contact of each
    # gaps are off by some eps, over dt^2 a force; n contacts pass it on
    rounding = 16.0 * n * EPS * 0.2 / 0.01**2
    moment = analysis.snapshot(column)
    assert moment.force == pytest.approx(carried[1:], abs=rounding)
    assert analysis.contact_numbers(moment).tolist() == [2] * (n - 1) + [1]
    assert analysis.coordination_number(moment) == (2 * n - 1) / n
    # the upper one stands on one point; without it so does the next
    assert analysis.rattlers(moment).all()
    assert analysis.coordination_number(moment, without_rattlers=True) == 0.0
    stress = analysis.grain_stresses(moment, area=np.ones(n))
    expected = 0.05 * (carried + np.append(carried[1:], 0.0))
    assert stress[:, 1, 1] == pytest.approx(expected, abs=rounding)
    assert np.array_equal(stress[:, 0, 0], np.zeros(n))
    if n > 1:
        assert analysis.fabric_tensor(moment).tolist() == [[0.0, 0.0], [0.0, 1.0]]
    for _ in range(3):  # it stands: its contacts carry weight and do no work
        column.step()
        assert abs(analysis.step_energy_balance(column).contact_loss) < 1e3 * EPS


@pytest.mark.parametrize("scheme", SCHEMES)
def test_grains_in_flight_have_nothing_but_drag(scheme):
    """From the first step on, in which a staggered velocity is half a step behind."""
    fields = {"velocity": [[3.0, 4.0], [0.0, 1.0]], "gravity": (0.0, 0.0), "drag": 0.5, **scheme}
    position = [[0.5, 0.0], [-0.5, 0.0]]
    simulation = Simulation(Scene(position=position, radius=0.05, mass=[0.2, 0.1], radius_out=1.0, **fields))
    for _ in range(3):
        before = analysis.kinetic_energy(simulation)
        simulation.step()
        balance, lost = analysis.step_energy_balance(simulation), before - analysis.kinetic_energy(simulation)
        assert balance.drag_loss == pytest.approx(lost, abs=16 * EPS)  # of 2.6 J
        assert balance.contact_loss == pytest.approx(0.0, abs=16 * EPS)
    assert lost > 0.01
    assert analysis.coordination_number(simulation) == 0.0
    assert analysis.rattlers(simulation).all()
    assert np.array_equal(analysis.mean_stress(simulation, part="contacts"), np.zeros((2, 2)))
    assert np.isnan(analysis.fabric_tensor(simulation)).all()
    assert analysis.force_statistics(simulation).contacts == 0
    assert np.array_equal(analysis.force_distribution(simulation).density, np.zeros(40))


@pytest.mark.parametrize(
    ("gravity", "needed", "least"), [(-G, 2, 0.0), (-G, 2, 0.5), (-G, 2, 5.0), (0.0, 3, 0.0)]
)
def test_rattlers_are_what_no_core_holds(settled, gravity, needed, least):
    """A k-core of the graph of contacts, in networkx; walls, a clique of their own, hold whom they touch."""
    moment = replace(analysis.snapshot(settled), scene=settled.scene.replace(gravity=(0.0, gravity)))
    graph = networkx.complete_graph([("wall", side) for side in range(4)])
    walls, pairs = list(graph), moment.pair[moment.force >= least]
    at_wall = moment.wall[moment.wall_force >= least, 0]
    assert analysis.coordination_number(moment, least) == (2 * len(pairs) + len(at_wall)) / moment.n
    graph.add_edges_from(pairs.tolist())
    graph.add_edges_from((walls[0], grain) for grain in at_wall.tolist())
    graph = networkx.k_core(graph, needed)
    core = set(graph) - set(walls)
    assert set(np.flatnonzero(~analysis.rattlers(moment, least)).tolist()) == core
    graph.remove_nodes_from(walls[1:])
    contacts = sum(graph.degree(grain) for grain in core)
    found = analysis.coordination_number(moment, least, without_rattlers=True)
    assert found == (contacts / len(core) if core else 0.0)
    assert needed == 3 or least > 0.0 or len(core) > 60


@pytest.fixture(scope="module")
def held():
    """Grains with friction that have come to rest on a floor at rest."""
    fields = {"angular_velocity_out": 0.0, "angular_velocity_in": 0.0, "spin_drag": 1e-3, "drag": 0.5}
    simulation = Simulation(frictional(12, scheme="leapfrog", **fields))
    simulation.advance(500)
    return simulation


@pytest.mark.parametrize("state", ["settled", "rolling", "held"])
def test_stress(state, request):
    """The moments of all forces and torques on the grains, from the change of their velocities and spins."""
    simulation = copy(request.getfixturevalue(state))
    scene, start = simulation.scene, simulation.state()
    simulation.step()
    moment = analysis.snapshot(simulation)
    free = without_contacts(scene, start.velocity, start.staggered)
    force = contact_mass(scene)[:, np.newaxis] * (simulation.velocity - free) / scene.dt
    # velocities of some m/s are corrected thousands of times, each rounding by eps / 2
    tolerance = 1e4 * EPS * contact_mass(scene).max() * 10.0 / scene.dt
    assert analysis.contact_forces(simulation) == pytest.approx(force, abs=tolerance)
    assert np.abs(force).max() > 1.0 or state == "held"
    loads = moment.loads
    tangent = loads.normal[:, ::-1] * (-1.0, 1.0)
    push = loads.force[:, np.newaxis] * loads.normal + loads.tangential_force[:, np.newaxis] * tangent
    at_wall = slice(2 * len(moment.pair), None)
    grain = loads.grain[at_wall]
    touched = moment.start[grain] + scene.radius[grain, np.newaxis] * loads.normal[at_wall]
    expected = (moment.start.T @ force + touched.T @ push[at_wall]) / scene.area
    found = analysis.mean_stress(simulation, part="contacts")
    i, j = moment.pair.T
    gap = np.hypot(*(moment.start[j] - moment.start[i]).T) - scene.radius[i] - scene.radius[j]
    slack = (np.hypot(*push[: len(i)].T) * np.abs(gap)).sum() / scene.area
    assert found == pytest.approx(expected, abs=slack + 1e-9)
    assert slack < 0.1 * np.abs(found).max()
    pressure = (loads.force @ scene.radius[loads.grain]) / (2.0 * scene.area)
    kinetic = np.trace(analysis.mean_stress(simulation, part="kinetic"))
    assert analysis.pressure(simulation) - kinetic / 2.0 == pytest.approx(pressure)
    each = analysis.grain_stresses(simulation, area=np.ones(scene.n))
    # a sum of n terms, in another order
    assert each.sum(axis=0) / scene.area == pytest.approx(found, rel=1e3 * EPS, abs=1e-12)
    if not scene.has_friction:
        assert np.array_equal(found, found.T)
        return
    inertia = 0.5 * scene.rim_mass * scene.radius**2
    spin = free_spin(scene, start.spin, start.staggered)
    torque = inertia * (simulation.spin - spin) / scene.dt
    assert each[:, 0, 1] - each[:, 1, 0] == pytest.approx(-torque, abs=1e-9)
    antisymmetric = analysis.quantities(moment, ["stress_antisymmetric"])["stress_antisymmetric"]
    assert antisymmetric == pytest.approx(-torque.sum() / (2.0 * scene.area), abs=1e-9)
    if state == "held":
        assert np.abs(simulation.velocity).max() < 1e-6
        assert abs(antisymmetric) < 1e-6 * np.abs(found).max()
        assert np.abs(torque).max() < 1e-5
    else:
        assert abs(antisymmetric) > 1e-3 * np.abs(found).max()


AT_REST = {"angular_velocity_out": 0.0, "angular_velocity_in": 0.0}


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(Scene.load("annulus").replace(**EULER), id="no friction"),
        pytest.param(Scene.load("annulus").replace(**SECOND_ORDER), id="no friction, second order"),
        pytest.param(frictional(**EULER), id="friction"),
        pytest.param(frictional(**SECOND_ORDER), id="friction, second order"),
        pytest.param(frictional(**SECOND_ORDER, spin_drag=0.0, drag=0.0), id="no drag"),
        pytest.param(frictional(**EULER, **AT_REST), id="walls at rest"),
        pytest.param(frictional(**EULER, friction=0.0, wall_friction=0.5), id="smooth grains"),
        pytest.param(frictional(**SECOND_ORDER, wall_friction=0.0, **AT_REST), id="smooth walls"),
        pytest.param(frictional(**SECOND_ORDER, method="accelerated"), id="accelerated"),
    ],
)
def test_energy_is_accounted_for(scene):
    """From the first kick on, and from a state."""
    simulation = Simulation(scene)
    for steps in (10, 60 if scene.has_friction else 100):
        before = analysis.kinetic_energy(simulation)
        summed = energy_balance(simulation, steps)
        change = summed.gravity_work + summed.wall_work - summed.drag_loss - summed.contact_loss
        # each step's sums are of some joules, and the velocities before it are had back to their rounding
        rounding = (1e5 if scene.has_friction else 1e4) * EPS * steps
        assert analysis.kinetic_energy(simulation) - before == pytest.approx(change, abs=rounding)
    assert min(summed.gravity_work, summed.impact_loss) > 0.01
    assert summed.drag_loss > 0.01 or scene.drag == 0.0
    assert (summed.friction_loss > 0.01) if scene.has_friction else (summed.friction_loss == 0.0)
    is_driven = scene.angular_velocity_out != 0.0
    assert (summed.wall_work > 0.01) if is_driven else (summed.wall_work == 0.0)


def test_a_wheel_is_driven_by_the_wall():
    """A disc at rest on a wall that moves slides at first, at a third of the acceleration of its surface."""
    speed, mass = 0.6, 2.0
    fields = {"friction": 0.3, "angular_velocity_out": speed, "dt": 1e-3, "tolerance": 1e-12}
    simulation = Simulation(Scene(position=[[0.0, -0.5]], radius=0.5, mass=mass, radius_out=1.0, **fields))
    balance = energy_balance(simulation, 1)
    push = 0.3 * mass * G * 1e-3  # slides in the first step
    slip = push * 3.0 / mass
    assert balance.wall_work == pytest.approx(push * speed, rel=1e-9)
    assert balance.friction_loss == pytest.approx(push * (speed - 0.5 * slip), rel=1e-9)
    assert balance.impact_loss == pytest.approx(0.0, abs=1e-9)
    assert analysis.kinetic_energy(simulation) == pytest.approx(0.5 * push * slip, rel=1e-9)
