"""Still pictures: frames drawn on axes with equal scales, with legends and the time."""

from __future__ import annotations

import io
import pathlib
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import EllipseCollection, PolyCollection
from matplotlib.colors import ListedColormap, PowerNorm
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path
from numpy.typing import NDArray

from warpgrains.base.files import draft_of, require_writable_path
from warpgrains.base.locks import Lock
from warpgrains.drawing.chains import CHAIN_COLOR
from warpgrains.drawing.colorings import COLORINGS
from warpgrains.drawing.colors import PALETTE, mark_color
from warpgrains.drawing.kinds import STILLS
from warpgrains.drawing.painter import Painter
from warpgrains.drawing.shapes import WALL_COLOR, marks
from warpgrains.scene.snapshot import Snapshot
from warpgrains.space.bounds import Bounds
from warpgrains.walls.band import Band

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.simulation.options import RunOptions

_OUTLINE = 0.3  # line width [points]; less for small grains
_EDGE = (0.25, 0.2, 0.15)  # color of the outlines of grains (sRGB)
_LEAST_MARK = 5.0  # mean radius of grains with marks [pixels]
_CASING = 0.15  # width of the white border of a force chain, in widths of the chain
DOTS_PER_INCH = 120
_SIDE = 600  # pixels of the longer side of the axes in a picture of a simulation
_INCHES = 5.0  # the same length; text scales with the picture
_BAR_SHARE, _LEAST_SHARE = 0.2, 0.4  # of that length: for a color bar, and of the shorter side at least
_BAR: dict[str, Any] = {"fraction": 0.046, "pad": 0.02, "aspect": 30, "panchor": False}


class FrameArtists:
    """The Matplotlib artists of walls, grains, force chains and time on axes.

    They are made once; `show` changes them to draw another snapshot.
    """

    def __init__(self, axes: Axes, painter: Painter) -> None:
        self._painter = painter
        view, radius = painter.view, painter.scene.radius
        axes.set_axis_off()
        axes.set(xlim=(view.left, view.right), ylim=(view.bottom, view.top), aspect="equal")
        walls = painter.walls.items()
        self._walls = {name: PathPatch(_outline(w), color=WALL_COLOR, linewidth=0.0) for name, w in walls}
        for wall in self._walls.values():
            axes.add_patch(wall)
        self._grains = EllipseCollection(
            2.0 * radius,
            2.0 * radius,
            np.zeros(1),
            units="xy",
            offsets=np.zeros((len(radius), 2)),
            offset_transform=axes.transData,
            edgecolors=[_EDGE],
        )
        self._marks = PolyCollection([], linewidths=0.0)
        self._chains = PolyCollection([], facecolors=[CHAIN_COLOR], edgecolors="white")
        window = axes.get_window_extent()
        pixels = self._pixels = min(window.width / view.width, window.height / view.height)
        self._points = 72.0 * pixels / axes.figure.dpi
        side = "top" if painter.has_free_corners else "bottom"
        size = 4.0 + 1.2 * max(window.width, window.height) / axes.figure.dpi  # points
        text: dict[str, Any] = {"va": side, "color": painter.ink, "fontsize": size}
        self._time = axes.text(0.0, 1.0, "t", transform=axes.transAxes, **text)
        self._time.set_visible(not painter.look.clean)
        self._has_marks = painter.scene.has_friction
        marks = [self._marks] if self._has_marks else []
        collections = self._grains, *marks, self._chains
        for collection in collections:
            axes.add_collection(collection, autolim=False)
        mobile = [self._walls[name] for name in painter.moved_walls(painter.scene, 0.0)]
        self.changing: tuple[Any, ...] = *mobile, *collections, self._time
        """Artists that `show` changes, from back to front."""
        if not painter.look.clean:
            _add_legends(axes, painter, size)

    def show(self, now: Snapshot) -> None:
        """Draw a snapshot, replacing the last one."""
        for name, wall in self._painter.moved_walls(now.scene, now.time).items():
            self._walls[name].set_path(_outline(wall))
        (places, grain), chains = now.images, self._painter.chains(now)
        color, radius = self._painter.color(now)[grain], now.scene.radius[grain]
        width = 2.0 * radius
        line = np.minimum(_OUTLINE, 6.0 * radius / self._painter.view.half)
        self._grains.set(offsets=places, facecolor=color, widths=width, heights=width, linewidth=line)
        if self._has_marks:
            marked = slice(None if now.scene.radius.mean() * self._pixels >= _LEAST_MARK else 0)
            turned = marks(places[marked], radius[marked], now.angle[grain[marked]])
            self._marks.set(verts=turned, facecolor=mark_color(color[marked]))
        if chains is not None:
            casing = _CASING * self._points * chains.width
            self._chains.set(verts=chains.corners, linewidth=casing)  # one array is set fastest
        time = float(f"{now.time:.12g}")  # without the rounding of its computation, which differs by output
        self._time.set_text(f"t = {time:.3g} s" if 0.0 < time < 0.1 else f"t = {time:.2f} s")


