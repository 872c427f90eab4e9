"""Random places for new grains in a region, where they overlap neither present grains nor walls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.base import checks
from warpgrains.base.errors import InputError
from warpgrains.scene.layouts import MOST_GRAINS
from warpgrains.scene.placing import place_at_random
from warpgrains.scene.radii import drawn_radii, listed_radii
from warpgrains.scene.sources import radius_named, space_of
from warpgrains.walls.bodies import with_images
from warpgrains.walls.disc import Disc
from warpgrains.walls.rim import Rim

if TYPE_CHECKING:
    from warpgrains.base.arrays import FloatArray, IndexArray
    from warpgrains.scene.scene import Scene
    from warpgrains.space.region import Region

TRIES = 1000  # places tried for one grain; enough to find most places in 1/200 of a region


@radius_named("radius")
def poured(
    now: Scene, count: int, radius: Any, density: float, region: Any, seed: tuple[int, int]
) -> dict[str, FloatArray]:
    """Return position [m], radius [m] and mass [kg], by name, of up to `count` grains that fit into `now`.

    The largest are placed first. If a grain finds no place in `TRIES` tries, no smaller one is tried.
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
    """Return the indices of the grains that a new grain of this radius [m], inside the region, may touch."""
    reach = now.radius + radius
    place, grain = now.period.images(now.position, reach + radius)
    low, high = space.box
    inside = (place > low - reach[grain, np.newaxis]) & (place < high + reach[grain, np.newaxis])
    return np.unique(grain[inside.all(axis=1)])
