"""Layouts: initial positions and radii of the grains.

Each layout is a function whose keyword parameters are the keys of `[grains]`. Its first argument is the
domain as a region, an annulus or a box. A layout that avoids the walls of a scene takes these as `walls`, its
second argument. It raises InputError if a value is invalid or the grains do not fit.
"""

from collections.abc import Callable, Sequence
from math import floor, inf, sqrt
from typing import Any

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.base.errors import InputError, NoAreaError
from warpgrains.scene.placing import grow, place_at_random
from warpgrains.scene.radii import drawn_radii, listed_radii
from warpgrains.space.geometry import MOST_RADII, ROUNDING, distance
from warpgrains.space.region import Region, polygon, region_of
from warpgrains.walls.bodies import with_images
from warpgrains.walls.polyline import closed_corners
from warpgrains.walls.wall import Wall

MOST_GRAINS = 10_000_000
LEAST_SPACING, LARGEST_SPACING = 0.1, 1e12  # [radii]
MOST_ADDED = 0.54  # largest packing fraction of random sequential addition here; its limit is 0.547
MOST_GROWN = 0.82  # about the largest packing fraction of grains that grow and push each other apart

COMMON = {
    "count": "Number of grains.",
    "radius": "Radius of every grain [m].",
    "spacing": "Distance of neighbors, center to center, in radii.",
    "region": "Bounds of the grains [m], such as {x = [-1.0, 0.0], y = [-1.0, 0.5], distance = [0.5, 0.9]},"
    ' where "distance" is from the origin; or the name of a closed polyline. By default the whole domain.',
}
"""Keys that several layouts share, and their meanings."""

Placement = tuple[FloatArray, FloatArray]
"""Positions [m], shape (n, 2), and radii [m], shape (n,)."""


