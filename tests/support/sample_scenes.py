"""Hard scenes: random ones, ones in which a step must be solved again, and ones that cannot fit."""

from collections.abc import Callable
from typing import Any

import numpy as np

from warpgrains import Scene
from warpgrains.base.arrays import FloatArray

SCENE_FILE = """
[domain]
radius_in = 0.5
radius_out = 1.0
[physics]
gravity = [0.0, -1.0]
drag = 0.25
[time]
dt = 0.125
duration = 2.0
[solver]
tolerance = 1e-3
max_iterations = 7
order = "color"
[grains]
position = [[0.75, 0.0], [0.0, 0.75]]
radius = [0.125, 0.25]
mass = 2.0
velocity = [1.0, 2.0]
"""
"""A scene file of two grains, with most keys."""


def random_scene(seed: int) -> Scene:
    """Return a scene of grains at random places between the walls, with any overlaps.

    Successive seeds cycle through eight kinds of scenes. The kinds are a fractional factorial design
    (2^(5-2)) of gravity, drag, inner wall, distinct radii and distinct masses: for every two of these five,
    all four combinations occur.
    """
    rng = np.random.default_rng(seed)
    gravity, drag, inner_wall = (bool(seed >> bit & 1) for bit in range(3))
    n = {7: 1, 0: 2, 1: 60}.get(seed) or int(rng.integers(2, 61))
    radius_in = rng.uniform(0.1, 0.4) if inner_wall else 0.0
    spread = rng.choice([0.5, 3.0, 6.0])
    mass = 10.0 ** (rng.uniform(-spread, spread, n) if gravity != inner_wall else np.full(n, -1.0))
    dt = rng.choice([0.01, 0.003])
    return Scene(
        position=_anywhere(rng, n, radius_in),
        velocity=rng.normal(0.0, 2.0, (n, 2)),
        radius=10.0 ** (rng.uniform(-3.0, -0.6, n) if gravity != drag else np.full(n, -1.0)),
        mass=mass,
        radius_in=radius_in,
        radius_out=1.0,
        gravity=tuple(rng.normal(0.0, 10.0, 2)) if gravity else (0.0, 0.0),
        drag=rng.uniform(0.0, 0.9) * mass.min() / dt if drag else 0.0,
        dt=dt,
        tolerance=rng.choice([0.0, 1e-6, 1e-3]),
        max_iterations=int(rng.choice([1, 10, 100])),
    )


