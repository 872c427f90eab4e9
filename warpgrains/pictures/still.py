"""Pictures of the present state of a simulation."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from warpgrains.files import require_place
from warpgrains.pictures.canvas import Canvas, save_figure
from warpgrains.pictures.kinds import STILLS
from warpgrains.pictures.shots import Painter

if TYPE_CHECKING:
    from warpgrains.simulation.simulation import Simulation

_HEIGHT = 600  # pixels


class Picture:
    """A picture, which a notebook shows.

    Attributes
    ----------
    figure : matplotlib.figure.Figure

    Examples
    --------
    >>> simulation.plot(color_by="pressure", forces=True).save("annulus.png")
    """

    def __init__(self, simulation: Simulation, color_by: str, forces: bool) -> None:
        painter = Painter(simulation.scene, color_by, forces)
        canvas = Canvas(painter.setting, _HEIGHT)
        canvas.show(painter.shot_of(simulation))
        self.figure = canvas.figure

    def save(self, path: str | Path) -> None:
        """Write it to a .png, .pdf or .svg file.

        Raises
        ------
        SceneError
            It cannot be written there.
        """
        require_place("picture", Path(path), *STILLS)
        save_figure(self.figure, Path(path))

    def _repr_png_(self) -> bytes:
        png = io.BytesIO()
        self.figure.savefig(png, format="png")
        return png.getvalue()
