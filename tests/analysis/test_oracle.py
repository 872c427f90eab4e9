"""Areas and fractions of random scenes against points drawn at random: periods, sides and discs that move.

What is space is asked of the walls of a scene one by one, where they are by now; regions know nothing of it.
"""

from typing import Any

import numpy as np
import pytest

from warpgrains import Box, Disc, NoAreaError, Scene, Simulation, analysis
from warpgrains.base.arrays import BoolArray, FloatArray
from warpgrains.walls.rim import Rim

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
@pytest.mark.parametrize("seed", range(8))
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
