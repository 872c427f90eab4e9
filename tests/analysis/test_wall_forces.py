"""Forces on walls by name: they balance the momentum of the grains, and single contacts add up to them."""

import numpy as np
import pytest
from moments import EPS, step_and_balance_forces
from walled_scenes import BOUNCY, BUMPS, ROUGH, WALLED, boxed

from warpgrains import Box, InputError, Scene, Segment, Simulation, analysis


@pytest.mark.parametrize("which", WALLED)
def test_forces_on_walls_change_the_momentum_of_the_grains(which: str) -> None:
    laws = ({}, BOUNCY, ROUGH)[[*WALLED].index(which) % 3]
    simulation = Simulation(WALLED[which](**laws))
    simulation.advance(20)
    for _ in range(10):
        found = step_and_balance_forces(simulation)
    assert sum(own.contacts for own in found.values()) == len(simulation.wall_contacts().wall)


def test_torques_are_about_pivots_or_the_origin() -> None:
    simulation = Simulation(WALLED["moving"](**ROUGH))
    names = np.array(simulation.scene.wall_names)
    turning = {wall.named(k): wall for k, wall in enumerate(simulation.scene.walls) if wall.angular_velocity}
    met = set()
    for _ in range(200):
        time = simulation.time
        simulation.step()
        contacts, start = simulation.wall_contacts(), simulation.last_start()
        for name, own in analysis.wall_forces(simulation).items():
            pivot = np.zeros(2)
            if name in turning:
                (pivot,) = turning[name].pose(time).place(np.array([turning[name].about]))
            at = names[contacts.wall[:, 1]] == name
            n, grain = contacts.normal[at], contacts.wall[at, 0]
            arm = start.position[grain] + simulation.scene.radius[grain, None] * n - pivot
            tangent = np.stack([-n[:, 1], n[:, 0]], axis=1)
            force = contacts.force[at, None] * n + contacts.tangential_force[at, None] * tangent
            torque = (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]).sum()
            assert own.torque == pytest.approx(torque, rel=1e-12, abs=1e-12 * np.abs(force).sum())
            met |= {name} if at.any() else set()
    assert len(met & {*turning}) > 2


def test_quantities_of_walls_have_the_name_after_a_colon() -> None:
    lid = {"pressure": 30.0, "mass": 1.0, "velocity": (0.5, 0.0), "end_time": 0.1, "roughness": BUMPS}
    simulation = Simulation(boxed("rough lid", top=lid, drag=0.3, max_iterations=1000))
    simulation.advance(1200)
    names = [f"{kind}:top" for kind in ("force_x", "force_y", "torque", "position_x", "position_y")]
    found = analysis.quantities(simulation, names)
    assert found["force_y:top"] == pytest.approx(30.0, abs=1e-2)  # line and rows are one
    assert found["position_y:top"] == 0.7 - simulation.driven[1, 0]
    assert [analysis.find(name).unit for name in names] == ["N", "N", "N m", "m", "m"]
    with pytest.raises(InputError, match=r"force_x:lid: the scene has no wall 'lid'; it has bottom, top"):
        simulation.run(steps=1, observer=analysis.Series("force_x:lid"))
    with pytest.raises(InputError, match="unknown quantity 'force:top'"):
        analysis.find("force:top")


def test_a_gas_has_a_kinetic_stress() -> None:
    """Without contacts it is all; the mean velocity of the grains does not count."""
    rng = np.random.default_rng(3)
    position = np.stack(np.meshgrid(*2 * [np.arange(0.05, 1.0, 0.1)]), axis=-1).reshape(-1, 2)
    velocity, mass = rng.normal(size=(100, 2)) * (1.0, 2.0) + (7.0, 0.0), rng.uniform(1.0, 2.0, 100)
    box = Box((0.0, 1.0), (0.0, 1.0), periodic="xy")
    grains = {"position": position, "velocity": velocity, "radius": 0.01, "mass": mass}
    scene = Scene(**grains, domain=box, gravity=(0.0, 0.0))
    simulation = Simulation(scene)
    mean = mass @ velocity / mass.sum()
    expected = sum(m * np.outer(v - mean, v - mean) for m, v in zip(mass, velocity, strict=True))
    assert analysis.mean_stress(simulation) == pytest.approx(expected, rel=1e3 * EPS)
    assert (analysis.mean_stress(simulation, part="contacts") == 0.0).all()
    assert analysis.pressure(simulation) == pytest.approx(np.trace(expected) / 2.0, rel=1e3 * EPS)
    found = analysis.quantities(simulation, ["kinetic", "stress_xx"])
    assert found["kinetic_stress_xx"] == found["stress_xx"]
    slices = analysis.height_profile(simulation, 1)
    assert slices.stress[0] == pytest.approx(expected[::-1, ::-1] * [[1, -1], [-1, 1]], rel=1e3 * EPS)


def test_all_quantities_that_a_scene_can_have() -> None:
    """By default those that would be refused are left out."""
    floor = Segment((-0.9, -0.7), (0.9, -0.7))
    for scene, missing in (
        (Scene.load("annulus"), {"inflow_count"}),
        (Scene.load("annulus").replace(walls=[floor]), {"pressure", "packing_fraction", "pile_height"}),
    ):
        found = analysis.quantities(Simulation(scene))
        assert missing.isdisjoint(found)
        assert {"kinetic_energy", "rattlers"} <= found.keys()


def test_a_series_of_a_run_has_means_with_their_errors() -> None:
    """Of independent numbers, the mean of blocks has the error of the mean."""
    simulation = Simulation("annulus")
    series = simulation.measure("kinetic_energy,force_y:Outer", duration=0.5, every=2)
    assert [row["step"] for row in series.rows] == [*range(0, 51, 2)]
    rows = [row["kinetic_energy"] for row in series.rows if row["time"] >= 0.1]
    assert series.average(after=0.1)["kinetic_energy"].mean == pytest.approx(np.mean(rows), rel=1e-12)
    rng = np.random.default_rng(1)
    series.rows = [
        {"time": float(k), "kinetic_energy": rng.normal(), "force_y:Outer": 1.0} for k in range(10_000)
    ]
    found = series.average(blocks=50)
    assert found["kinetic_energy"].error == pytest.approx(0.01, rel=0.3)  # of 50 blocks: off by 1 / 10
    assert found["force_y:Outer"] == (1.0, 0.0)
    with pytest.raises(InputError, match="blocks is 10: only 1 measurement from this time on"):
        series.average(after=9999.0)
    with pytest.raises(InputError, match="the scene has no wall 'lid'"):
        simulation.measure("force_x:lid")
