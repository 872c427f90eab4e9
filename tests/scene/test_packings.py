"""Random packings: radii against scipy's distributions, places against what was asked for."""

import numpy as np
import pytest
from scipy import stats

from warpgrains import InputError, Scene
from warpgrains.scene.annulus import Annulus
from warpgrains.scene.layouts import random
from warpgrains.scene.radii import drawn_radii
from warpgrains.scene.region import Region, region_of

WALLS = Annulus(0.2, 1.0)
SPACE = Region(WALLS)
MANY = 20_000
SIGNIFICANCE = 1e-4  # a true draw is refused once in so many seeds: these are fixed

SCENE = """
[domain]
radius_in = 0.2
radius_out = 1.0
[grains]
layout = "random"
density = 10.0
"""


def draws(radius, count=MANY):
    return drawn_radii(radius, np.random.default_rng(5))[0](count)


def scene_of(placement):
    return Scene(position=placement[0], radius=placement[1], mass=1.0, **WALLS._asdict())


@pytest.mark.parametrize(
    ("radius", "expected"),
    [
        ([0.01, 0.05], stats.uniform(0.01, 0.04)),
        ({"distribution": "uniform", "smallest": 0.01, "largest": 0.05}, stats.uniform(0.01, 0.04)),
        ({"distribution": "normal", "mean": 0.02, "deviation": 0.003}, stats.norm(0.02, 0.003)),
        (
            {"distribution": "normal", "mean": 0.02, "deviation": 0.01, "smallest": 0.015, "largest": 0.03},
            stats.truncnorm(-0.5, 1.0, 0.02, 0.01),
        ),
        (
            {"distribution": "lognormal", "mean": 0.02, "deviation": 0.005},
            stats.lognorm(np.sqrt(np.log1p(0.25**2)), scale=0.02 * np.exp(-0.5 * np.log1p(0.25**2))),
        ),
        (
            {"distribution": "power", "exponent": 1.0, "smallest": 0.01, "largest": 0.1},
            stats.loguniform(0.01, 0.1),
        ),
        (
            {"distribution": "power", "exponent": 3.0, "smallest": 0.01, "largest": 0.1},
            stats.truncpareto(2.0, 10.0, scale=0.01),
        ),
    ],
)
def test_radii_have_their_distribution(radius, expected):
    assert stats.kstest(draws(radius), expected.cdf).pvalue > SIGNIFICANCE


def test_two_sizes_by_their_fractions():
    found = draws({"distribution": "values", "values": [0.02, 0.05], "fractions": [3.0, 1.0]})
    assert set(found) == {0.02, 0.05}
    assert stats.binomtest(int((found == 0.02).sum()), MANY, 0.75).pvalue > SIGNIFICANCE


@pytest.mark.parametrize("fraction", [0.3, 0.54, 0.6, 0.8])
@pytest.mark.parametrize("radius", [0.03, [0.02, 0.05]])
def test_a_packing_fraction_is_met_without_overlaps(fraction, radius):
    placement = random(SPACE, radius=radius, packing_fraction=fraction, seed=2)
    filled = np.pi * (placement[1] ** 2).sum() / WALLS.area
    assert fraction - np.pi * 0.05**2 / WALLS.area < filled <= fraction
    assert scene_of(placement).count_overlaps() == (0, 0, 0.0)
    assert np.array_equal(random(SPACE, radius=radius, packing_fraction=fraction, seed=2)[0], placement[0])


def test_large_discs_that_get_in_each_others_way_are_placed_again():
    """Some seeds leave the second no room until all are smaller."""
    for seed in range(12):
        position, radius = random(Region(Annulus(0.0, 1.0)), radius=[0.49, 0.49, 0.02], seed=seed)
        scene = Scene(position=position, radius=radius, mass=1.0, radius_out=1.0)
        assert scene.count_overlaps() == (0, 0, 0.0)


@pytest.mark.parametrize(
    "region",
    [
        {"x": [-0.4, 0.9]},
        {"y": [-2.0, 0.0]},
        {"distance": [0.5, 0.8]},
        {"x": [0.1, 0.6], "y": [0.1, 0.7], "distance": [0.3, 0.9]},
    ],
)
@pytest.mark.parametrize("fraction", [0.4, 0.7])
def test_grains_are_wholly_in_their_region(region, fraction):
    position, radius = random(SPACE, radius=[0.01, 0.02], packing_fraction=fraction, region=region)
    assert scene_of((position, radius)).count_overlaps() == (0, 0, 0.0)
    rho = np.hypot(*position.T)
    for key, value in {"x": position[:, 0], "y": position[:, 1], "distance": rho}.items():
        low, high = region.get(key, (-np.inf, np.inf))
        eps = 4 * np.finfo(float).eps  # of coordinates of 1 m
        assert (value - radius >= low - eps).all()
        assert (value + radius <= high + eps).all()
    area = region_of(SPACE, region).area
    assert np.pi * (radius**2).sum() / area == pytest.approx(fraction, abs=np.pi * 0.02**2 / area)


