"""Kinds of outputs of runs, by the suffix of their files."""

from math import inf

from warpgrains.errors import missing_extra

RECORDINGS = (".usdc", ".usda", ".usdz")
FILMS = (".mp4", ".gif", ".webp")
STILLS = (".png", ".pdf", ".svg")
KINDS = dict.fromkeys(RECORDINGS, "recording") | dict.fromkeys(FILMS, "film") | dict.fromkeys(STILLS, "still")
FASTEST = {".mp4": inf, ".gif": 50.0, ".webp": 50.0}
"""Largest frame rate that browsers play, by suffix [1/s]."""


def require_drawing(what: str, is_film: bool = False) -> None:
    """Raise InputError unless the libraries for a picture, or a film of it, are installed."""
    try:
        import matplotlib.axes  # noqa: F401

        if is_film:
            import imageio_ffmpeg  # noqa: F401
    except ModuleNotFoundError as error:
        raise missing_extra(what, error, "film" if is_film else "report") from error
