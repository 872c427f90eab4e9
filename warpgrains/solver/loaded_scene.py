"""A scene in memory, at its present time."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.scene.scene import Scene
from warpgrains.scene.scheme import at_positions
from warpgrains.scene.state import State
from warpgrains.solver.forces import PairContacts, WallContacts, contacts_of
from warpgrains.solver.loading import driven_walls, load_state, scene_with_walls, state_of

if TYPE_CHECKING:
    from warpgrains.solver.records import SceneRecords


class LoadedScene:
    """Scene k of a `SceneRecords` (solver/records.py). The arrays of its state are read-only copies."""

    def __init__(self, records: SceneRecords, k: int):
        self._records, self._k = records, k

    def observed(self) -> AbstractContextManager[None]:
        """Return a context in which callbacks of a run can read the scene; here it does nothing."""
        return nullcontext()

    def replace_state(self, state: State) -> None:
        """Continue from a valid state."""
        load_state(self._records, self._k, state)

    @property
    def scene(self) -> Scene:
        """The scene as it was loaded, with its parameters, and its grains at the start."""
        return self._records.scenes[self._k]

    @property
    def steps(self) -> int:
        """Time steps since the start."""
        return int(self._records.host["steps"][self._k])

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.scene.time_after(self.steps)

    @property
    def position(self) -> FloatArray:
        """Centers of the grains [m], shape (n, 2); a read-only copy."""
        return self._grains("position")

    @property
    def velocity(self) -> FloatArray:
        """Velocities that moved the grains in the last step [m/s], shape (n, 2); a read-only copy.

        In the leapfrog scheme they belong to the middle of that step, half a step before the positions.
        """
        return self._grains("velocity")

    @property
    def spin(self) -> FloatArray:
        """Angular velocities of the grains [rad/s], shape (n,), as `velocity`; 0 without friction."""
        return self._grains("spin") if self.scene.has_friction else checks.frozen(np.zeros(self.scene.n))

    @property
    def angle(self) -> FloatArray:
        """Rotations of the grains since the start [rad], shape (n,); 0 without friction."""
        return self._grains("angle") if self.scene.has_friction else checks.frozen(np.zeros(self.scene.n))

    @property
    def id(self) -> IndexArray:
        """Numbers of birth of the grains, ascending, shape (n,); a number is never used twice."""
        number = self._records.populations[self._k].get("id")
        found = np.arange(self.scene.n) if number is None else number.copy()
        found.setflags(write=False)
        return found

    def _grains(self, name: str) -> FloatArray:
        return checks.frozen(self._records.array(self._k, f"grains.{name}")[: self.scene.n].copy())

    @property
    def last_staggered(self) -> bool:
        """True if velocities were half a step behind positions before the last step, as in `State`."""
        return bool(self._records.host["last_staggered"][self._k])

    @property
    def driven(self) -> FloatArray | None:
        """Coordinates [m] and speeds [m/s] of walls as in `State.driven`; None if no force drives a wall."""
        if not self.scene.has_driven_walls:
            return None
        return checks.frozen(driven_walls(self._records, self._k))

    @property
    def present_scene(self) -> Scene:
        """A scene that starts from the present state: its grains, its time, and its walls where they are.

        A simulation of it starts from scratch: without corrections, and with driven walls at rest. In the
        leapfrog scheme its velocities are those that grains have without contacts at the present, half a step
        after `velocity`.
        """
        now = scene_with_walls(self._records, self._k)
        velocity, spin = self.velocity, self.spin
        if self._records.host["staggered"][self._k]:
            velocity, spin = at_positions(now, velocity, spin, self.time)
        return now.placed(None, self.time, position=self.position, velocity=velocity, spin=spin)

    def contacts(self) -> PairContacts:
        """Return the contacts between grains that carry a correction after the last step."""
        return self.forces()[0]

    def wall_contacts(self) -> WallContacts:
        """Return the wall contacts of the last step that carry a correction."""
        return self.forces()[1]

    def forces(self) -> tuple[PairContacts, WallContacts]:
        """Return (contacts(), wall_contacts()), at the cost of one of these calls."""
        return contacts_of(self.scene, self.measured_state())

    def measured_state(self) -> State:
        """Return the state without lists of contacts, which suffices to measure it and takes less time."""
        return state_of(self._records, self._k, has_lists=False)

    def state(self) -> State:
        """Return the exact state. After `restore`, a simulation continues from it with the same bits."""
        return state_of(self._records, self._k)