def rows(
    space: Region,
    *,
    count: int,
    radius: float,
    columns: int | None = None,
    spacing: float = 2.5,
    height: float = 2.0,
    shift: float = 0.0,
) -> Placement:
    """Place grains in rows above the inner disc, from the bottom up, as in the course's program.

    Each row is filled from left to right. In a box, rows begin above its lower side.

    Parameters
    ----------
    columns
        Grains per row; by default, the number that fits within the outer wall, or into the box.
    height
        Height of the centers of the lowest row above the inner disc, or the lower side of the box, in radii.
    shift
        Horizontal displacement of all grains [m]; a tiny one keeps a grain from balancing on the disc.
    """
    count, radius = _count(count), fitting_radius(space, radius)
    spacing = _spacing(spacing)
    height, shift = checks.number("grains.height", height), checks.number("grains.shift", shift)
    (left, bottom), (right, _) = space.box
    lowest = space.ring[0] if space.ring[1] < inf else bottom
    if columns is None:
        widths = _fitting_widths(space, count, radius, lowest + height * radius, spacing * radius)
    else:
        columns = checks.whole_number("grains.columns", columns)
        (first, _), (last, _) = _centers(space, radius)
        most = floor((last - first) / (radius * spacing) * (1.0 + ROUNDING)) + (not space.period.x)
        if columns > most:
            raise InputError(f"grains.columns is {columns}: at most {most} of these grains fit in a row")
        widths = np.full(-(-count // columns), columns)
    row = np.repeat(np.arange(len(widths)), np.minimum(widths, count))[:count]
    column = np.arange(count) - (np.cumsum(widths) - widths)[row]
    x = column * radius * spacing - (widths[row] - 1) * spacing / 2 * radius + shift + 0.5 * (left + right)
    y = row * radius * spacing + height * radius + lowest
    return np.column_stack([x, y]), np.full(count, radius)


def lattice(
    space: Region,
    walls: Sequence[Wall] = (),
    *,
    radius: float,
    count: int | None = None,
    spacing: float = 2.02,
    region: Any = None,
) -> Placement:
    """Place grains on a hexagonal lattice from the bottom up, each row from left to right.

    Sites that overlap a wall stay empty. By default the lattice is filled. In periodic directions, the
    spacing is increased until whole rows and columns fill the period.
    """
    space = _part(space, walls, region)
    radius = fitting_radius(space, radius)
    pitch = _spacing(spacing) * radius
    rise = pitch * sqrt(3.0) / 2.0
    (left, bottom), (right, top) = _centers(space, radius)
    width, height = right - left, top - bottom
    if (height / rise + 1) * (width / pitch + 3) > MOST_GRAINS:
        raise InputError(f"grains.radius is {radius} m: the lattice would have more than {MOST_GRAINS} sites")
    rows, half = floor(height / rise) + 1, floor(0.5 * width / pitch) + 1
    column = np.arange(-half, half + 1)
    if space.period.x:
        columns = floor(width / pitch)
        column, pitch = np.arange(columns) - 0.5 * columns, width / max(columns, 1)
    if space.period.y:
        rows = 2 * floor(height / (2.0 * rise))
        rise = height / max(rows, 1)
    row = np.arange(rows)[:, np.newaxis]
    x = (column + 0.5 * (row % 2)) * pitch + 0.5 * (left + right)
    y = np.broadcast_to(row * rise + bottom, x.shape)
    position = np.column_stack([x.ravel(), y.ravel()])
    (near, far), rho = space.ring, distance(position)
    is_inside = (rho <= far - radius) & (rho >= near + radius * (near > 0.0))
    if region is not None:
        is_inside &= space.contains(position) & (np.abs(position[:, 0] - 0.5 * (left + right)) <= 0.5 * width)
    position = position[is_inside]
    rounding = 0.0 if far < inf else 2.0 * ROUNDING * float(distance(space.box).max())  # at a side
    for wall in with_images(walls, space.period, radius):
        places = wall.places(position, space.period)
        position = position[wall.side(places, np.full(len(position), radius)).gap >= -rounding]
    if count is None:
        count = len(position)
    elif _count(count) > len(position):
        raise InputError(f"grains.count is {count}: only {len(position)} grains of radius {radius} m fit")
    return position[:count], np.full(count, radius)


def random_layout(
    space: Region,
    walls: Sequence[Wall] = (),
    *,
    radius: Any,
    count: int | None = None,
    packing_fraction: float | None = None,
    region: Any = None,
    seed: int = 0,
) -> Placement:
    """Place grains at random without overlaps. The same seed gives the same positions.

    Up to a packing fraction of about 0.5 grains are placed by random sequential addition. Above it they
    start small, grow and push each other apart, up to about 0.82.

    Parameters
    ----------
    space
        Space between the walls, such as `Box.space`.
    walls
        Walls inside, which grains do not overlap.
    radius
        Radius of every grain [m]; or the smallest and the largest of a uniform distribution; or three or
        more, one for each grain; or {file = "radii.csv"}, also .npz; or a table {distribution = ...} with the
        keys of its kind: uniform, normal, lognormal, power or values, see scene/radii.py.
    packing_fraction
        Fraction of the area of the region that the grains fill, instead of their count. Walls inside are not
        subtracted from the area.
    region
        Bounds of the grains [m], such as {x = [-1.0, 0.0], y = [-1.0, 0.5], distance = [0.5, 0.9]}, where
        "distance" is from the origin; or the name of a closed polyline. By default the whole domain.
    seed
        Seed of the random numbers.

    Returns
    -------
    tuple of ndarray
        Positions [m], shape (n, 2), and radii [m], shape (n,).

    Raises
    ------
    InputError
        An argument is invalid, or the grains do not fit.

    Examples
    --------
    >>> space = wg.Box((0.0, 1.0), (0.0, 1.0)).space
    >>> position, radius = wg.random_layout(space, radius=0.05, packing_fraction=0.5)
    >>> position.shape
    (63, 2)
    """
    if not isinstance(space, Region):
        raise InputError(f"space is {checks.shown(space)}: it must be a Region, such as Box(...).space")
    space = _part(space, walls, region)
    generator = np.random.default_rng(checks.whole_number("grains.seed", seed, least=0))
    radii = _random_radii(radius, count, packing_fraction, space, generator)
    for extreme in (radii.min(), radii.max()):
        fitting_radius(space, extreme)
    filled = float(np.pi * (radii**2).sum()) / space.area
    if filled >= 1.0:
        raise InputError(
            f"{_stated(count, packing_fraction)}: the grains have {filled:.3g} times the area of their"
            f" region: at most about {int(MOST_GROWN / filled * len(radii))} of these radii fit"
        )
    walls = with_images(walls, space.period, float(radii.max()))
    if filled <= MOST_ADDED:
        position = place_at_random(space, radii, generator, walls)
        if not np.isnan(position).any():
            return position, radii
    position, share = grow(space, radii, generator, walls)
    if share < 1.0:
        filled *= share * share
        raise InputError(
            f"{_stated(count, packing_fraction)}: grown and pushed apart, grains fill {filled:.3f} of their"
            f" region, so about {int(share * share * len(radii))} of these radii fit"
        )
    return position, radii


def _part(space: Region, walls: Sequence[Wall], region: Any) -> Region:
    """Return the part of a domain that a table of ranges [m], or the name of a closed polyline, selects."""
    if not isinstance(region, str):
        return region_of(space, region)
    found = space.within(polygon("grains.region", closed_corners("grains.region", region, walls)))
    if found.area <= 0.0:
        raise NoAreaError(f"grains.region is {region!r}: no point of this polyline lies in the domain")
    return found


def _random_radii(
    radius: Any, count: Any, fraction: Any, region: Region, generator: np.random.Generator
) -> FloatArray:
    """Return the radii that `radius` lists [m], or random radii according to `radius`, see `random_layout`.

    There are `count` random radii, or as many as fill at most `fraction` of the area of the region.
    """
    given = listed_radii(radius)
    if given is not None:
        if fraction is not None or count not in (None, len(given)):
            raise InputError(
                f"grains.radius is a list of {len(given)}: its length is the number of"
                " grains, so omit grains.count and grains.packing_fraction"
            )
        return given
    if (count is None) == (fraction is None):
        raise InputError("layout 'random' needs one of grains.count and grains.packing_fraction")
    draw, largest = drawn_radii(radius, generator)
    fitting_radius(region, largest)
    if fraction is None:
        return draw(_count(count))
    wanted = checks.positive("grains.packing_fraction", fraction) * region.area
    radii = np.empty(0)
    while (area := np.pi * np.cumsum(radii**2)).size == 0 or area[-1] < wanted:
        missing = 1.0 if area.size == 0 else (wanted - area[-1]) / area[-1]
        more = missing * max(len(radii), wanted / (np.pi * largest**2))
        radii = np.append(radii, draw(int(min(more + 1.0, MOST_GRAINS))))
        _count(len(radii))
    kept = int(np.searchsorted(area, wanted, side="right"))
    if kept == 0:
        raise InputError(
            f"grains.packing_fraction is {fraction}: one grain of radius {radii[0]} m fills more"
        )
    return radii[:kept]


def _stated(count: Any, fraction: Any) -> str:
    if fraction is None:
        return "grains.radius" if count is None else f"grains.count is {count}"
    return f"grains.packing_fraction is {fraction}"


def column(space: Region, *, count: int, radius: float, spacing: float = 2.02) -> Placement:
    """Place grains on top of each other, with equal spacing, above the lowest point of the domain."""
    count, radius = _count(count), fitting_radius(space, radius)
    spacing = _spacing(spacing)
    (left, bottom), (right, _) = space.box
    y = (np.arange(1, count + 1) * spacing - 1.0) * radius + bottom
    return np.column_stack([np.full(count, 0.5 * (left + right)), y]), np.full(count, radius)


LAYOUTS: dict[str, Callable[..., Placement]] = {
    "rows": rows,
    "lattice": lattice,
    "random": random_layout,
    "column": column,
}


def _count(value: Any) -> int:
    return checks.whole_number("grains.count", value, most=MOST_GRAINS)


def fitting_radius(space: Region, value: Any) -> float:
    """Check a radius [m] and return it. A grain must fit in the region, and float64 resolve its gaps."""
    radius, (low, high) = checks.positive("grains.radius", value), space.box
    near, far = space.ring
    widest = min(
        0.5 * (far - near) if near else far, *((high - low) * np.where(space.period.repeats, 0.25, 0.5))
    )
    if radius > widest or radius == far:
        raise InputError(f"grains.radius is {radius} m: such a grain does not fit between the walls")
    largest = far if far < inf else 2.0 * float(distance(space.box).max())
    if radius * MOST_RADII <= largest:
        least = largest / MOST_RADII
        raise InputError(f"grains.radius is {radius} m: it must be more than {least:.3g} m in this domain")
    return radius


def _spacing(value: Any) -> float:
    spacing = checks.positive("grains.spacing", value)
    if not LEAST_SPACING <= spacing <= LARGEST_SPACING:
        bounds = f"{LEAST_SPACING} and {LARGEST_SPACING:g}"
        raise InputError(f"grains.spacing is {spacing} radii: it must be between {bounds}")
    return spacing


def _centers(space: Region, radius: float) -> FloatArray:
    """Return the corners of the box in which centers of grains of this radius [m] may lie, shape (2, 2)."""
    margin = np.where(space.period.repeats, 0.0, radius)
    return space.box + np.array([margin, -margin])


def _fitting_widths(space: Region, count: int, radius: float, lowest: float, pitch: float) -> IndexArray:
    """Return how many grains of this radius [m] fit in each row at y = lowest + k pitch [m], k = 0, 1, ...

    The last row is the one with which the sum reaches `count`.
    """
    (left, bottom), (right, top) = _centers(space, radius)
    widths: list[int] = []
    while (missing := count - sum(widths)) > 0:
        y = lowest + len(widths) * pitch
        if not bottom <= y <= top:
            raise InputError(f"grains.count is {count}: only {count - missing} grains fit in the rows")
        length = 2.0 * sqrt(top * top - y * y) if space.ring[1] < inf else right - left
        fitting = floor(min(MOST_GRAINS, length / pitch))
        widths.append(fitting if space.period.x and fitting > 0 else 1 + fitting)
    return np.array(widths)
