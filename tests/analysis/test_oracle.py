"""Areas and fractions of random scenes against points drawn at random: periods, sides and discs that move.

What is space is asked of the walls of a scene one by one, where they are by now; regions know nothing of it.
"""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from moments import EPS, step_and_balance_forces
from trimmed import first_fast

from warpgrains import Arc, Box, Disc, NoAreaError, Scene, Segment, Simulation, analysis
from warpgrains.base.arrays import BoolArray, FloatArray
from warpgrains.walls.rim import Rim
from warpgrains.walls.wall import Wall

POINTS = 40_000
SIGMA = 5.0  # of counting, which one in two million counts exceeds
PERIODIC = ("", "x", "y", "xy", None)  # None: an annulus


def random_scene(rng: np.random.Generator, periodic: str | None) -> Scene:
    """Return a scene of which sides and discs move, some of them beyond the cell or across each other."""
    discs = [
        Disc(
            tuple(rng.uniform(-3.0, 5.0, 2) if periodic else rng.uniform(0.2, 0.8, 2)),
            float(rng.uniform(0.05, 0.2)),
            velocity=tuple(rng.uniform(-2.0, 2.0, 2)) if periodic else (0.0, 0.0),
        )
        for _ in range(rng.integers(0, 4))
    ]
    grains: dict[str, Any] = {"radius": 0.03, "mass": 1.0, "gravity": (0.0, 0.0), "dt": 0.01, "drag": 0.0}
    if periodic is None:
        grains |= {"radius_out": 1.0, "radius_in": 0.1 if rng.random() < 0.5 else 0.0}
    else:
        sides: dict[str, Any] = {}
        for name, way in (
            ("left", (-1.0, 0.0)),
            ("right", (1.0, 0.0)),
            ("bottom", (0.0, -1.0)),
            ("top", (0.0, 1.0)),
        ):
            kind = rng.integers(0, 3) if "xy"[way[0] == 0.0] not in periodic else 0
            if kind == 1:
                sides[name] = {"velocity": tuple(float(rng.uniform(0.0, 0.5)) * np.array(way))}
            elif kind == 2:  # it is driven outwards
                sides[name] = {"pressure": -float(rng.uniform(0.0, 2.0)), "mass": 1.0}
        grains["domain"] = Box((0.0, 1.0), (0.0, 1.2), periodic=periodic, **sides)
    at = rng.uniform(0.05, 0.95, (40, 2))
    probe = Scene(position=[[0.5, 0.5]], **grains)
    inside = is_space(probe, None, 0.0, at)
    for disc in discs:
        apart = nearest(at - disc.center, probe.period.lengths)
        inside &= np.hypot(*apart.T) > disc.radius
    return Scene(position=at[inside], walls=discs, **grains)


