"""Snapshots: grains and their contacts at one time, for analysis, pictures and recordings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, IndexArray, IntArray
from warpgrains.base.tables import dataset, library
from warpgrains.scene.gravity import upwards
from warpgrains.space.geometry import cross, left_of
from warpgrains.walls.container import Container, container_of
from warpgrains.walls.rim import Rim

if TYPE_CHECKING:
    import pandas
    import xarray

    from warpgrains.scene.scene import Scene

TABLES = ("grains", "contacts", "wall_contacts")
UNITS = {
    "time": "s",
    **dict.fromkeys(("x", "y", "radius"), "m"),
    **dict.fromkeys(("vx", "vy"), "m/s"),
    **dict.fromkeys(("force", "tangential_force"), "N"),
    "mass": "kg",
    "spin": "rad/s",
    "angle": "rad",
}


class WallLoads(NamedTuple):
    """Contacts with walls in the last step."""

    grain: IndexArray
    """Grain of each contact, shape (c,)."""
    wall: IndexArray
    """Index in `Scene.walls` of the wall of each contact, shape (c,)."""
    point: FloatArray
    """Where the grain touches the wall, at the start of the step [m], shape (c, 2)."""
    normal: FloatArray
    """Unit vectors into the wall, shape (c, 2)."""
    normal_force: FloatArray
    """Force along the normal [N], shape (c,), all > 0."""
    force: FloatArray
    """Force on the wall [N], shape (c, 2)."""
    moment: FloatArray
    """Moment of this force about the origin, counterclockwise [N m], shape (c,)."""


class Loads(NamedTuple):
    """Contact forces on single grains, c in all.

    First come the forces of all pairs on grain i, then of all pairs on grain j, then of all wall contacts.
    """

    grain: IndexArray
    """Loaded grain, shape (c,)."""
    normal: FloatArray
    """Unit vectors from the grain's center to the contact, shape (c, 2)."""
    force: FloatArray
    """Force on the grain against the normal [N], shape (c,), all > 0."""
    tangential_force: FloatArray
    """Force on the grain against the tangent, the normal rotated by 90 degrees to the left [N], (c,)."""


def _no_pairs() -> IntArray:
    return np.zeros((0, 2), np.int32)


