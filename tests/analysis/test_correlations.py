"""Correlations of centers by kinds: a twin over all pairs, a lattice, sums over kinds."""

from itertools import product

import freud
import numpy as np
import pytest
from moments import EPS, far_away, moment_of, random_moment
from scipy.special import j0
from walled_scenes import chained, on_circle

from warpgrains import Box, Disc, analysis

RING = {"radius_in": 0.3}
IN_BOX = {"walls": chained(np.array([(-0.3, 0.4), (-0.3, -0.4), (0.3, -0.4), (0.3, 0.5)]))}
ON_DISC = RING | {"walls": [Disc((0.0, -0.6), 0.15), Disc((0.1, 0.1), 0.88, inside=True)]}
KITE = [(-0.9, -0.8), (0.9, -0.7), (0.8, 0.9), (-0.7, 0.6)]
LOWER = {"x": (-0.9, 0.9), "y": (-0.95, 0.0), "distance": (0.35, 0.97)}


def periodic(sides, gravity, **fields):
    return {"domain": Box((-0.7, 0.6), (-0.8, 0.9), periodic=sides), "gravity": gravity, **fields}


@pytest.mark.parametrize(
    ("fields", "count", "reach", "region", "left_out"),
    [
        (RING, 4000, 1.2, None, 1),
        (RING | {"gravity": (6.0, 3.0)}, 4000, 1.2, None, 1),
        (RING, 4000, 1.2, {}, 1),
        (RING, 4000, 1.2, LOWER, 1),
        (ON_DISC, 6000, 0.8, {"polygon": KITE}, 4),
        (ON_DISC, 6000, 0.8, {"angle": (-2.0, 2.0), "below": 0.5}, 4),
        (IN_BOX, 17_000, 0.4, None, 2),
        (periodic("", (0.0, 0.0)), 4000, 0.6, None, 2),
        (periodic("x", (6.0, -3.0)), 4000, 0.6, None, 2),
        (periodic("y", (0.0, -3.0)), 4000, 0.6, None, 2),
        (periodic("xy", (0.0, -3.0)), 4000, 0.6, None, 2),
        (periodic("x", (6.0, 0.0), walls=[Disc((-0.6, 0.1), 0.2)]), 4000, 0.5, {"x": (-0.7, 0.3)}, 2),
    ],
)
def test_points_at_random_have_g_of_one(fields, count, reach, region, left_out):
    """Up to the walls and beyond; k pairs of n grains deviate by about sqrt(k) and k / sqrt(n).

    Of some regions only 1 / `left_out` of the grains counts.
    """
    points = np.random.default_rng(4).uniform(-1.0, 1.0, (count, 2))
    space = moment_of([(0.0, 0.35)], **fields).container.region
    points = points[(points == space.period.wrapped(points)).all(axis=1) & (space.clearance(points) > 1e-3)]
    found = analysis.radial_distribution(far_away(moment_of(points, 0.001, **fields)), 20, reach, region)
    deviation = 1.0 / np.sqrt(np.maximum(found.pairs, 1)) + 1.0 / np.sqrt(len(points) / left_out)
    assert (np.abs(found.g - 1.0) < 3.0 * deviation)[found.pairs > 0].all()
    assert (found.pairs > 0).sum() >= 15


@pytest.fixture(scope="module")
def mixture():
    """Grains of many radii anywhere between the walls."""
    return random_moment(0.3, count=900, radius=[0.005, 0.02], seed=2)


LABELS = np.random.default_rng(5).integers(-1, 2, 900)


@pytest.mark.parametrize("region", [{}, {"angle": (-2.0, 1.0), "distance": (0.4, 0.9)}])
def test_pairs_by_kinds_are_those_of_a_twin(mixture, region):
    found = analysis.radial_distribution(mixture, 30, 0.3, region, LABELS)
    counted, radius = analysis.region_of(mixture, region), mixture.scene.radius
    inside = counted.contains(mixture.position)
    position, label = mixture.position[inside], LABELS[inside]
    apart = np.hypot(*(position[:, np.newaxis] - position).T)
    np.fill_diagonal(apart, np.inf)
    # centers reach the walls to within the smallest radius
    reached = {"distance": (0.3 + radius.min(), 1.0 - radius.min()), **region}
    space, circle = analysis.region_of(mixture, reached), on_circle(2.0 * np.pi * np.arange(2000) / 2000)
    middle = 0.5 * (found.edges[1:] + found.edges[:-1])
    for b in (3, 11, 29):
        share = space.contains(position[:, np.newaxis] + middle[b] * circle).mean(axis=1)
        density = 2.0 * np.pi * middle[b] * np.diff(found.edges)[b] / space.area
        for (i, one), (j, other) in product(enumerate(np.unique(LABELS)), repeat=2):
            of_one, of_other, twice = label == one, label == other, 1 + (i == j)
            between = apart[of_one][:, of_other]
            pairs = ((between >= found.edges[b]) & (between < found.edges[b + 1])).sum() // twice
            assert found.pairs[i, j, b] == pairs
            ways = share[of_one].sum() * (of_other.sum() - (i == j))
            ways += share[of_other].sum() * (of_one.sum() - (i == j))
            assert found.g[i, j, b] == pytest.approx(pairs / (density * ways / (2.0 * twice)), rel=2e-3)
    whole = analysis.radial_distribution(mixture, 30, 0.3, region)
    assert np.array_equal(found.pairs[np.triu_indices(3)].sum(axis=0), whole.pairs)