@pytest.mark.parametrize(
    ("layout", "keys"),
    [
        ("random", "radius = [0.02, 0.04]\ncount = 150"),
        ("random", "radius = [0.02, 0.04]\npacking_fraction = 0.6"),  # grown and pushed apart
        ("lattice", "radius = 0.03"),
    ],
)
def test_grains_are_clear_of_walls_inside_the_annulus(tmp_path, layout, keys):
    walls = """
    [[walls]]
    kind = "disc"
    center = [0.4, 0.5]
    radius = 0.15
    [[walls]]
    kind = "segment"
    from = [-0.9, 0.1]
    to = [0.1, -0.5]
    [[walls]]
    kind = "disc"
    inside = true
    center = [0.0, 0.0]
    radius = 0.95
    """
    path = tmp_path / "mine.toml"
    path.write_text(SCENE.replace('"random"', f'"{layout}"') + keys + walls)
    scene = Scene.load(path)
    assert scene.n >= 150
    assert scene.count_overlaps() == (0, 0, 0.0)


@pytest.mark.parametrize(
    "region", [None, {"x": [-0.1, 0.95]}, {"y": [0.5, 2.0], "distance": [0.6, 1.0]}, {"x": [0.0, 0.3]}]
)
def test_area_of_a_region(region):
    found = region_of(SPACE, region)
    low, high = found.box
    points = np.random.default_rng(0).uniform(low, high, (400_000, 2))
    rho = np.hypot(*points.T)
    inside = ((rho >= found.ring.radius_in) & (rho <= found.ring.radius_out)).mean()
    # five standard deviations of a share of so many points
    assert found.area / np.prod(high - low) == pytest.approx(inside, abs=2.5 / np.sqrt(len(points)))
    assert Region(WALLS).area == pytest.approx(WALLS.area, rel=1e-14)


def test_a_list_gives_each_grain_its_radius():
    radii = [0.05, 0.01, 0.02, 0.03]
    position, radius = random(SPACE, radius=radii)
    assert radius.tolist() == radii
    assert len(position) == 4


def test_radii_from_a_file(tmp_path):
    (tmp_path / "radii.csv").write_text("radius\n" + "\n".join(map(str, [0.05, 0.01, 0.02])) + "\n")
    np.savez(tmp_path / "radii.npz", radius=np.array([0.05, 0.01, 0.02]))
    for name in ("radii.csv", "radii.npz"):
        path = tmp_path / "mine.toml"
        path.write_text(SCENE + f'radius = {{file = "{name}"}}\n')
        assert Scene.load(path).radius.tolist() == [0.05, 0.01, 0.02]
    (tmp_path / "x.csv").write_text("mass\n1.0\n")
    (tmp_path / "empty.csv").write_text("radius\n")
    complaints = {"no.csv": "cannot be read", "x.csv": "has no radii", "empty.csv": "radius is an empty list"}
    for bad, complaint in complaints.items():
        path.write_text(SCENE + f'radius = {{file = "{bad}"}}\n')
        with pytest.raises(InputError, match=complaint):
            Scene.load(path)


@pytest.mark.parametrize("radii", [[0.05], [0.05, 0.01], [0.01, 0.05]])
def test_a_file_of_few_radii_is_no_range(tmp_path, radii):
    (tmp_path / "radii.csv").write_text("radius\n" + "\n".join(map(str, radii)) + "\n")
    (tmp_path / "mine.toml").write_text(SCENE + 'radius = {file = "radii.csv"}\n')
    assert Scene.load(tmp_path / "mine.toml").radius.tolist() == radii


def test_a_sweep_reads_radii_of_a_file(tmp_path):
    from warpgrains.sweep.sweep import Sweep

    (tmp_path / "radii.csv").write_text("radius\n0.05\n0.01\n0.02\n")
    (tmp_path / "mine.toml").write_text(SCENE + 'radius = {file = "radii.csv"}\n')
    (tmp_path / "sweep.toml").write_text('scene = "mine.toml"\n[axes]\ngrains.seed = [1, 2]\n')
    for run in Sweep.load(tmp_path / "sweep.toml").runs:
        assert "radius = [0.05, 0.01, 0.02]" in run.text("copies")
    (tmp_path / "radii.csv").write_text("radius\n0.01\n0.05\n")  # in a run's scene file it would be a range
    with pytest.raises(InputError, match=r"grains.radius: file 'radii.csv' has two radii"):
        Sweep.load(tmp_path / "sweep.toml")


def test_what_does_not_fit_says_what_would():
    with pytest.raises(
        InputError, match=r"packing_fraction is 0.95: .* so about \d+ of these radii fit"
    ) as caught:
        random(SPACE, radius=0.03, packing_fraction=0.95)
    fits = int(str(caught.value).partition("about ")[2].split()[0])
    assert scene_of(random(SPACE, radius=0.03, count=fits)).count_overlaps() == (0, 0, 0.0)
    assert fits * 0.03**2 * np.pi / WALLS.area > 0.7
    with pytest.raises(InputError, match="count is 2000: the grains have 1\\.87 times the area"):
        random(SPACE, radius=0.03, count=2000)


@pytest.mark.slow
def test_five_thousand_grains_fill_four_fifths():
    placement = random(
        SPACE, radius={"distribution": "lognormal", "mean": 0.012, "deviation": 0.003}, packing_fraction=0.8
    )
    assert len(placement[0]) > 4500
    assert scene_of(placement).count_overlaps() == (0, 0, 0.0)
