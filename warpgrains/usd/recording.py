"""`Recording`: the frames of a recorded run as snapshots and arrays."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from pxr import UsdGeom

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.base.errors import InputError
from warpgrains.base.shown import Shown, number_of
from warpgrains.base.tables import dataset, library
from warpgrains.drawing.chains import ChainScale, pairs_and_walls
from warpgrains.drawing.colorings import COLORINGS
from warpgrains.drawing.colors import ColorScale
from warpgrains.drawing.frames import FrameTimes
from warpgrains.drawing.looks import Look, Looks
from warpgrains.drawing.painter import Painter
from warpgrains.scene.compatibility import require_valid_positions
from warpgrains.scene.fields import SceneFields
from warpgrains.scene.scene import Scene
from warpgrains.scene.snapshot import TABLES, UNITS, Snapshot
from warpgrains.scene.toml import read_parameters
from warpgrains.space.geometry import Period
from warpgrains.usd.grains import (
    COLOR_INDICES,
    GRAINS,
    OF_GRAINS,
    PERIODS,
    VELOCITIES,
    numbers_of,
    position_of,
)
from warpgrains.usd.meshes import FORCES, GRAINS_OF, PLACES, TANGENTIAL, WALLS
from warpgrains.usd.stage import (
    RECORDED_BY,
    numbers,
    open_recording,
    refusing_untrusted_content,
    values_of,
)
from warpgrains.walls.box import checked_domain

if TYPE_CHECKING:
    import pandas
    import xarray

OF_START = ("position", "velocity", "spin")


class Recording(Shown):
    """The frames of a recording as arrays, which the file stores as float32.

    Parameters
    ----------
    path : str or Path
        A USD file that a run recorded.

    Attributes
    ----------
    path : Path
    time : ndarray
        Simulated time of each frame [s], shape (f,).
    radius : ndarray
        Radii of the grains [m], shape (n,); in scenes with sources or sinks, those of the first frame.

    Raises
    ------
    InputError
        The file is missing, is not USD, holds no frames of grains, or is damaged.

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
        with refusing_untrusted_content(self.path):
            self._open()
        self.time = self.times.begin + np.arange(len(self)) / self.times.rate

    def _open(self) -> None:
        self._stage = open_recording(self.path)
        prim = self._stage.GetPrimAtPath(GRAINS)
        if not (prim and (prim.IsA(UsdGeom.Points) or prim.IsA(UsdGeom.PointInstancer))):
            raise InputError(f"'{self.path}' holds no grains")
        codes = position_of(prim).GetTimeSamples()
        if not codes:
            raise InputError(f"'{self.path}' holds no frames")
        data = self._stage.GetRootLayer().customLayerData.get(RECORDED_BY)
        if data is None:
            raise InputError(f"'{self.path}' holds no scene: warpgrains has not recorded it")
        for frame, code in enumerate(codes):
            if code != frame:
                raise InputError(
                    f"'{self.path}' holds frame {frame} at time code {code:.17g}: it must be {frame}"
                )
        self._count = len(codes)
        parameters = read_parameters(str(data["parameters"]))
        self._parameters = parameters | {"name": str(data["name"]), "text": str(data["scene"])}
        self.scale = ColorScale.read(data["colors"]) if "colors" in data else None
        self.chain_scale = ChainScale.read(data["forces"]) if "forces" in data else None
        first_step = checks.whole_number("first_step", data["first_step"], least=0)
        self.look = Look(**dict(data["look"]))
        rate, slow = float(self._stage.GetTimeCodesPerSecond()), checks.positive("slow", data["slow"])
        start = checks.number("time", parameters.get("time", 0.0))
        self.times = FrameTimes.of(checks.positive("dt", parameters["dt"]), rate, first_step, start, slow)
        checks.number("time of the last frame", self.times.time(self._count - 1))
        box = checked_domain("domain", parameters.get("domain"))
        self._period = box.period if box else Period()
        self._of_grains = {name: prim.GetAttribute(own) for name, own in OF_GRAINS.items()}
        self._is_open = self._of_grains["radius"].GetNumTimeSamples() > 0
        own = self._is_open or self._period
        n = len(numbers(self._of_grains["radius"] if own else position_of(prim)))
        self._first = self._sizes(0, n)
        self.radius = self._first["radius"]
        self._attributes = numbers_of(prim)
        self._attributes |= {"position": position_of(prim), "velocity": prim.GetAttribute(VELOCITIES)}

    def _sizes(self, k: int, n: int) -> dict[str, FloatArray]:
        """Return the arrays "mass" [kg] and "radius" [m] of frame k, which has n grains."""
        return {
            name: checks.positive_per_grain(name, numbers(attribute, k), n)
            for name, attribute in self._of_grains.items()
        }

    def _sizes_at(self, k: int) -> dict[str, FloatArray]:
        """Return the arrays "mass" [kg] and "radius" [m] of the grains of frame k, shape (n,)."""
        if not self._is_open:
            return self._first
        with refusing_untrusted_content(self.path):
            return self._sizes(k, len(numbers(self._of_grains["radius"], k)))

    def _born(self, k: int) -> IndexArray | None:
        """Return the ids of the grains of frame k, shape (n,), which number them as they appear in the run.

        None if the scene has no sources and sinks.
        """
        if not self._is_open:
            return None
        with refusing_untrusted_content(self.path):
            n = len(self._sizes_at(k)["radius"])
            born = values_of(self._stage.GetPrimAtPath(GRAINS).GetAttribute("ids"), k)
            if born is None or len(born) < n or (np.diff(born[:n], prepend=-1) <= 0).any():
                raise ValueError(f"ids of frame {k} are not in ascending order, one for each grain")
            return born[:n].astype(np.int64)

    def summary(self) -> dict[str, str]:
        """Return the parts of the one-line summary that `repr` shows, by name."""
        return {
            self.path.name: f"of {number_of(len(self.radius), 'grain')}",
            "frames": f"{len(self)}",
            "time": f"{self.time[-1]:g} s",
            "forces": "recorded" if self.has_forces else "not recorded",
        }

    def __len__(self) -> int:
        return self._count

    @property
    def has_forces(self) -> bool:
        """True if contacts and their forces were recorded (``--forces``)."""
        return self.chain_scale is not None

    @cached_property
    def position(self) -> FloatArray:
        """Centers of the grains [m], shape (f, n, 2). They are not wrapped at periodic sides."""
        return self._of_all_frames("position")

    @cached_property
    def velocity(self) -> FloatArray:
        """Velocities of the grains [m/s], shape (f, n, 2)."""
        return self._of_all_frames("velocity")

    @cached_property
    def spin(self) -> FloatArray:
        """Angular velocities of the grains [rad/s], shape (f, n); 0 without friction."""
        return self._of_all_frames("spin")

    @cached_property
    def angle(self) -> FloatArray:
        """Angles by which grains have turned since the start [rad], shape (f, n); 0 without friction."""
        return self._of_all_frames("angle")

    def _of_all_frames(self, name: str) -> FloatArray:
        """Return the quantity `name` of all grains in all frames, shape (f, n) or (f, n, 2), see `_of_frame`.

        Raises InputError if the scene has sources or sinks, because frames have different grains.
        """
        if self._is_open:
            raise InputError(
                f"{name}: frames of '{self.path}' have different grains: use frame(k), or to_pandas"
            )
        return np.array([self._of_frame(name, k) for k in range(len(self))])

    def _of_frame(self, name: str, k: int) -> FloatArray:
        """Return the quantity `name`, such as "velocity", of all grains in frame k, shape (n,) or (n, 2).

        It is 0 if the recording does not hold this quantity.
        """
        attribute, n = self._attributes.get(name), len(self._sizes_at(k)["radius"])
        if attribute is None:
            return np.zeros(n)
        with refusing_untrusted_content(self.path):
            found = numbers(attribute, k)
            if self._period:  # images follow
                found = found[:n]
            if found.shape != ((n, 3) if name in ("position", "velocity") else (n,)):
                raise ValueError(f"{attribute.GetPath()} has shape {found.shape}, for {n} grains")
            if name == "position" and self._period:
                periods = numbers(self._stage.GetPrimAtPath(GRAINS).GetAttribute(PERIODS), k, (n, 2))
                return found[:, :2] + self._period.lengths * periods
            found = found[:, :2] if found.ndim == 2 else found
            return self.times.slow * found if name == "velocity" else found

    @cached_property
    def scene(self) -> Scene:
        """Scene whose start is the first frame: its time, the state of its grains, and the places of walls.

        Raises
        ------
        InputError
            The center of a grain is in a wall in the first frame.
        """
        scene, time = self.recorded_scene, self.times.time(0)
        if time != scene.time:
            scene = scene.placed(self.places(0), time)
        try:
            require_valid_positions(scene)
        except InputError as error:
            raise InputError(f"the first frame of '{self.path}' cannot start a simulation: {error}") from None
        return scene

    @cached_property
    def recorded_scene(self) -> Scene:
        """Scene of the run, with the grains as they are in the first frame, but the run's own start time.

        Unlike in `scene`, the centers of grains may lie in walls.
        """
        own = ("position", "velocity", *(("spin",) if "spin" in self._attributes else ()))
        grains = self._first | {name: self._of_frame(name, 0) for name in own}
        return Scene.made(vars(SceneFields(**grains, **self._parameters)))

    @property
    def levels(self) -> IndexArray:
        """Indices of the colors of the grains in the first frame, shape (n,)."""
        with refusing_untrusted_content(self.path):
            return numbers(self._stage.GetPrimAtPath(GRAINS).GetAttribute(COLOR_INDICES))[
                : len(self.radius)
            ].astype(int)

    def places(self, k: int) -> FloatArray | None:
        """Return the coordinate of each wall in frame k [m], shape (walls,), see `State.driven`.

        None if no wall of the scene is driven by a force.
        """
        with refusing_untrusted_content(self.path):
            places = self._stage.GetPrimAtPath(WALLS).GetAttribute(PLACES)
            return numbers(places, k) if places else None

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
        A frame does not show that `Simulation.change` gave the step before it another scene or time scheme.

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
        k, times = k % len(self), self.times
        grains: dict[str, Any] = {}
        for name in ("position", "velocity", "spin", "angle"):
            grains[name] = self._of_frame(name, k)
        places = self.places(k)
        own = {name: grains[name] for name in OF_START} | self._sizes_at(k) if self._is_open else {}
        scene, steps = self.recorded_scene.placed(places, **own), times.simulated_step(k)
        return Snapshot(
            scene=scene,
            steps=steps,
            time=times.time(k),
            **grains,
            start=grains["position"] - (times.dt - times.left(k)) * grains["velocity"],
            start_scene=scene,
            start_staggered=scene.scheme == "leapfrog" and steps > 1,
            places=places,
            births=self._born(k),
            recorded={name: self._of_frame(name, k) for name in COLORINGS if name in self._attributes},
            **(self._contacts(k) if contacts else {}),
        )

    def _contacts(self, k: int) -> dict[str, Any]:
        """Return the contacts of frame k as fields of a snapshot."""
        with refusing_untrusted_content(self.path):
            bands, n = self._stage.GetPrimAtPath(FORCES), len(self._sizes_at(k)["radius"])
            force = numbers(bands.GetAttribute("primvars:force"), k)
            tangential = np.zeros_like(force)
            if bands.HasAttribute(TANGENTIAL):
                tangential = numbers(bands.GetAttribute(TANGENTIAL), k, force.shape)
            ends = [numbers(bands.GetAttribute(f"primvars:{name}"), k, force.shape) for name in GRAINS_OF]
            if self._period:  # of the bands of a contact that leaves the box, the first one
                kept = np.sort(np.unique(ends, axis=1, return_index=True)[1])
                force, tangential, *ends = (own[kept] for own in (force, tangential, *ends))
            first, other = pair = np.array(ends, np.int32)
            last_wall = -len(self.recorded_scene.walls)
            if not ((first >= 0) & (first < n) & (last_wall <= other) & (other < n)).all():
                raise ValueError("a force chain names a grain or a wall that does not exist")
        between, pairs, walls = pairs_and_walls(pair.T)
        return {
            "pair": pairs,
            "force": force[between],
            "wall": walls,
            "wall_force": force[~between],
            "tangential_force": tangential[between],
            "wall_tangential_force": tangential[~between],
        }

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
        parts = [self.frame(k, contacts).columns(table) for k in range(len(self))]
        columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        frame = np.repeat(np.arange(len(self)), [len(next(iter(part.values()))) for part in parts])
        first = {"frame": frame, "time": self.time[frame]}
        return library("pandas", "to_pandas").DataFrame(first | columns)

    def to_xarray(self, table: str = "grains") -> xarray.Dataset:
        """Return grains or contacts of all frames as a dataset with the columns of `to_pandas`, and units.

        Grains have the dimensions time and grain. Contacts have one dimension, their row in the table. Where
        grains come and go, the grain is its number of birth, and numbers are NaN while it is not there.

        Raises
        ------
        InputError
            The table is unknown, contacts were not recorded, or pandas or xarray is not installed; the extra
            ``[data]`` installs them.
        """
        frame = self.to_pandas(table)
        if table == "grains":
            grain = frame.pop("id") if self._is_open else np.tile(np.arange(len(self.radius)), len(self))
            frame = frame.drop(columns="frame").assign(grain=grain).set_index(["time", "grain"])
        return dataset(frame, UNITS)


def painter_of(recording: Recording, **looks: Unpack[Looks]) -> Painter:
    """Return the painter that draws the frames of a recording.

    `looks` are fields of `Look` that replace those of the recording. Unless they change the colors, the
    scales of colors and forces are those of the recording. Raises InputError if the look needs contacts and
    the recording holds none.
    """
    own, look = recording.look, replace(recording.look, **looks)
    painter = Painter(recording.recorded_scene, look)
    if (look.color_by, look.colors, look.range) == (own.color_by, own.colors, own.range):
        painter.colors.scale = recording.scale
        if painter.colors.still is not None:
            painter.colors.still = recording.levels
    elif painter.colors.needs_contacts and not recording.has_forces:
        raise InputError(f"color_by {look.color_by!r} needs contacts: record them with --forces")
    if look.forces:
        if not recording.has_forces:
            raise InputError(f"'{recording.path}' holds no contacts: record them with --forces")
        painter.chain_scale = recording.chain_scale
    return painter