def test_classes_of_radii(mixture):
    """As many grains in each, ordered by radius; of few different radii, each is a class."""
    found, radius = analysis.radius_classes(mixture, 4), mixture.scene.radius
    assert np.bincount(found).tolist() == [225] * 4
    assert all(radius[found == k].max() < radius[found == k + 1].min() for k in range(3))
    of_count, of_labels = (analysis.radial_distribution(mixture, kinds=kinds) for kinds in (4, found))
    assert np.array_equal(of_count.pairs, of_labels.pairs)
    three = moment_of(mixture.position, np.repeat([0.003, 0.001, 0.002], [600, 200, 100]), radius_in=0.3)
    assert np.bincount(analysis.radius_classes(three, 3)).tolist() == [200, 100, 600]
    assert analysis.radius_classes(three, 1).tolist() == [0] * 900


@pytest.fixture(scope="module")
def dense():
    return random_moment(0.0, count=160, radius=0.04, seed=2)


def test_structure_factor_is_the_sum_over_pairs(dense):
    """Means over 200 directions are sums of Bessel functions, and those of freud, for k of any spacing."""
    k = np.array([3.0, 60.0, 20.0, 100.0, 100.5])
    found = analysis.structure_factor(dense, k, directions=200, region={})
    position = dense.position
    apart = np.hypot(*(position[:, np.newaxis] - position).T)
    assert found.k.tolist() == k.tolist()
    assert found.s == pytest.approx([j0(one * apart).sum() / dense.n for one in k], rel=1e-10)
    debye = freud.diffraction.StaticStructureFactorDebye(num_k_values=15, k_max=120.0, k_min=10.0)
    debye.compute((freud.box.Box.square(8.0), np.column_stack([position, np.zeros(dense.n)])))
    ours = analysis.structure_factor(dense, debye.k_values, directions=200, region={})
    assert ours.s == pytest.approx(np.array(debye.S_k), abs=1e-3)  # float32
    assert ours.s.max() > 1.3


def test_evenly_spaced_waves_are_those_computed_one_by_one(dense):
    """The default spacing, whose waves are products, in a region with more directions than one."""
    sector = {"angle": (0.0, 2.5)}
    found = analysis.structure_factor(dense, directions=5, region=sector)
    position = dense.position[analysis.grains_in(dense, sector)]
    phase = position @ on_circle(np.pi * np.arange(5) / 5).T
    sums = np.exp(-1j * found.k[:, np.newaxis, np.newaxis] * phase).sum(axis=1)
    assert found.s == pytest.approx((np.abs(sums) ** 2).mean(axis=1) / len(position), rel=1e-9)
    assert found.k[[0, -1]] == pytest.approx([np.pi, 100.0 * np.pi])


def test_of_no_grains_or_one_there_is_nothing(dense):
    assert np.isnan(analysis.structure_factor(dense, [1.0], region={"x": (0.0, 1e-6)}).s).all()
    assert not analysis.radial_distribution(moment_of([[0.5, 0.0]])).g.any()


def test_in_a_periodic_box_correlations_are_freuds():
    """Of overlapping grains at random, to the rounding of freud's float32 numbers.

    This is 6e-8 of phases up to 50, and of both edges of 30 bins.
    """
    places = np.random.default_rng(3).uniform(0.0, 1.0, (300, 2))
    tile = far_away(moment_of(places, domain=Box((0.0, 1.0), (0.0, 1.0), periodic="xy")))
    places = np.column_stack([places - 0.5, np.zeros(300)])
    rdf = freud.density.RDF(bins=30, r_max=0.45, normalization_mode="finite_size")
    rdf.compute((freud.box.Box.square(1.0), places))
    found = analysis.radial_distribution(tile, 30, 0.45)
    assert np.array_equal(found.pairs, rdf.bin_counts / 2)
    assert found.g == pytest.approx(rdf.rdf, rel=2 * 30 * 6e-8)
    for diagonal in (1, 3):  # the nearest waves are along the sides, and diagonals
        shells = 2.0 * np.pi * np.array([np.rint(diagonal * np.sqrt(2.0)), diagonal * np.sqrt(2.0)])
        theirs = []
        for k, mirrored in product(shells, (1.0, -1.0)):  # freud takes waves with no component below 0
            direct = freud.diffraction.StaticStructureFactorDirect(bins=1, k_max=k + 1e-3, k_min=k - 1e-3)
            direct.compute((freud.box.Box(1.0, 1.0, 1e-3), places * (mirrored, 1.0, 1.0)))
            theirs.append(direct.S_k.item())
        along, ours = (analysis.structure_factor(tile, shells, directions) for directions in (2, 4))
        assert along.s == pytest.approx(theirs[0], rel=1e-3)
        assert along.k == pytest.approx(shells[0], rel=4 * EPS)
        assert ours.s[1] == pytest.approx(np.mean(theirs), rel=1e-3)
        assert ours.k[1] == pytest.approx(shells.mean(), rel=4 * EPS)
