"""`Recording`: the frames of a recorded run as arrays."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.analysis.snapshot import Snapshot
from warpgrains.analysis.tabulated import TABLES, UNITS, columns_of
from warpgrains.arrays import FloatArray
from warpgrains.drawing.chains import pairs_and_walls
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.compatibility import require_valid_positions
from warpgrains.scene.scene import Scene
from warpgrains.shown import Shown, number_of
from warpgrains.tables import dataset, library
from warpgrains.usd.reader import RecordingReader

if TYPE_CHECKING:
    import pandas
    import xarray


class Recording(Shown):
    """The frames of a recording as arrays; the file stores them as float32.

    Parameters
    ----------
    path : str or Path
        A USD file that a run recorded.

    Attributes
    ----------
    path : Path
    time : ndarray
        Time of each frame since the first one [s], shape (f,).
    radius : ndarray
        Radii of the grains [m], shape (n,).

    Raises
    ------
    InputError
        The file is missing, is not USD, holds no frames of grains, or has content that recordings do not
        have.

    Examples
    --------
    >>> recording = wg.Recording("annulus.usdc")
    >>> len(recording), recording.position.shape, recording.has_forces, recording.scene.n
    (97, (97, 15, 2), True, 15)
    >>> recording.frame(-1).force.shape  # one per contact
    (15,)
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(checks.path("path", path))
        self.reader = RecordingReader(self.path)
        self.time = np.array([self.reader.times.elapsed(k) for k in range(len(self))])
        self.radius = self.reader.radius

    def summary(self) -> dict[str, str]:
        """Return the fields of the one-line summary by name."""
        return {
            self.path.name: f"of {number_of(len(self.radius), 'grain')}",
            "frames": f"{len(self)}",
            "time": f"{self.time[-1]:g} s",
            "forces": "recorded" if self.has_forces else "not recorded",
        }

    def __len__(self) -> int:
        return len(self.reader)

    @property
    def has_forces(self) -> bool:
        """True if contacts and their forces were recorded (``--forces``)."""
        return self.reader.chain_scale is not None

    @cached_property
    def position(self) -> FloatArray:
        """Centers of the grains [m], shape (f, n, 2)."""
        return self._of_all_frames(self.reader.position)

    @cached_property
    def velocity(self) -> FloatArray:
        """Velocities of the grains [m/s], shape (f, n, 2)."""
        return self._of_all_frames(self.reader.velocity)

    @cached_property
    def spin(self) -> FloatArray:
        """Angular velocities of the grains [rad/s], shape (f, n); 0 without friction."""
        return self._of_all_frames(lambda k: self.reader.rotation(k)[0])

    @cached_property
    def angle(self) -> FloatArray:
        """Angles by which grains have turned since the start [rad], shape (f, n); 0 without friction."""
        return self._of_all_frames(lambda k: self.reader.rotation(k)[1])

    def _of_all_frames(self, read: Callable[[int], FloatArray]) -> FloatArray:
        return np.array([read(k) for k in range(len(self))])

    @cached_property
    def scene(self) -> Scene:
        """Scene of the run from its first frame, with its time, and grains and walls where they are then.

        Raises
        ------
        InputError
            In the first frame, the center of a grain is in a wall.
        """
        scene, time = self._recorded_scene, self.reader.times.time(0)
        if time != scene.time:
            scene = scene.with_walls_at(self.reader.places(0)).starting_at(time)
        try:
            require_valid_positions(scene)
        except InputError as error:
            raise InputError(f"the first frame of '{self.path}' cannot start a simulation: {error}") from None
        return scene

    @cached_property
    def _recorded_scene(self) -> Scene:
        return self.reader.scene()

    def frame(self, k: int, contacts: bool = True) -> Snapshot:
        """Return a frame as a snapshot, for `warpgrains.analysis`.

        Parameters
        ----------
        k : int
            Number of the frame; negative numbers count from the end.
        contacts : bool
            Whether to include contacts.

        Notes
        -----
        A frame knows neither another scene of the step before it, after `Simulation.change`, nor another
        time scheme.

        Raises
        ------
        InputError
            The frame does not exist, or contacts were not recorded.
        """
        checks.whole_number("frame", k, least=-checks.LARGEST_WHOLE_NUMBER)
        if not -len(self) <= k < len(self):
            raise InputError(f"frame {k} does not exist: '{self.path}' has {number_of(len(self), 'frame')}")
        if contacts and not self.has_forces:
            raise InputError(f"'{self.path}' holds no contacts: record them with --forces")
        k %= len(self)
        position, velocity = self.reader.position(k), self.reader.velocity(k)
        pair, force, tangential = np.zeros((0, 2), np.int32), np.zeros(0), np.zeros(0)
        if contacts:
            chains = self.reader.chains(k)
            pair, force, tangential = chains.pair, chains.force, chains.tangential_force
        between, pairs, walls = pairs_and_walls(pair)
        spin, angle = self.reader.rotation(k)
        scene = self._recorded_scene.with_walls_at(self.reader.places(k))
        times = self.reader.times
        steps = times.simulated_step(k)
        return Snapshot(
            scene=scene,
            steps=steps,
            time=times.time(k),
            position=position,
            velocity=velocity,
            start=position - times.time_in_step(k) * velocity,
            start_scene=scene,
            start_staggered=scene.scheme == "leapfrog" and steps > 1,
            pair=pairs,
            force=force[between],
            wall=walls,
            wall_force=force[~between],
            tangential_force=tangential[between],
            wall_tangential_force=tangential[~between],
            spin=spin,
            angle=angle,
        )

    def to_pandas(self, table: str = "grains") -> pandas.DataFrame:
        """Return grains or contacts of all frames as a DataFrame.

        Parameters
        ----------
        table : str
            ``"grains"``, ``"contacts"`` or ``"wall_contacts"``: the columns frame and time [s], and those of
            `Snapshot.to_pandas`.

        Raises
        ------
        InputError
            The table is unknown, contacts were not recorded, or pandas is not installed; the extra ``[data]``
            installs it.
        """
        contacts = checks.one_of("table", table, TABLES) != "grains"
        parts = [columns_of(self.frame(k, contacts), table) for k in range(len(self))]
        columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        frame = np.repeat(np.arange(len(self)), [len(next(iter(part.values()))) for part in parts])
        first = {"frame": frame, "time": self.time[frame]}
        return library("pandas", "to_pandas").DataFrame(first | columns)

    def to_xarray(self, table: str = "grains") -> xarray.Dataset:
        """Return grains or contacts of all frames as a dataset with the columns of `to_pandas`, and units.

        Grains have the dimensions time and grain, contacts are a list.

        Raises
        ------
        InputError
            The table is unknown, contacts were not recorded, or pandas or xarray is not installed; the extra
            ``[data]`` installs them.
        """
        frame = self.to_pandas(table)
        if table == "grains":
            grain = np.tile(np.arange(len(self.radius)), len(self))
            frame = frame.drop(columns="frame").assign(grain=grain).set_index(["time", "grain"])
        return dataset(frame, UNITS)
