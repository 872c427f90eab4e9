"""Quantities of a state, and their profiles, against closed forms."""

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest
from moments import EPS, moment_of, random_moment
from walled_scenes import BOXES, boxed, cloud

from warpgrains import Disc, Scene, Simulation, analysis
from warpgrains.analysis import height_profile, quantities, snapshot
from warpgrains.analysis.quantity_table import GROUPS, QUANTITIES
from warpgrains.scene.snapshot import Snapshots
from warpgrains.space.geometry import area_below
from warpgrains.sweep.results import AT_THE_END

G = 9.81


def of(position, **fields):
    return quantities(moment_of(**{"radius": 0.1, "mass": 0.2, **fields, "position": position}))


SETS = {
    n: [cloud(n, radius_in=0.03 * k, angular_velocity_in=0.0, gravity=(k, -9.0 * k)) for k in range(7)]
    for n in (1, 2, 7, 8, 15, 50, 200)
}
SETS["boxes"] = [scene for scene in map(boxed, BOXES) if (scene.n, len(scene.walls)) == (60, 2)]


@pytest.mark.parametrize("scenes", SETS.values(), ids=SETS)
def test_many_runs_at_once(scenes):
    """The same bits as of one run."""
    rng, m, n = np.random.default_rng(0), len(scenes), scenes[0].n
    arrays = {
        "position": np.array([scene.position for scene in scenes]),
        "velocity": rng.normal(size=(m, n, 2)),
        "spin": rng.normal(size=(m, n)),
    }
    together = Snapshots(scenes=scenes, time=[0.1] * m, **arrays)
    assert m > 2
    for k, scene in enumerate(scenes):
        one = Snapshots(
            scenes=[scene], time=[0.1], **{name: array[k : k + 1] for name, array in arrays.items()}
        )
        for name in AT_THE_END:
            of_runs = QUANTITIES[name].function
            assert np.array_equal(of_runs(one)[0], of_runs(together)[k], equal_nan=True), name


def test_energies():
    masses = [0.2, 0.4]
    found = of([[0.5, 0.0], [0.0, -0.5]], mass=masses, velocity=[[3.0, 4.0], [0.0, 1.0]])
    # a sum of two products of three factors each: a few roundings
    assert found["kinetic_energy"] == pytest.approx(0.5 * 0.2 * 25.0 + 0.5 * 0.4, rel=8 * EPS)
    assert found["potential_energy"] == pytest.approx(-0.4 * G * 0.5, rel=8 * EPS)
    assert [found[name] for name in GROUPS["speed"]] == [3.0, 5.0, 2.25]


def test_grains_are_counted_and_weighed_by_their_centers():
    scene = Scene(
        position=[[0.5, 0.0], [0.0, -0.5], [0.0, 0.5]], radius=0.1, mass=[0.25, 0.5, 2.0], radius_out=1.0
    )
    whole, part = (quantities(Simulation(scene), ["grains"], region) for region in (None, {"y": (-0.6, 0.0)}))
    assert (whole, part) == ({"grain_count": 3, "grain_mass": 2.75}, {"grain_count": 2, "grain_mass": 0.75})


def test_area_below_a_level():
    level = np.array([-2.0, -1.0, 0.0, 0.5, 1.0, 3.0])
    half = 1.0 - (1.0 / 3.0 - sqrt(3.0) / (4.0 * pi))  # all but the cap of an angle of 120 degrees
    share = np.array([0.0, 0.0, 0.5, half, 1.0, 1.0])
    for r in (1.0, 0.3, 20.0):
        # arcsin and the square root each lose some eps of the disc's area
        assert area_below(np.full(6, r), level * r) == pytest.approx(share * pi * r**2, abs=3200 * pi * EPS)


def test_the_middle_is_weighted_by_area():
    """Not by mass, and not by number. The inner wall fills no space."""
    fields = {"position": [[0.0, -0.5], [0.0, 0.3]], "radius": [0.1, 0.2], "radius_in": 0.05}
    light, heavy = of(**fields), of(**fields, mass=[0.2, 20.0])
    assert light["pile_packing_fraction"] == heavy["pile_packing_fraction"]
    middle = (0.01 * -0.5 + 0.04 * 0.3) / 0.05
    level = np.array([middle + 0.5, middle - 0.3, middle, middle])
    lower, upper, space, inside = area_below(np.array([0.1, 0.2, 1.0, 0.05]), level)
    assert light["pile_packing_fraction"] == pytest.approx((lower + upper) / (space - inside), rel=16 * EPS)


