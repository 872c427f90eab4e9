"""Snapshots: grains and their contacts at one time, the input of all analysis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, overload

import numpy as np

from warpgrains.analysis.tabulated import TABLES, UNITS, columns_of
from warpgrains.arrays import FloatArray, IndexArray, IntArray
from warpgrains.scene import checks
from warpgrains.scene.container import Container, container_of
from warpgrains.scene.geometry import pair_normals
from warpgrains.solver.final_states import StackedGrains
from warpgrains.solver.forces import contacts_of, start_of_step
from warpgrains.tables import dataset, library

if TYPE_CHECKING:
    import pandas
    import xarray

    from warpgrains.scene.scene import Scene
    from warpgrains.scene.state import State


class HasState(Protocol):
    """Protocol of objects with a scene and a state, such as a `Simulation`."""

    @property
    def scene(self) -> Scene:
        """Scene of the state."""

    def state(self) -> State:
        """Return the present state."""


class Loads(NamedTuple):
    """Contacts as forces on single grains: those of pairs on i, then on j, then those of walls."""

    grain: IndexArray
    """Loaded grain, shape (c,)."""
    normal: FloatArray
    """Unit vectors from the grain's center to the contact, shape (c, 2)."""
    force: FloatArray
    """Force on the grain against the normal [N], shape (c,), all > 0."""
    tangential_force: FloatArray
    """Force on the grain against the tangent, the normal rotated by 90 degrees to the left [N], (c,)."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Grains and contacts at one time, as returned by `snapshot` and `Recording.frame`.

    Contacts are those that carried a force during the last step; their normals are those at its start.

    Parameters
    ----------
    scene : Scene
    steps : int
        Time steps since the start.
    time : float
        Simulated time [s]. In a recording, it may lie within the last step.
    position, velocity : ndarray
        Centers [m] and velocities [m/s] of the grains, shape (n, 2).
    start : ndarray
        Centers at the start of the last step [m], shape (n, 2).
    start_scene : Scene
        The scene of that step, with the walls that forces drive where they were; in a recording, `scene`,
        with these walls where they are in the frame.
    start_staggered : bool
        Whether velocities were half a step behind then, see `State.staggered`.
    pair : ndarray
        Grains i < j in contact, shape (m, 2).
    force : ndarray
        Force of each of these contacts [N], shape (m,), > 0.
    wall : ndarray
        Grain and wall of each contact with a wall, shape (k, 2), see `WallContacts`.
    wall_force : ndarray
        Force of each of these contacts [N], shape (k,), > 0.
    tangential_force, wall_tangential_force : ndarray
        Tangential force of these contacts [N], shapes (m,) and (k,), see `PairContacts` and `WallContacts`.
    spin, angle : ndarray
        Angular velocities [rad/s], and angles since the start [rad], shape (n,); 0 without friction.

    Examples
    --------
    >>> now = analysis.snapshot(simulation)
    >>> now.pair.shape, now.force.shape, now.wall_force.shape
    ((15, 2), (15,), (10,))
    """

    scene: Scene
    steps: int
    time: float
    position: FloatArray
    velocity: FloatArray
    start: FloatArray
    start_scene: Scene
    start_staggered: bool
    pair: IntArray
    force: FloatArray
    wall: IntArray
    wall_force: FloatArray
    tangential_force: FloatArray
    wall_tangential_force: FloatArray
    spin: FloatArray
    angle: FloatArray

    @property
    def n(self) -> int:
        """Number of grains."""
        return self.scene.n

    @property
    def end(self) -> float:
        """Time of the end of the last step [s], at which its walls that move are taken."""
        return self.start_scene.time_after(self.steps)

    @property
    def grains(self) -> StackedGrains:
        """Grains in the form for many runs, with one run."""
        wall_force = np.zeros((self.n, self.scene.wall_count))
        wall_force[*self.wall.T] = self.wall_force
        arrays = (self.position, self.velocity, self.spin, wall_force)
        return StackedGrains.of([self.scene], [self.time], *(array[np.newaxis] for array in arrays))

    @cached_property
    def container(self) -> Container:
        """The container of the grains."""
        return container_of(self.scene, self.time, self.position)

    @property
    def normal(self) -> FloatArray:
        """Unit vectors from grain i to grain j of each pair, shape (m, 2)."""
        return self.loads.normal[: len(self.pair)]

    def to_pandas(self, table: str = "grains") -> pandas.DataFrame:
        """Return grains or contacts as a DataFrame, in the units of the snapshot.

        Parameters
        ----------
        table : str
            ``"grains"``: x, y, vx, vy, radius, mass, spin, angle; ``"contacts"``, those between grains: i, j,
            normal_x, normal_y, force, tangential_force; or ``"wall_contacts"``: grain, wall, and the same.

        Raises
        ------
        InputError
            The table is unknown, or pandas is not installed; the extra ``[data]`` installs it.
        """
        columns = columns_of(self, checks.one_of("table", table, TABLES))
        return library("pandas", "to_pandas").DataFrame(columns)

    def to_xarray(self, table: str = "grains") -> xarray.Dataset:
        """Return grains or contacts as a dataset with the columns of `to_pandas`, and units.

        Raises
        ------
        InputError
            The table is unknown, or pandas or xarray is not installed; the extra ``[data]`` installs them.
        """
        return dataset(self.to_pandas(table), UNITS)

    @cached_property
    def loads(self) -> Loads:
        """All contacts as forces on single grains."""
        (i, j), at_wall = self.pair.astype(np.int64).T, self.wall[:, 0].astype(np.int64)
        normal = pair_normals(self.start, i, j)
        into_wall, _ = self.start_scene.wall_frames(self.start, self.wall, time=self.end)
        return Loads(
            np.concatenate([i, j, at_wall]),
            np.concatenate([normal, -normal, into_wall]),
            np.concatenate([self.force, self.force, self.wall_force]),
            np.concatenate([self.tangential_force, self.tangential_force, self.wall_tangential_force]),
        )


@overload
def snapshot(of: Snapshot | HasState) -> Snapshot: ...
@overload
def snapshot(of: Scene, state: State) -> Snapshot: ...
def snapshot(of: Any, state: State | None = None) -> Snapshot:
    """Return grains and contacts of a simulation as it is, or of a state of a scene.

    Parameters
    ----------
    of : Simulation, Scene or Snapshot
        A simulation; a scene, together with a state of it; or a snapshot, which is returned.
    state : State, optional
        State of the scene, for example from `Batch.state`.

    Examples
    --------
    >>> now = analysis.snapshot(simulation.scene, simulation.state())
    >>> analysis.kinetic_energy(now) == analysis.kinetic_energy(simulation)
    True
    """
    if isinstance(of, Snapshot):
        return of
    scene, state = (of.scene, of.state()) if state is None else (of, state)
    start, start_scene = start_of_step(scene, state)
    contacts, walls = contacts_of(scene, state)
    scene = scene.with_walls_at(None if state.driven is None else state.driven[:, 0])
    return Snapshot(
        scene=scene,
        steps=state.steps,
        time=scene.time_after(state.steps),
        position=state.position,
        velocity=state.velocity,
        start=start,
        start_scene=start_scene,
        start_staggered=state.last_staggered,
        pair=contacts.pair,
        force=contacts.force,
        wall=walls.wall,
        wall_force=walls.force,
        tangential_force=contacts.tangential_force,
        wall_tangential_force=walls.tangential_force,
        spin=np.zeros(scene.n) if state.spin is None else state.spin,
        angle=np.zeros(scene.n) if state.angle is None else state.angle,
    )