def nearest(way: FloatArray, period: FloatArray) -> FloatArray:
    """Return the shortest of ways and their images."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(period > 0.0, way - period * np.round(way / period), way)


def is_space(scene: Scene, driven: FloatArray | None, time: float, point: FloatArray) -> BoolArray:
    """Return which points are between circles and sides, and outside of discs, at a time [s]."""
    free = np.ones(len(point), bool)
    if scene.radius_out is not None:
        rho = np.hypot(*point.T)
        free &= (rho <= scene.radius_out) & (rho >= scene.radius_in)
    for number, wall in enumerate(scene.walls):
        place = np.array(wall.velocity) * time
        if isinstance(wall, Rim):
            continue
        if isinstance(wall, Disc):
            apart = nearest(point - wall.center - place, scene.period.lengths)
            free &= np.hypot(*apart.T) > wall.radius
        else:
            way = 0.0 if driven is None else driven[number, 0]
            free &= (point - wall.point - place) @ wall.normal >= way
    return free


@pytest.mark.parametrize("periodic", PERIODIC)
@pytest.mark.parametrize("seed", first_fast(range(8), 4))
def test_areas_are_those_of_points(seed: int, periodic: str | None) -> None:
    rng = np.random.default_rng([seed, PERIODIC.index(periodic)])
    scene = random_scene(rng, periodic)
    simulation = Simulation(scene)
    simulation.advance(int(rng.integers(1, 60)))
    time, driven = simulation.time, simulation.driven
    low, high = (
        (np.array([-1.0, -1.0]), np.array([1.0, 1.0]))
        if periodic is None
        else (np.zeros(2), np.array([1.0, 1.2]))
    )
    if periodic is not None:  # sides are at most this far outside
        grown = np.where(scene.period.repeats, 0.0, 2.0)
        low, high = low - grown, high + grown
    point = rng.uniform(low, high, (POINTS, 2))
    x = np.sort(rng.uniform(low[0], high[0], 2))
    y = np.sort(rng.uniform(low[1], high[1], 2))
    apart = [nearest(point - own, scene.period.lengths) for own in simulation.position]
    grain = np.any([np.hypot(*own.T) <= 0.03 for own in apart], axis=0)
    free, every = is_space(scene, driven, time, point), float(np.prod(high - low))
    for table in ({}, {"x": tuple(x)}, {"x": tuple(x), "y": tuple(y)}, {"below": float(y[1])}):
        inside = free.copy()
        if "x" in table:
            inside &= (point[:, 0] >= x[0]) & (point[:, 0] <= x[1])
        if "y" in table:
            inside &= (point[:, 1] >= y[0]) & (point[:, 1] <= y[1])
        if "below" in table:
            inside &= point @ scene.up_at(time) <= y[1]
        try:
            region = analysis.region_of(simulation, table)
        except NoAreaError:
            assert inside.mean() * every <= counting_error(0.0, every)
            continue
        assert inside.mean() * every == pytest.approx(region.area, abs=counting_error(region.area, every)), (
            table
        )
        assert (region.contains(point[:2000]) == inside[:2000]).all(), table
        filled = analysis.packing_fraction(simulation, region) * region.area
        error = counting_error(filled, every)
        assert (grain & inside).mean() * every == pytest.approx(filled, abs=error), table


def counting_error(area: float, every: float) -> float:
    """Return by how much the area of points may be off an area [m2], of at least nine points."""
    return SIGMA * np.sqrt(max(area * every, 9.0 * every**2 / POINTS) / POINTS)


@pytest.mark.parametrize("periodic", PERIODIC)
def test_cells_fill_the_container(periodic: str | None) -> None:
    for seed in range(4):
        rng = np.random.default_rng([seed, 7, PERIODIC.index(periodic)])
        simulation = Simulation(random_scene(rng, periodic))
        simulation.advance(20)
        area = analysis.region_of(simulation).area
        assert analysis.cell_areas(simulation).sum() == pytest.approx(area, rel=1e-9)


def random_obstacles(rng: np.random.Generator, periodic: str | None) -> list[Wall]:
    """Return segments, arcs and discs, anywhere in periodic directions, of which some move."""
    found: list[Wall] = []
    for _ in range(rng.integers(1, 4)):
        center = rng.uniform(-3.0, 4.0, 2) if periodic == "xy" else rng.uniform(0.2, 0.8, 2)
        moving: dict[str, Any] = {"velocity": tuple(rng.uniform(-0.5, 0.5, 2))} if rng.random() < 0.5 else {}
        kind, angle = rng.integers(0, 3), rng.uniform(0.0, 6.0)
        if kind == 0:
            half = 0.5 * rng.uniform(0.1, 0.9) * np.array([np.cos(angle), np.sin(angle)])
            found.append(Segment(tuple(center - half), tuple(center + half), **moving))
        elif kind == 1:
            arc = Arc(
                tuple(center), float(rng.uniform(0.15, 0.4)), angle, angle + rng.uniform(1.0, 5.0), **moving
            )
            found.append(arc)
        else:
            found.append(Disc(tuple(center), float(rng.uniform(0.05, 0.2)), **moving))
    return found


def distances(wall: Wall, time: float, point: FloatArray, period: FloatArray) -> FloatArray:
    """Return the distances of points from a wall or its nearest image at a time [m], shape (n,)."""
    shifts = [period * (i, j) for i in range(-6, 7) for j in range(-6, 7)]
    each = []
    for shift in np.unique(shifts, axis=0):
        x = point - shift - np.array(wall.velocity) * time
        if isinstance(wall, Segment):
            start, way = np.array(wall.start), np.subtract(wall.end, wall.start)
            share = np.clip((x - start) @ way / (way @ way), 0.0, 1.0)
            each.append(np.hypot(*(x - start - share[:, np.newaxis] * way).T))
        elif isinstance(wall, Arc):
            x = x - wall.center
            angle = np.mod(np.arctan2(x[:, 1], x[:, 0]) - wall.from_angle, 2.0 * np.pi)
            ends = [
                np.hypot(*(x - wall.radius * np.array([np.cos(end), np.sin(end)])).T)
                for end in (wall.from_angle, wall.to_angle)
            ]
            is_within = angle <= wall.to_angle - wall.from_angle
            each.append(np.where(is_within, np.abs(np.hypot(*x.T) - wall.radius), np.min(ends, axis=0)))
        else:
            assert isinstance(wall, Disc)
            each.append(np.hypot(*(x - wall.center).T) - wall.radius)
    return np.min(each, axis=0)


@pytest.mark.parametrize("periodic", PERIODIC)
@pytest.mark.parametrize("seed", first_fast(range(16), 6))
def test_contacts_are_those_of_distances(seed: int, periodic: str | None) -> None:
    """The overlap that a step reports is the largest of all distances, and forces change the momentum."""
    rng = np.random.default_rng([seed, 11, PERIODIC.index(periodic)])
    walls, at = random_obstacles(rng, periodic), rng.uniform(0.06, 0.94, (40, 2))
    fields: dict[str, Any] = {
        "radius": 0.03,
        "mass": 1.0,
        "dt": 0.01,
        "tolerance": 1e-3,
        "max_iterations": 200,
    }
    fields |= {"method": str(rng.choice(["gauss-seidel", "accelerated"])), "stop": "residual"}
    fields |= [{}, {"friction": 0.4}, {"restitution": 0.5}][rng.integers(0, 3)]
    if periodic is None:
        fields["radius_out"] = 1.0
    else:
        fields["domain"] = Box((0.0, 1.0), (0.0, 1.0), periodic=periodic)
    period = Scene(position=[[0.5, 0.5]], **fields).period.lengths
    free = np.all([distances(wall, 0.0, at, period) > 0.031 for wall in walls], axis=0)
    at = at[free & (np.hypot(*at.T) < 0.96) if periodic is None else free]
    kept: list[int] = []
    for k, x in enumerate(at):
        if all(np.hypot(*nearest(x - at[other], period)) > 0.061 for other in kept):
            kept.append(k)
    simulation = Simulation(
        Scene(position=at[kept], walls=walls, velocity=rng.normal(0.0, 1.0, (len(kept), 2)), **fields)
    )
    for _ in range(40):
        report = simulation.step()
        x = simulation.position
        i, j = np.triu_indices(len(x), 1)
        overlap = [0.0, *(0.06 - np.hypot(*nearest(x[i] - x[j], period).T))]
        overlap += [float((0.03 - distances(wall, simulation.time, x, period)).max()) for wall in walls]
        if periodic is None:
            overlap.append(float(np.hypot(*x.T).max()) - 0.97)
        for k in np.flatnonzero(period == 0.0) if periodic is not None else ():
            overlap.append(float(max(0.03 - x[:, k].min(), x[:, k].max() - 0.97)))
        assert report.overlap == pytest.approx(max(overlap), rel=0.0, abs=1e-14)
    found = step_and_balance_forces(simulation)
    assert sum(own.contacts for own in found.values()) == len(simulation.wall_contacts().wall)
    low = 0.0 if periodic is not None else -1.0
    cuts = [low, *np.sort(rng.uniform(low, 1.0, 2)).tolist(), 1.0]
    sums = []
    for one in ((low, 1.0), *pairwise(cuts)):
        region = analysis.region_of(simulation, {"x": one, "y": (low, 1.0)})
        sums.append(region.area * analysis.mean_stress(simulation, region, "contacts"))
    assert np.sum(sums[1:], axis=0) == pytest.approx(sums[0], rel=0.0, abs=1e2 * EPS * np.abs(sums).max())
