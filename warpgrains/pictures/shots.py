"""Shots: the contents of a picture of a simulation or of a frame of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from warpgrains.arrays import FloatArray
from warpgrains.drawing.chains import Chains, ChainScale, chains_of
from warpgrains.drawing.colors import ColorScale, GrainColors
from warpgrains.drawing.frames import Frame
from warpgrains.drawing.shapes import drawn_walls, moved_walls
from warpgrains.files import require_writable_path
from warpgrains.locks import Lock
from warpgrains.scene.band import Band

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.simulation.simulation import Simulation
    from warpgrains.usd.reader import RecordingReader


@dataclass(frozen=True)
class Setting:
    """Contents of a picture that are the same in all frames."""

    radius: FloatArray
    """Radii of the grains [m], shape (n,)."""
    walls: Mapping[str, Band]
    """Walls as drawn, by name."""
    scale: ColorScale | None
    chain_scale: ChainScale | None
    rotates: bool = False
    """Whether grains rotate, and have marks."""
    mobile: tuple[str, ...] = ()
    """Names of the mobile walls."""

    @property
    def reach(self) -> float:
        """Largest coordinate of a wall as drawn [m]."""
        return max(wall.reach for wall in self.walls.values())


@dataclass(frozen=True)
class Shot:
    """Contents of one frame."""

    time: float
    """Simulated time [s]."""
    position: FloatArray
    """Centers of the grains [m], shape (n, 2)."""
    color: FloatArray
    """Colors of the grains (sRGB), shape (n, 3)."""
    chains: Chains | None
    angle: FloatArray | None = None
    """By which grains have turned [rad], shape (n,); None where they do not rotate."""
    walls: Mapping[str, Band] = field(default_factory=dict)
    """The mobile walls as drawn now, by name."""


class Painter:
    """Maker of shots of a scene, colored by a quantity, with or without force chains.

    Parameters
    ----------
    scene : Scene
    color_by : str
        See `GrainColors`.
    forces : bool
        Whether to draw force chains.
    largest : float, optional
        Force of a chain of full width [N]. Divided by the diameter of a mean grain, it is the pressure of the
        last color. By default `ChainScale.of` estimates it from the scene.

    Raises
    ------
    InputError
        The coloring is unknown.
    """

    def __init__(self, scene: Scene, color_by: str, forces: bool, largest: float | None = None) -> None:
        self._scene = scene
        self._colors = GrainColors(scene, color_by)
        self.needs_contacts = forces or self._colors.needs_contacts
        chain_scale = ChainScale.of(scene) if forces else None
        if largest is not None:
            chain_scale = chain_scale and replace(chain_scale, force=largest)
            if color_by == "pressure":
                self._colors.scale = ColorScale(color_by, 0.0, largest / (2.0 * float(scene.radius.mean())))
        walls, mobile = drawn_walls(scene), tuple(moved_walls(scene, 0.0))
        scales = self._colors.scale, chain_scale
        self.setting = Setting(scene.radius, walls, *scales, scene.has_friction, mobile)

    def shot(self, frame: Frame) -> Shot:
        """Return a shot of a frame."""
        scale = self.setting.chain_scale
        chains = None if scale is None else chains_of(self._scene, scale, frame)
        angle = frame.rotation()[1] if self.setting.rotates else None
        walls = moved_walls(self._scene, frame.time, frame.places)
        return Shot(frame.time, frame.position, self._colors.of(frame), chains, angle, walls)

    def shot_of(self, simulation: Simulation) -> Shot:
        """Return a shot of the present state of a simulation of the scene."""
        return self.shot(Frame.of(simulation, self.needs_contacts))


class DrawnOutput(ExitStack):
    """Base of the film and the picture of a run, which is locked until the block ends.

    It replaces any file of its name when it is complete.

    Raises
    ------
    InputError
        It cannot be written. It is an `OutputError` if another process writes it.
    """

    def __init__(self, path: Path, painter: Painter) -> None:
        super().__init__()
        require_writable_path("output", path)
        self._path, self._painter, self.needs_contacts = path, painter, painter.needs_contacts
        self.enter_context(Lock(path))

    def flush(self) -> None:
        """Do nothing, because a run that is drawn cannot be continued."""


def setting_of(reader: RecordingReader) -> Setting:
    """Return the setting of a recording."""
    scales = reader.scale, reader.chain_scale
    return Setting(reader.radius, reader.walls, *scales, reader.has_rotation, tuple(reader.moved_walls(0)))


def shot_of(reader: RecordingReader, frame: int) -> Shot:
    """Return a shot of a frame of a recording."""
    chains = None if reader.chain_scale is None else reader.chains(frame)
    angle = reader.rotation(frame)[1] if reader.has_rotation else None
    shown = reader.position(frame), reader.color(frame)
    return Shot(reader.times.time(frame), *shown, chains, angle, reader.moved_walls(frame))
