"""The boundary of a scene: an annulus (annulus.py) or a box (box.py). It defines walls and the period."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import LARGEST, SMALLEST, Period
from warpgrains.space.region import Region
from warpgrains.walls.container import space_of
from warpgrains.walls.wall import Wall


class Boundary:
    """The keys of `[domain]` in a scene file: they define the outer walls of a scene, and its period."""

    @property
    def size(self) -> str:
        """Text that describes the size of the boundary. Error messages begin with it."""
        raise NotImplementedError

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The walls of the boundary at the start. In a scene, they come after other walls."""
        raise NotImplementedError

    def owns(self, wall: Wall) -> bool:
        """Return whether a wall of the scene belongs to the boundary."""
        raise NotImplementedError

    def among(self, walls: Sequence[Wall]) -> tuple[Wall, ...]:
        """Return `walls` and the walls of the boundary, each once.

        Walls of the boundary that `walls` contains already, perhaps at their places at a later time, are
        kept.
        """
        raise NotImplementedError

    def continuing(self, before: Boundary, walls: Sequence[Wall], time: float) -> Iterable[Wall]:
        """Return the walls of this boundary, which replaces boundary `before` at `time` [s].

        Walls equal in both boundaries keep their places at this time, as in `walls`. Others are at their
        start.
        """
        raise NotImplementedError

    @property
    def period(self) -> Period:
        """The periodic cell, whose images continue the scene."""
        raise NotImplementedError

    @property
    def space(self) -> Region:
        """The space at the start, in which layouts place grains."""
        return space_of(tuple(self.walls), self.period, self.reach)

    @property
    def reach(self) -> float:
        """Upper bound of the distance of positions from the origin [m], the scale of rounding errors."""
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
