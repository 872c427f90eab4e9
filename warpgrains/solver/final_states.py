"""Final states of many scenes as arrays, because thousands of runs of a sweep end at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.scene.container import Container, container_of
from warpgrains.scene.walls import Annulus
from warpgrains.solver.forces import force_of

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.records import SceneRecords
    from warpgrains.solver.statistics import RunStatistics

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
    "met",
)
"""Fields of `RunStatistics` in `Counts`: those that the device counts, the wall time, and whether the end
criterion was met. The names begin with those of `last_steps.SUMS`, which commands that only read results do
not import: it imports Warp."""
Counts = Mapping[str, NDArray[Any]]
"""Statistics of the steps of m scenes, by `COUNTED`, shape (m,) each."""


class StackedGrains(NamedTuple):
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
    annulus: Annulus
    """The annulus of each scene; its radii are arrays [m], shape (m,)."""
    containers: Mapping[int, Container]
    """Containers of the scenes with walls other than discs, such as segments and rings, by number."""

    @classmethod
    def of(
        cls,
        scenes: Sequence[Scene],
        times: Sequence[float],
        position: FloatArray,
        velocity: FloatArray,
        spin: FloatArray,
        wall_force: FloatArray,
    ) -> Self:
        """Return the grains of scenes, whose driven walls are where they are at the times [s]."""
        radii: Any = np.array([[scene.radius_in, scene.radius_out] for scene in scenes]).T
        each = tuple(zip(scenes, times, strict=True))
        return cls(
            mass=np.array([scene.mass for scene in scenes]),
            radius=np.array([scene.radius for scene in scenes]),
            position=position,
            velocity=velocity,
            spin=spin,
            wall_force=wall_force,
            gravity=np.array([scene.gravity_at(time) for scene, time in each]),
            discs=np.array([scene.discs_at(time) for scene, time in each]),
            annulus=Annulus(*radii),
            containers={
                k: container_of(scene, time, position[k])
                for k, (scene, time) in enumerate(each)
                if any(wall.border is None or wall.border.keeps_inside for wall in scene.walls)
            },
        )


class FinalStates(NamedTuple):
    """Final states of m scenes with equal numbers of grains."""

    grains: StackedGrains
    dt: FloatArray
    """[s], shape (m,)."""
    done: Counts

    @classmethod
    def of(cls, scenes: Sequence[Scene], records: SceneRecords, which: IndexArray, done: Counts) -> Self:
        """Return the final states of scenes, those with the numbers `which` in the records."""
        host = records.host
        dt = host["dt"][which]
        names = ("position", "velocity", "contact_mass", *(("spin",) if records.sizes.friction else ()))
        position, velocity, contact_mass, *spin = (records.stacked(f"grains.{name}", which) for name in names)
        corrections = records.wall_corrections(which)
        wall_force = force_of(contact_mass[..., None], corrections, dt[:, None, None])
        times = (host["start_time"][which] + host["steps"][which] * dt).tolist()
        spins = spin[0] if spin else np.zeros(contact_mass.shape)
        grains = StackedGrains.of(scenes, times, position, velocity, spins, wall_force)
        return cls(grains, dt, done)


def counted(statistics: Sequence[RunStatistics]) -> Counts:
    """Return the statistics of runs as arrays."""
    return {name: np.array([getattr(one, name) for one in statistics]) for name in COUNTED}
