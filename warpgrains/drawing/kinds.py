"""Kinds of outputs of runs, by the suffix of their files."""

from math import inf
from typing import NamedTuple

from warpgrains.errors import requiring

RECORDINGS = (".usdc", ".usda", ".usdz")
FILMS = (".mp4", ".gif", ".webp")
STILLS = (".png", ".pdf", ".svg")
DRAWN_AS = ("points", "discs", "spheres")
"""Forms of the grains in a recording."""


class Kind(NamedTuple):
    """A kind of output."""

    name: str
    suffixes: tuple[str, ...]
    has_frames: bool = True
    """Whether it shows the whole run; otherwise it is a picture of the end."""
    continues: bool = False
    """Whether a run that is resumed from a checkpoint continues it."""
    lacks: tuple[str, ...] = ()
    """Options of runs that have no effect on it."""

    @property
    def listed(self) -> str:
        """Its suffixes as a text."""
        return ", ".join(self.suffixes)


RECORDING = Kind("recording", RECORDINGS, continues=True)
FILM = Kind("film", FILMS, lacks=("draw_as",))
STILL = Kind("still", STILLS, has_frames=False, lacks=("draw_as", "fps"))
KINDS = {suffix: kind for kind in (RECORDING, FILM, STILL) for suffix in kind.suffixes}
"""Kinds by suffix."""
FASTEST = {".mp4": inf, ".gif": 50.0, ".webp": 50.0}
"""Largest frame rate that browsers play, by suffix [1/s]."""


def require_drawing(what: str, is_film: bool = False) -> None:
    """Raise InputError unless the libraries for a picture, or a film of it, are installed."""
    with requiring(what, "film" if is_film else "report"):
        import matplotlib.axes  # noqa: F401

        if is_film:
            import imageio_ffmpeg  # noqa: F401
