"""Final states of many scenes as arrays, because thousands of runs of a sweep end at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.scene.walls import Annulus

if TYPE_CHECKING:
    from warpgrains.solver.records import SceneRecords

COUNTED = (
    "steps",
    "unconverged",
    "iterations",
    "rebuilds",
    "restarts",
    "iterations_max",
    "residual",
    "overlap",
    "seconds",
)
"""Fields of `RunStatistics` that `FinalStates.done` always holds: those that the device counts, and the
wall time."""


class Grains(NamedTuple):
    """Grains of m scenes with n grains each. The first axis of every array is that of the scenes."""

    mass: FloatArray
    """[kg], shape (m, n)."""
    radius: FloatArray
    """[m], shape (m, n)."""
    position: FloatArray
    """[m], shape (m, n, 2)."""
    velocity: FloatArray
    """[m/s], shape (m, n, 2)."""
    spin: FloatArray
    """[rad/s], shape (m, n); 0 without friction."""
    wall_force: FloatArray
    """Force of each wall (0 outer, 1 inner, ...) on each grain [N], shape (m, n, walls)."""
    gravity: FloatArray
    """As it is at the time [m/s2], shape (m, 2)."""
    discs: FloatArray
    """Center and radius of the disc that each wall inside the annulus fills at the time [m], see
    `Scene.discs_at`, shape (m, walls - 2, 3)."""
    walls: Annulus
    """The annulus of each scene; its radii are arrays [m], shape (m,)."""


class FinalStates(NamedTuple):
    """Final states of m scenes with equal numbers of grains."""

    grains: Grains
    dt: FloatArray
    """[s], shape (m,)."""
    done: Mapping[str, NDArray[Any]]
    """Sums and maxima over their steps, by field of `RunStatistics`, shape (m,) each: at least `COUNTED`."""

    @classmethod
    def of(cls, records: SceneRecords, which: IndexArray) -> Self:
        """Return the final states of some scenes from their host memory."""
        host, sums = records.host, records.host["statistics"]
        dt = host["dt"][which]
        radii: Any = records.parameter("radius_in", which), host["walls"]["annulus"]["radius_out"][which]
        spin = records.stacked("grains.spin", which) if records.sizes.friction else None
        mass = records.stacked("grains.mass", which)
        contact_mass = records.stacked("grains.contact_mass", which)
        grains = Grains(
            mass=mass,
            radius=records.stacked("grains.radius", which),
            position=records.stacked("grains.position", which),
            velocity=records.stacked("grains.velocity", which),
            spin=np.zeros_like(mass) if spin is None else spin,
            wall_force=contact_mass[..., None] * records.wall_corrections(which) / dt[:, None, None],
            gravity=records.gravity(which),
            discs=records.discs(which),
            walls=Annulus(*radii),
        )
        return cls(grains, dt, {name: sums[name][which] for name in sums.dtype.names})
