"""Where a report is put, and its files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from warpgrains.errors import SceneError
from warpgrains.files import draft_of, require_writable_folder
from warpgrains.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOTS_PER_INCH = 80


def prepare(scenes: Sequence[Scene], folder: Path) -> None:
    """Make the folder of a report, unless it is there; raise SceneError if it cannot hold one."""
    names = [scene.name for scene in scenes]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"two scenes are called '{name}': a report tells scenes apart by their names")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"output folder '{folder}' cannot be made: {error.strerror}") from error
    require_writable_folder(folder)


def write_text(path: Path, text: str) -> Path:
    """Put a text under its name, whole; return the name."""
    with draft_of(path) as draft:
        draft.write_text(text, encoding="utf-8")
    return path


def write_picture(path: Path, figure: Figure) -> Path:
    """Put a picture under its name, whole; return the name."""
    with draft_of(path) as draft:
        figure.savefig(draft, dpi=DOTS_PER_INCH, pil_kwargs={"optimize": True})
    return path
