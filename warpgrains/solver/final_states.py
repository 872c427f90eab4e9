"""Final states of many scenes as arrays, because thousands of runs of a sweep end at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.scene.snapshot import Snapshots
from warpgrains.solver.forces import force_of

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.records import SceneRecords


class FinalStates(NamedTuple):
    """Final states of m scenes with equal numbers of grains."""

    grains: Snapshots
    dt: FloatArray
    """[s], shape (m,)."""
    done: Mapping[str, NDArray[Any]]
    """Summaries of the steps by name, shape (m,) each (`statistics.stacked`, `LastSteps.stacked`)."""

    @classmethod
    def of(
        cls,
        scenes: Sequence[Scene],
        records: SceneRecords,
        which: IndexArray,
        done: Mapping[str, NDArray[Any]],
    ) -> Self:
        """Return the final states of scenes, those with the numbers `which` in the records."""
        host = records.host
        dt = host["dt"][which]
        names = ("position", "velocity", "contact_mass", *(("spin",) if records.sizes.friction else ()))
        position, velocity, contact_mass, *spin = (records.stacked(f"grains.{name}", which) for name in names)
        corrections = records.wall_corrections(which)
        wall_force = force_of(contact_mass[..., None], corrections, dt[:, None, None])
        times = (host["start_time"][which] + host["steps"][which] * dt).tolist()
        spins = spin[0] if spin else np.zeros(contact_mass.shape)
        grains = Snapshots.of(scenes, times, position, velocity, spins, wall_force)
        return cls(grains, dt, done)