def _anywhere(rng: np.random.Generator, n: int, radius_in: float) -> FloatArray:
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    return rng.uniform(radius_in, 1.0, (n, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def dense_start(seed: int, filled: float, **changes: Any) -> Scene:
    """Return 60 to 260 overlapping grains of radii 1:4 at random places in a disc of radius 1 m.

    `filled` is the sum of their areas, divided by that of the disc. `changes` replace fields.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(60, 260))
    radius = rng.uniform(0.25, 1.0, n)
    radius *= np.sqrt(filled / (radius @ radius))
    angle, distance = rng.uniform(0.0, 2.0 * np.pi, n), 0.8 * np.sqrt(rng.uniform(0.0, 1.0, n))
    return Scene(
        position=distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1),
        velocity=rng.normal(0.0, 1.0, (n, 2)),
        radius=radius,
        mass=100.0 * radius**2,
        radius_out=1.0,
        wall="round" if seed % 2 else "tangent",
        order="color",
    ).replace(**changes)


def bullet() -> Scene:
    """Return a grain of 100 m/s that crosses the domain in a few steps and hits a heap at the bottom."""
    heap = _heap(8, 6, spacing=0.11)
    velocity = np.vstack([[3.0, -100.0], np.zeros_like(heap)])
    return _sudden(np.vstack([[0.05, 1.7], heap]), velocity=velocity)


def explosion() -> Scene:
    """Return thirty grains at almost the same place, which reach a resting heap within one step."""
    crowded = np.random.default_rng(5).normal(0.0, 1e-3, (30, 2))
    mass = np.append(np.full(30, 0.3), np.full(32, 0.1))
    return _sudden(np.vstack([crowded, _heap(8, 4, spacing=0.11)]), mass=mass, drag=1.0)


def squeezed_light_grains() -> Scene:
    """Return grains of 1 mg between grains of 1 kg, which approach each other and squeeze them out."""
    heavy = np.array([[0.0, 0.3 * k - 1.0] for k in range(6)])
    light = np.array([[0.02 * (-1) ** k, 0.3 * k - 0.85] for k in range(5)])
    return _sudden(
        np.vstack([heavy, light, _heap(8, 3, spacing=0.11, x=0.5, y=-1.4)]),
        velocity=np.vstack([[[0.0, -4.0 * k] for k in range(6)], np.zeros((29, 2))]),
        radius=np.repeat([0.12, 0.03, 0.05], [6, 5, 24]),
        mass=np.repeat([1.0, 1e-6, 0.1], [6, 5, 24]),
    )


def falling_cloud() -> Scene:
    """Return grains that fall together at 60 m/s without relative motion, onto a wall and a heap."""
    position = np.vstack([_heap(8, 8, spacing=0.13, y=0.8), _heap(8, 3, spacing=0.11)])
    velocity = np.vstack([np.tile([5.0, -60.0], (64, 1)), np.zeros((24, 2))])
    return _sudden(position, velocity=velocity, radius_in=0.1)


def _sudden(position: FloatArray, **fields: Any) -> Scene:
    common = {"radius": 0.05, "mass": 0.1, "radius_out": 2.0, "tolerance": 1e-5, "max_iterations": 300}
    return Scene(position=position, **common | fields)


def _heap(columns: int, rows: int, spacing: float, x: float = 1e-3, y: float = -1.7) -> FloatArray:
    """Return a square lattice centered at x, from y upwards [m], shape (columns rows, 2)."""
    column, row = np.meshgrid(np.arange(columns) - (columns - 1) / 2.0, np.arange(rows))
    return np.stack([x + spacing * column.ravel(), y + spacing * row.ravel()], axis=1)


def chain(grains: int, overlap: float, **options) -> Scene:
    """Return a row of grains between the inner and the outer wall, which cannot fit.

    The sum of their diameters exceeds the distance between the walls by `overlap` [m].
    """
    radius = (0.5 + overlap) / (2 * grains)
    y = 0.5 + (np.arange(grains) + 0.5) * 0.5 / grains
    options = {"mass": 0.1, "max_iterations": 2000} | options
    return Scene(
        position=np.stack([0.0 * y, -y], axis=1), radius=radius, radius_in=0.5, radius_out=1.0, **options
    )


def ring(grains: int, too_large: float, **options) -> Scene:
    """Return a closed ring of equal grains between two walls, which touches both.

    Their radius is `too_large` times the radius with which the ring just fits.
    """
    fitting = np.sin(np.pi / grains) / (1.0 + np.sin(np.pi / grains))
    angle = 2.0 * np.pi * (np.arange(grains) + 0.3) / grains
    radius = too_large * fitting
    return _between_circles(angle, 1.0 - radius, radius, 1.0 - 2.0 * radius, **options)


def crowd(grains: int, area: float, **options) -> Scene:
    """Return random grains whose areas sum to `area` times the area between the walls."""
    rng = np.random.default_rng(0)
    radius = np.sqrt(area * (1.0 - 0.3**2) / grains)
    angle = rng.uniform(0.0, 2.0 * np.pi, grains)
    distance = np.sqrt(rng.uniform((0.3 + radius) ** 2, (1.0 - radius) ** 2, grains))
    return _between_circles(angle, distance[:, None], radius, 0.3, **options)


def _between_circles(
    angle: FloatArray, distance: FloatArray | float, radius: float, radius_in: float, **options: Any
) -> Scene:
    position = distance * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Scene(position=position, radius=radius, mass=0.1, radius_in=radius_in, radius_out=1.0, **options)


SUDDEN: tuple[Callable[[], Scene], ...] = (bullet, explosion, squeezed_light_grains, falling_cloud)