def test_discs_inside_are_no_space():
    """A disc that moves up, of which half is below the mean height; rings fill none."""
    disc = Disc((0.0, -0.5), 0.2, velocity=(0.0, 5.0))
    now = moment_of([[-0.5, 0.0], [0.5, 0.0]], 0.1, walls=[disc], gravity=(0.0, 0.0))
    assert analysis.packing_fraction(now) == pytest.approx(0.02 / (1.0 - 0.2**2))
    assert analysis.pile_packing_fraction(now) == pytest.approx(0.01 / (0.5 - 0.2**2))
    assert height_profile(now, bins=2).packing_fraction == pytest.approx([0.01 / (0.5 - 0.04), 0.02])
    assert analysis.pile_packing_fraction(replace(now, time=0.1)) == pytest.approx(
        0.01 / (0.5 - 0.2**2 / 2.0)
    )


def test_height_is_against_gravity():
    """Turned by a right angle, together with gravity, nothing changes; without gravity, up is y."""
    places = np.array([[0.1, -0.7], [-0.3, 0.2], [0.5, 0.4]])
    upright = of(places)
    assert of(places @ np.array([[0.0, 1.0], [-1.0, 0.0]]), gravity=(G, 0.0)) == upright
    weightless = of(places, gravity=(0.0, 0.0))
    assert weightless["pile_height"] == upright["pile_height"] == 0.4 + 0.1 + 1.0
    assert weightless["potential_energy"] == 0.0


def test_names_and_groups_in_order():
    now = snapshot(Simulation("annulus"))
    assert list(quantities(now)) == [name for name in QUANTITIES if name not in GROUPS["flow"]]
    assert list(quantities(now, ["pile", "pile_height"])) == ["pile_packing_fraction", "pile_height"]
    assert list(quantities(now, "pile, rattlers")) == ["pile_packing_fraction", "pile_height", "rattlers"]


@pytest.mark.parametrize("profile", [analysis.height_profile, analysis.radial_profile])
def test_profile_of_a_shear_and_of_a_rigid_rotation(profile):
    """Which have no velocity along the profile; a rotation has no temperature."""
    now, rotates = random_moment(0.3, count=2000, radius=0.005, seed=5), profile is analysis.radial_profile
    x, y = now.position.T
    velocity = 3.0 * np.stack([-y, x] if rotates else [y, 0.0 * x], axis=1)
    found = profile(replace(now, velocity=velocity), bins=10)
    middle = 0.5 * (found.edges[1:] + found.edges[:-1])
    assert np.abs(found.velocity[:, 0]).max() <= (64 * EPS if rotates else 0.0)
    half = np.diff(found.edges)[0] / 2.0 + 0.005  # where in the slice the grains are, or reach into it from
    along = found.velocity[:, 1] * (1.0 if rotates else -1.0)
    assert np.abs(along - 3.0 * middle).max() < 3.0 * half
    assert not rotates or found.temperature.max() < 0.5 * (3.0 * half) ** 2


def test_temperature_of_random_velocities():
    """<v_x^2> = 4 m2/s2; the mean of k grains is known to about sqrt(1 / k) of itself."""
    now = random_moment(0.3, count=4000, radius=0.001)
    now = replace(now, velocity=np.random.default_rng(4).normal(0.0, 2.0, (now.n, 2)))
    assert analysis.granular_temperature(now) == pytest.approx(4.0, rel=5.0 / np.sqrt(now.n))
    found = analysis.radial_profile(now, bins=4)
    assert found.temperature == pytest.approx(4.0, rel=5.0 / np.sqrt(now.n / 10))


def test_empty_slices_have_no_mean():
    found = height_profile(moment_of([[0.0, -0.8]], 0.05), bins=4)
    assert found.packing_fraction[1:].tolist() == [0.0, 0.0, 0.0]
    assert np.isnan(found.velocity[1:]).all()
    assert found.packing_fraction[0] > 0.0
