"""Shots: the contents of a picture of a simulation or of a frame of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import reduce
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Self

from warpgrains.arrays import FloatArray
from warpgrains.drawing.chains import Chains, ChainScale, chains_of
from warpgrains.drawing.colors import ColorScale, GrainColors
from warpgrains.drawing.frames import Frame, FrameTimes
from warpgrains.drawing.shapes import drawn_walls, moved_walls
from warpgrains.drawing.views import view_of
from warpgrains.files import require_writable_path
from warpgrains.locks import Lock
from warpgrains.scene.band import Band
from warpgrains.scene.box import Box
from warpgrains.scene.extent import box_of_discs

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.simulation.options import RunOptions
    from warpgrains.simulation.simulation import Simulation
    from warpgrains.usd.reader import RecordingReader


@dataclass(frozen=True)
class Setting:
    """Contents of a picture that are the same in all frames."""

    radius: FloatArray
    """Radii of the grains [m], shape (n,)."""
    walls: Mapping[str, Band]
    """Walls as drawn, by name."""
    view: Box
    """The rectangle that is shown [m]."""
    scale: ColorScale | None
    chain_scale: ChainScale | None
    rotates: bool = False
    """Whether grains rotate, and have marks."""
    mobile: tuple[str, ...] = ()
    """Names of the mobile walls."""
    is_framed: bool = False
    """Whether the view was given."""

    @property
    def has_free_corners(self) -> bool:
        """Whether nothing is drawn in the corners, because they are outside of the outer wall."""
        return hypot(*self.view[:2]) > 1.3 * self.walls["Outer"].reach

    def covering(self, *shots: Shot) -> Self:
        """Return the setting with a view that contains all grains of shots, unless it was given."""
        boxes = [] if self.is_framed else [box_of_discs(shot.position, self.radius) for shot in shots]
        return replace(self, view=reduce(Box.covering, boxes, self.view))


@dataclass(frozen=True)
class Shot:
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
    """Maker of shots of a scene, colored as in `GrainColors`, with or without force chains.

    `largest` is the force of a chain of full width [N], by default estimated from the scene. Divided by the
    diameter of a mean grain, it is the pressure of the last color. `frame` is the rectangle to show, by
    default the extent of the scene.
    """

    def __init__(
        self,
        scene: Scene,
        color_by: str,
        forces: bool,
        largest: float | None = None,
        frame: str | None = None,
    ) -> None:
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
        same = scene.radius, walls, view_of(scene, frame), *scales, scene.has_friction, mobile
        self.setting = Setting(*same, is_framed=frame is not None)

    def shot(self, frame: Frame) -> Shot:
        scale = self.setting.chain_scale
        chains = None if scale is None else chains_of(self._scene, scale, frame)
        angle = frame.rotation()[1] if self.setting.rotates else None
        walls = moved_walls(self._scene, frame.time, frame.places)
        return Shot(frame.time, frame.position, self._colors.of(frame), chains, angle, walls)

    def shot_of(self, simulation: Simulation) -> Shot:
        """Return a shot of the present state of a simulation of the scene."""
        return self.shot(Frame.of(simulation, self.needs_contacts))


class DrawnOutput(ExitStack):
    """Base of the film and the picture of a run: locked until the block ends, it replaces any file."""

    def __init__(
        self, path: Path, scene: Scene, times: FrameTimes | None, options: RunOptions, *_: object
    ) -> None:
        super().__init__()
        require_writable_path("output", path)
        painter = Painter(scene, options.color_by, options.forces, frame=options.frame)
        self._path, self._painter, self._size = path, painter, options.pixels
        self.needs_contacts = painter.needs_contacts
        self.enter_context(Lock(path))

    def flush(self) -> None:
        """Do nothing, because a run that is drawn cannot be continued."""


def setting_of(reader: RecordingReader, frame: str | None = None) -> Setting:
    """Return the setting of a recording; for `frame`, see `Painter`."""
    same = reader.radius, reader.walls, view_of(reader.scene(), frame), reader.scale, reader.chain_scale
    mobile = tuple(reader.moved_walls(0))
    return Setting(*same, reader.has_rotation, mobile, is_framed=frame is not None)


def shot_of(reader: RecordingReader, frame: int) -> Shot:
    chains = None if reader.chain_scale is None else reader.chains(frame)
    angle = reader.rotation(frame)[1] if reader.has_rotation else None
    shown = reader.position(frame), reader.color(frame)
    return Shot(reader.times.time(frame), *shown, chains, angle, reader.moved_walls(frame))