def _outline(wall: Band) -> Path:
    return Path.make_compound_path_from_polys(wall.outlines())


def add_color_bar(figure: Figure | SubFigure, axes: Any, painter: Painter) -> None:
    """Draw a color bar with unit and range next to axes, if the painter's colors have a scale."""
    scale = painter.colors.scale
    if scale is None or painter.look.clean:
        return
    norm = PowerNorm(0.5 if COLORINGS[scale.quantity].has_root else 1.0, scale.low, scale.high)
    mapped = ScalarMappable(norm, ListedColormap(scale.colors()))
    extends = "both" if painter.look.range else COLORINGS[scale.quantity].extends
    bar = figure.colorbar(mapped, ax=axes, extend=extends, **_BAR)
    bar.set_label(scale.label, fontsize="small", color=painter.ink)
    bar.ax.tick_params(labelsize="small", width=0.5, colors=painter.ink)
    bar.outline.set(linewidth=0.5, edgecolor=painter.ink)


def _add_legends(axes: Axes, painter: Painter, size: float) -> None:
    """Draw bars with texts of a `size` [points]: a length, the colors of speeds, the width of force chains.

    They are in corners of the axes if no grains can be there, otherwise below and above the axes.
    """
    view, half, speed, scale = painter.view, painter.view.half, painter.top_speed, painter.chain_scale
    digit = 10.0 ** np.floor(np.log10(0.3 * half))
    length = digit * max(k for k in (1, 2, 5) if k * digit <= 0.3 * half)
    bars: list[Any] = [(1, -1, length, 0.012 * half, f"{length:g} m", [painter.ink])]
    if speed > 0.0:
        colors = painter.heated(np.tile(PALETTE.mean(axis=0), (32, 1)), np.linspace(0.0, speed, 32))
        bars.append((1, 1, 0.2 * half, 0.04 * half, f"speed 0 to {_rounded(speed)} m/s", colors))
    if scale is not None:
        bars.append((-1, -1, 0.12 * half, scale.width, f"{_rounded(scale.force)} N", [CHAIN_COLOR]))
    inset, beyond = (0.02 * half, -0.05 * half) if painter.has_free_corners else (0.0, 0.05 * half)
    for x, y, length, width, text, colors in bars:  # x is 1 at the right, y at the top
        first = view.right - inset - length if x > 0 else view.left + inset
        middle = view.top + beyond if y > 0 else view.bottom - beyond
        for k, color in enumerate(colors):
            begin = length * k / len(colors)
            bar = Rectangle((first + begin, middle - width / 2.0), length - begin, width, color=color)
            bar.set(linewidth=0.0, clip_on=False)
            axes.add_patch(bar)
        place, side = (first - 0.02 * half, "right") if x > 0 else (first + length + 0.02 * half, "left")
        axes.text(place, middle, text, va="center", ha=side, fontsize=size, color=painter.ink)


