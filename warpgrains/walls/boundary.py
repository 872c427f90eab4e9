"""What makes walls of a scene, and its period: an annulus (annulus.py) or a box (box.py)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import LARGEST, SMALLEST, Period
from warpgrains.space.region import Region
from warpgrains.walls.container import space_of
from warpgrains.walls.wall import Wall


class Boundary:
    """The keys of `[domain]`, from which walls and a period are made when a scene is."""

    @property
    def size(self) -> str:
        """How large it is, as the beginning of a complaint."""
        raise NotImplementedError

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The walls at the start, which are the last ones of a scene."""
        raise NotImplementedError

    def owns(self, wall: Wall) -> bool:
        """Return whether a wall of the scene is one of the boundary."""
        raise NotImplementedError

    def among(self, walls: Sequence[Wall]) -> tuple[Wall, ...]:
        """Return walls and those of the boundary, which may be among them, at another place by now."""
        raise NotImplementedError

    def continuing(self, before: Boundary, walls: Sequence[Wall], time: float) -> Iterable[Wall]:
        """Return the walls, of which those as before are where the walls of a scene were at a time [s]."""
        raise NotImplementedError

    @property
    def period(self) -> Period:
        """The cell by whose images the scene continues."""
        raise NotImplementedError

    @property
    def space(self) -> Region:
        """The space at the start, in which layouts place grains."""
        return space_of(self.walls, self.period, self.reach)

    @property
    def reach(self) -> float:
        """Upper bound of the distance of places from the origin [m], from which rounding errors follow."""
        raise NotImplementedError

    @property
    def widest(self) -> float:
        """Diameter of the annulus, or longest side of the box [m]."""
        raise NotImplementedError

    def require_fits(self, radius: FloatArray) -> None:
        """Raise InputError unless grains of radii [m] fit."""
        raise NotImplementedError

    def require_size(self) -> None:
        """Raise InputError unless squares of distances neither overflow nor underflow."""
        if not SMALLEST <= self.reach <= LARGEST:
            raise InputError(
                f"{self.size}: it must be between {SMALLEST:g} and {LARGEST:g} m, for squares of distances to"
                " be finite and not zero; choose another unit of length"
            )
