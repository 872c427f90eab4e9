"""What many scenes have come to, in arrays: thousands of runs end at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from numpy.typing import NDArray

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.scene.walls import Annulus

if TYPE_CHECKING:
    from warpgrains.solver.records import SceneRecords


class Grains(NamedTuple):
    """Grains of m scenes that have as many each: every array has the axis of the scenes first."""

    mass: FloatArray
    """[kg], shape (m, n)."""
    radius: FloatArray
    """[m], shape (m, n)."""
    position: FloatArray
    """[m], shape (m, n, 2)."""
    velocity: FloatArray
    """[m/s], shape (m, n, 2)."""
    wall_force: FloatArray
    """Force of each wall (0 outer, 1 inner, ...) on each grain [N], shape (m, n, walls)."""
    gravity: FloatArray
    """[m/s2], shape (m, 2)."""
    walls: Annulus
    """Its radii are arrays too [m], shape (m,)."""


class Ends(NamedTuple):
    """What m scenes with as many grains have come to."""

    grains: Grains
    dt: FloatArray
    """[s], shape (m,)."""
    done: Mapping[str, NDArray[Any]]
    """What their steps add up to, by names of fields of `RunStatistics`, shape (m,) each."""

    @classmethod
    def of(cls, records: SceneRecords, which: IndexArray) -> Self:
        """Return those of some scenes, as the host sees them."""
        host, sums = records.host, records.host["statistics"]
        contact_mass, dt = records.stacked("grains.contact_mass", which), host["dt"][which]
        radii: Any = (records.parameter(name, which) for name in ("radius_in", "radius_out"))
        grains = Grains(
            mass=records.stacked("grains.mass", which),
            radius=records.stacked("grains.radius", which),
            position=records.stacked("grains.position", which),
            velocity=records.stacked("grains.velocity", which),
            wall_force=contact_mass[..., None] * records.wall_corrections(which) / dt[:, None, None],
            gravity=host["gravity"][which],
            walls=Annulus(*radii),
        )
        return cls(grains, dt, {name: sums[name][which] for name in sums.dtype.names})