def _no_forces() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshots:
    """Snapshots of m scenes with n grains each, as arrays whose first axis is that of the scenes."""

    scenes: Sequence[Scene]
    """The scenes, with walls that forces drive at their places at `time`."""
    time: Sequence[float]
    """Time of each scene [s]."""
    position: FloatArray
    """Centers of the grains [m], shape (m, n, 2)."""
    velocity: FloatArray
    """Velocities of the grains [m/s], shape (m, n, 2)."""
    spin: FloatArray
    """Angular velocities of the grains [rad/s], shape (m, n); 0 without friction."""

    @cached_property
    def mass(self) -> FloatArray:
        """Masses of the grains [kg], shape (m, n)."""
        return np.array([scene.mass for scene in self.scenes])

    @cached_property
    def radius(self) -> FloatArray:
        """Radii of the grains [m], shape (m, n)."""
        return np.array([scene.radius for scene in self.scenes])

    @property
    def _each(self) -> Iterator[tuple[Scene, float]]:
        return zip(self.scenes, self.time, strict=True)

    @cached_property
    def gravity(self) -> FloatArray:
        """Acceleration of gravity at `time` [m/s2], shape (m, 2)."""
        return np.array([scene.gravity_at(time) for scene, time in self._each])

    @cached_property
    def up(self) -> FloatArray:
        """Unit vectors against gravity, see `Scene.up_at`, shape (m, 2)."""
        return upwards(self.gravity, np.array([scene.period.repeats for scene in self.scenes]))

    @cached_property
    def circles(self) -> FloatArray:
        """Radii of the inner and the outer circle [m], shape (m, 2): 0 and NaN without them."""
        return np.array([scene.bodies.radii for scene in self.scenes])

    @cached_property
    def containers(self) -> Mapping[int, Container]:
        """Container of each scene that has a period, or walls other than circles, by index of the scene."""
        return {
            k: container_of(scene, time, self.position[k])
            for k, (scene, time) in enumerate(self._each)
            if scene.period or not all(isinstance(wall, Rim) for wall in scene.walls)
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshot:
    """Grains and contacts at one time, as returned by `snapshot` and `Recording.frame`.

    Contacts are those that carried a force during the last step; their normals are those at its start.

    Parameters
    ----------
    scene : Scene
        The scene, with walls that forces drive at their places at `time`.
    steps : int
        Time steps since the start.
    time : float
        Simulated time [s]. In a recording, it may lie within the last step.
    position, velocity : ndarray
        Centers [m] and velocities [m/s] of the grains, shape (n, 2).
    spin, angle : ndarray
        Angular velocities [rad/s], and angles since the start [rad], shape (n,); 0 without friction.
    start : ndarray
        Centers at the start of the last step [m], shape (n, 2).
    start_scene : Scene
        The scene of the last step, with walls that forces drive at their places at its start. In a
        recording it is `scene`, with these walls at their places in the frame.
    start_staggered : bool
        Whether velocities were half a step behind at the start of the last step, see `State.staggered`.
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
    places : ndarray or None
        Coordinates of walls [m], see `State.driven`, shape (walls,); None where no force drives a wall.
    births : ndarray or None
        Numbers of birth, see `State.id`.
    inflow, outflow : ndarray or None
        Grains that came and went so far, see `State`; None in recordings.
    recorded : mapping
        Values of the grains that a recording holds, such as the pressure, by name, shape (n,) each.

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
    spin: FloatArray
    angle: FloatArray
    start: FloatArray
    start_scene: Scene
    start_staggered: bool
    pair: IntArray = field(default_factory=_no_pairs)
    force: FloatArray = field(default_factory=_no_forces)
    wall: IntArray = field(default_factory=_no_pairs)
    wall_force: FloatArray = field(default_factory=_no_forces)
    tangential_force: FloatArray = field(default_factory=_no_forces)
    wall_tangential_force: FloatArray = field(default_factory=_no_forces)
    places: FloatArray | None = None
    births: IndexArray | None = None
    inflow: IndexArray | None = None
    outflow: FloatArray | None = None
    recorded: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """Number of grains."""
        return self.scene.n

    @property
    def id(self) -> IndexArray:
        """Numbers of birth of the grains, shape (n,)."""
        return np.arange(self.n) if self.births is None else self.births

    @property
    def start_time(self) -> float:
        """Time of the start of the last step [s]."""
        return self.start_scene.time_after(self.steps - 1)

    @cached_property
    def grains(self) -> Snapshots:
        """The grains as arrays for several scenes, with one scene."""
        return Snapshots(
            scenes=[self.scene],
            time=[self.time],
            position=self.position[np.newaxis],
            velocity=self.velocity[np.newaxis],
            spin=self.spin[np.newaxis],
        )

    @cached_property
    def images(self) -> tuple[FloatArray, IndexArray]:
        """Discs to draw: centers [m], shape (k, 2), and the grain of each, shape (k,).

        The first n are the grains, wrapped into a periodic box. Images follow: a grain that crosses a
        periodic side is drawn again at the opposite side.
        """
        return self.scene.period.images(self.position, self.scene.radius)

    @cached_property
    def container(self) -> Container:
        """The container of the grains."""
        return container_of(self.scene, self.time, self.position)

    @cached_property
    def normal(self) -> FloatArray:
        """Unit vectors from grain i to grain j of each pair, shape (m, 2)."""
        return self.start_scene.pair_frames(self.start, self.pair)[0]

    @cached_property
    def wall_normal(self) -> FloatArray:
        """Unit vectors into the wall of each contact with a wall, shape (k, 2)."""
        return self.start_scene.wall_frames(self.start, self.wall, time=self.start_time)[0]

    @cached_property
    def loads(self) -> Loads:
        """All contacts as forces on single grains."""
        (i, j), at_wall = self.pair.astype(np.int64).T, self.wall[:, 0].astype(np.int64)
        return Loads(
            np.concatenate([i, j, at_wall]),
            np.concatenate([self.normal, -self.normal, self.wall_normal]),
            np.concatenate([self.force, self.force, self.wall_force]),
            np.concatenate([self.tangential_force, self.tangential_force, self.wall_tangential_force]),
        )

    @cached_property
    def wall_loads(self) -> WallLoads:
        """Contacts with walls, with forces on the walls."""
        grain, wall = self.wall.astype(np.int64).T
        normal = self.wall_normal
        along, across = self.wall_force[:, np.newaxis], self.wall_tangential_force[:, np.newaxis]
        force = along * normal + across * left_of(normal)
        point = self.start[grain] + self.scene.radius[grain, np.newaxis] * normal
        return WallLoads(grain, wall, point, normal, self.wall_force, force, cross(point, force))

    def columns(self, table: str) -> dict[str, Any]:
        """Return the columns of a table, one of `TABLES`, as arrays by the name of the column."""
        if table == "grains":
            (x, y), (vx, vy) = self.position.T, self.velocity.T
            columns: dict[str, Any] = {} if self.births is None else {"id": self.births}
            columns |= {"x": x, "y": y, "vx": vx, "vy": vy, "radius": self.scene.radius}
            return columns | {"mass": self.scene.mass, "spin": self.spin, "angle": self.angle}
        if table == "contacts":
            names, ends, normal = ("i", "j"), self.pair, self.normal
            force, tangential = self.force, self.tangential_force
        else:
            names, ends, normal = ("grain", "wall"), self.wall, self.wall_normal
            force, tangential = self.wall_force, self.wall_tangential_force
        columns = dict(zip((*names, "normal_x", "normal_y"), (*ends.T, *normal.T), strict=True))
        return {**columns, "force": force, "tangential_force": tangential}

    def to_pandas(self, table: str = "grains") -> pandas.DataFrame:
        """Return grains or contacts as a DataFrame, in the units of the snapshot.

        Parameters
        ----------
        table : str
            ``"grains"``: x, y, vx, vy, radius, mass, spin, angle, after id where
            grains come and go; ``"contacts"``, those between grains: i, j,
            normal_x, normal_y, force, tangential_force; or ``"wall_contacts"``: grain, wall, and the same.

        Raises
        ------
        InputError
            The table is unknown, or pandas is not installed; the extra ``[data]`` installs it.
        """
        columns = self.columns(checks.one_of("table", table, TABLES))
        return library("pandas", "to_pandas").DataFrame(columns)

    def to_xarray(self, table: str = "grains") -> xarray.Dataset:
        """Return grains or contacts as a dataset with the columns of `to_pandas`, and units.

        Raises
        ------
        InputError
            The table is unknown, or pandas or xarray is not installed; the extra ``[data]`` installs them.
        """
        return dataset(self.to_pandas(table), UNITS)
