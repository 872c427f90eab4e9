"""Quantities of a state against closed forms."""

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest
from moments import EPS

from warpgrains import Disc, Scene, Simulation
from warpgrains.analysis import height_profile, quantities, snapshot
from warpgrains.analysis.quantities import GROUPS, QUANTITIES, SWEEP_QUANTITIES
from warpgrains.scene.annulus import Annulus
from warpgrains.scene.geometry import area_below
from warpgrains.scene.gravity import upwards
from warpgrains.scene.snapshot import Snapshots

G = 9.81


def scene(position, **fields):
    return Scene(**{"radius": 0.1, "mass": 0.2, "radius_out": 1.0, **fields, "position": position})


def of(scene, velocity=None):
    state = Simulation(scene).state()
    state = state if velocity is None else replace(state, velocity=np.array(velocity))
    return quantities(snapshot(scene, state))


@pytest.mark.parametrize("n", [1, 2, 7, 8, 15, 50, 200])
def test_many_runs_at_once(n):
    """The same bits as of one run, and without a run in between."""
    generator = np.random.default_rng(n)
    m, share = 9, generator.uniform(0.0, 1.0, (9, 1))
    force = generator.uniform(size=(m, n, 2)) * (generator.random((m, n)) < share)[..., np.newaxis]
    gravity = generator.normal(size=(m, 2)) * (np.arange(m) > 0)[:, np.newaxis]
    grains = Snapshots(
        mass=generator.uniform(0.1, 3.0, (m, n)),
        radius=generator.uniform(0.01, 0.1, (m, n)),
        position=generator.uniform(-1.0, 1.0, (m, n, 2)),
        velocity=generator.normal(size=(m, n, 2)),
        spin=generator.normal(size=(m, n)),
        wall_force=force,
        gravity=gravity,
        up=upwards(gravity),
        discs=generator.uniform(0.0, 0.2, (m, 2, 3)),
        annulus=Annulus(np.linspace(0.0, 0.4, m), np.full(m, 1.5)),
        containers={},
    )
    for name, of_runs in SWEEP_QUANTITIES.items():
        together = of_runs(grains)
        assert together.shape == (m,)
        for k in range(m):
            annulus = Annulus(*(radii[k : k + 1] for radii in grains.annulus[:2]))
            one = Snapshots(*(array[k : k + 1].copy() for array in grains[:-2]), annulus, {})
            assert of_runs(one).item() == together[k], name


def test_energies():
    found = of(scene([[0.5, 0.0], [0.0, -0.5]], mass=[0.2, 0.4]), velocity=[[3.0, 4.0], [0.0, 1.0]])
    # a sum of two products of three factors each: a few roundings
    assert found["kinetic_energy"] == pytest.approx(0.5 * 0.2 * 25.0 + 0.5 * 0.4, rel=8 * EPS)
    assert found["potential_energy"] == pytest.approx(-0.4 * G * 0.5, rel=8 * EPS)
    assert [found[name] for name in GROUPS["speed"]] == [3.0, 5.0, 2.25]


@pytest.mark.parametrize(
    ("level", "share"),
    [
        (-2.0, 0.0),
        (-1.0, 0.0),
        (0.0, 0.5),
        (0.5, 1.0 - (1.0 / 3.0 - sqrt(3.0) / (4.0 * pi))),  # all but the cap of an angle of 120 degrees
        (1.0, 1.0),
        (3.0, 1.0),
    ],
)
def test_area_below_a_level(level, share):
    radius = np.array([1.0, 0.3, 20.0])
    # arcsin and the square root each lose some eps of the disc's area
    assert area_below(radius, level * radius) == pytest.approx(share * pi * radius**2, abs=8 * EPS * 400 * pi)


def test_half_a_disc_filled():
    """The mean height is that of the only grain: half of it is below, as is half of the annulus."""
    found = of(scene([[0.7, 0.0]], radius_in=0.5))
    assert found["packing_fraction"] == pytest.approx(0.1**2 / (1.0 - 0.5**2), rel=16 * EPS)


def test_the_middle_is_weighted_by_area():
    """Not by mass, and not by number."""
    fields = {"position": [[0.0, -0.5], [0.0, 0.3]], "radius": [0.1, 0.2]}
    light, heavy = of(scene(**fields)), of(scene(**fields, mass=[0.2, 20.0]))
    assert light["packing_fraction"] == heavy["packing_fraction"]
    middle = (0.01 * -0.5 + 0.04 * 0.3) / 0.05
    below = area_below(np.array([0.1, 0.2, 1.0]), np.array([middle + 0.5, middle - 0.3, middle]))
    assert light["packing_fraction"] == pytest.approx(below[:2].sum() / below[2], rel=16 * EPS)


def test_discs_inside_are_no_space():
    """A disc that moves up, of which half is below the mean height; rings fill none."""
    disc = Disc((0.0, -0.5), 0.2, velocity=(0.0, 5.0))
    simulation = Simulation(scene([[-0.5, 0.0], [0.5, 0.0]], walls=[disc], gravity=(0.0, 0.0)))
    assert quantities(simulation)["packing_fraction"] == pytest.approx(0.01 / (0.5 - 0.2**2))
    assert height_profile(simulation, bins=2).packing_fraction == pytest.approx([0.01 / (0.5 - 0.04), 0.02])
    simulation.advance(10)
    assert quantities(simulation)["packing_fraction"] == pytest.approx(0.01 / (0.5 - 0.2**2 / 2.0))


def test_height_is_against_gravity():
    """Turned by a right angle, together with gravity, nothing changes; without gravity, up is y."""
    places = np.array([[0.1, -0.7], [-0.3, 0.2], [0.5, 0.4]])
    upright = of(scene(places))
    turned = of(scene(places @ np.array([[0.0, 1.0], [-1.0, 0.0]]), gravity=(G, 0.0)))
    assert turned == upright
    weightless = of(scene(places, gravity=(0.0, 0.0)))
    assert weightless["pile_height"] == upright["pile_height"] == 0.4 + 0.1 + 1.0
    assert weightless["potential_energy"] == 0.0


def test_names_and_groups_in_order():
    now = snapshot(Simulation("annulus"))
    assert list(quantities(now)) == list(QUANTITIES)
    assert list(quantities(now, ["walls", "inner_wall_force"])) == ["outer_wall_force", "inner_wall_force"]
