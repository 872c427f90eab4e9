"""Random places for further grains in a region, clear of grains and walls where they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.base import checks
from warpgrains.base.errors import InputError
from warpgrains.scene.layouts import MOST_GRAINS
from warpgrains.scene.placing import place_at_random
from warpgrains.scene.radii import drawn_radii, listed_radii
from warpgrains.scene.sources import space_of
from warpgrains.walls.bodies import with_images
from warpgrains.walls.disc import Disc
from warpgrains.walls.rim import Rim

if TYPE_CHECKING:
    from warpgrains.base.arrays import FloatArray, IndexArray
    from warpgrains.scene.scene import Scene
    from warpgrains.space.region import Region

TRIES = 1000  # places of one grain; few of those that fit into less than 1/200 of a region are missed


def poured(
    now: Scene, count: int, radius: Any, density: float, region: Any, seed: tuple[int, int]
) -> dict[str, FloatArray]:
    """Return position, radius and mass of those of `count` grains that fit, for a scene that starts now.

    The largest are placed first. When one finds no place in `TRIES`, neither do those after it.
    """
    generator = np.random.default_rng(seed)
    count = checks.whole_number("count", count, most=MOST_GRAINS)
    density = checks.positive("density", density)
    radii = listed_radii(radius)
    if radii is None:
        draw, largest = drawn_radii(radius, generator)
        space = space_of(now, region, largest)
        radii = draw(count)
    elif len(radii) != count:
        raise InputError(f"radius is a list of {len(radii)}: count is {count}")
    else:
        space = space_of(now, region, float(radii.max()))
    largest = float(radii.max())
    near = _near(now, space, largest)
    walls = [wall for wall in now.walls if wall.image is None and not isinstance(wall, Rim)]
    discs = zip(now.position[near].tolist(), now.radius[near].tolist(), strict=True)
    walls += [Disc(tuple(center), own) for center, own in discs]
    place = place_at_random(space, radii, generator, with_images(walls, space.period, largest), TRIES)
    found = ~np.isnan(place[:, 0])
    return {"position": place[found], "radius": radii[found], "mass": density * np.pi * radii[found] ** 2}


def _near(now: Scene, space: Region, radius: float) -> IndexArray:
    """Return the grains that a grain of a radius [m] in the region may touch."""
    reach = now.radius + radius
    place, grain = now.period.images(now.position, reach + radius)
    low, high = space.box
    inside = (place > low - reach[grain, np.newaxis]) & (place < high + reach[grain, np.newaxis])
    return np.unique(grain[inside.all(axis=1)])
