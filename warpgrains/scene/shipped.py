"""Files that come with the package: scenes, and sweeps over them."""

from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

from warpgrains.errors import SceneError
from warpgrains.scene import checks

FOLDERS = {"scene": "", "sweep": "sweeps"}
"""Where the shipped ones of each kind are, seen from the folder of the scenes."""


def shipped(kind: str) -> list[str]:
    """Return the names of the scenes, or of the sweeps, that come with the package."""
    names = (entry.name for entry in _folder(kind).iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def read_text(path: Path, kind: str) -> str:
    """Return the text of a scene or a sweep: of a file, or of a shipped one by its name.

    Raises
    ------
    SceneError
        There is none, or it cannot be read.
    """
    source: Path | Traversable = path
    if path.is_dir() or not path.exists():
        known = shipped(kind)
        if str(path) not in known:
            raise checks.unknown(f"{kind}, neither a file nor a shipped one,", str(path), known)
        source = _folder(kind) / f"{path}.toml"
    try:
        return source.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path} cannot be read: {error}") from None


def _folder(kind: str) -> Traversable:
    return files("warpgrains.scenes") / FOLDERS[kind]