def _rounded(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def shares(view: Bounds) -> tuple[float, float]:
    """Return width and height of axes that show a view, in units of the longer one.

    The shorter one is at least 0.4, so that there is space for a color bar.
    """
    across, along = (max(length / (2.0 * view.half), _LEAST_SHARE) for length in (view.width, view.height))
    return across, along


class Canvas:
    """A figure with the axes of a scene and a color bar, which is reused for successive snapshots.

    `side` is the longer side of the axes [pixels]; it has no effect if the look gives a size.
    """

    def __init__(self, painter: Painter, side: int) -> None:
        bar = _BAR_SHARE * (painter.colors.scale is not None and not painter.look.clean)
        size = painter.look.pixels
        if size is None:
            across, along = shares(painter.view)
            size = 2 * round(side * (across + bar) / 2.0), 2 * round(side * along / 2.0)  # even, for films
        else:
            side = min(round(size[0] / (1.0 + bar)), size[1])
        dpi = side / _INCHES
        inches = size[0] / dpi, size[1] / dpi
        self.figure = Figure(figsize=inches, dpi=dpi, facecolor=painter.background, layout="constrained")
        self._agg = FigureCanvasAgg(self.figure)
        axes = self.figure.subplots()
        add_color_bar(self.figure, axes, painter)
        self._artists = FrameArtists(axes, painter)
        self._background: Any = None

    def show(self, now: Snapshot) -> None:
        """Draw a snapshot, replacing the last one."""
        self._artists.show(now)

    def pixels(self, now: Snapshot) -> NDArray[np.uint8]:
        """Return the picture of a snapshot (sRGB), shape (height, width, 3).

        All calls after the first redraw only the artists that change.
        """
        if self._background is None:
            for artist in self._artists.changing:
                artist.set_animated(True)
            self._agg.draw()
            self._background = self._agg.copy_from_bbox(self.figure.bbox)
        self._agg.restore_region(self._background)
        self._artists.show(now)
        for artist in self._artists.changing:
            self.figure.draw_artist(artist)
        return np.asarray(self._agg.buffer_rgba())[:, :, :3]


def save_figure(
    figure: Figure, output: pathlib.Path, writer: str = "", dpi: float = DOTS_PER_INCH, **options: Any
) -> None:
    """Write a figure to a file, which appears when it is complete.

    `writer` distinguishes the drafts of several processes, see `draft_of`. `options` are those of
    `Figure.savefig`.
    """
    with draft_of(output, writer) as draft:
        figure.savefig(draft, dpi=dpi, **options)


class Picture:
    """A picture of a snapshot, which notebooks display. Unless a frame is given, it shows all grains.

    Attributes
    ----------
    figure : matplotlib.figure.Figure

    Examples
    --------
    >>> simulation.plot(color_by="pressure", forces=True).save("annulus.png")
    """

    def __init__(self, painter: Painter, now: Snapshot) -> None:
        painter.show_all(now)
        canvas = Canvas(painter, _SIDE)
        canvas.show(now)
        self.figure = canvas.figure

    def save(self, path: str | pathlib.Path) -> None:
        """Write the picture to a .png, .pdf or .svg file.

        Raises
        ------
        InputError
            The picture cannot be written. It is an `OutputError` if another process writes it.
        """
        require_writable_path("picture", pathlib.Path(path), *STILLS)
        with Lock(pathlib.Path(path)):
            save_figure(self.figure, pathlib.Path(path), dpi=self.figure.dpi)

    def _repr_png_(self) -> bytes:
        png = io.BytesIO()
        self.figure.savefig(png, format="png")
        return png.getvalue()


class DrawnOutput(ExitStack):
    """Base class of the outputs of a run that are drawn: a film, or a picture of its end.

    No other process can write the file during the run. It replaces any earlier file at the end of the run.
    """

    def __init__(self, scene: Scene, options: RunOptions, *_: object) -> None:
        super().__init__()
        self._path = pathlib.Path(options.record or "")
        require_writable_path("output", self._path)
        self._painter = Painter(scene, options)
        self.needs_contacts = self._painter.needs_contacts
        self.enter_context(Lock(self._path))

    def flush(self) -> None:
        """Do nothing, because a run that is drawn cannot be continued."""


class Still(DrawnOutput):
    """Output of a run as a picture of its end, see `DrawnOutput`."""

    def record(self, now: Snapshot) -> None:
        """Write the picture of `now`, the end of the run."""
        figure = Picture(self._painter, now).figure
        save_figure(figure, self._path, dpi=figure.dpi)
