"""Template of a homework: an empty solution, its header, and the task in English and French."""

from pathlib import Path

from warpgrains.errors import OutputError
from warpgrains.files import make_folder, write_atomically
from warpgrains.reference.reference import SOURCE

_SOURCES = [*sorted((Path(__file__).parent / "template").iterdir()), SOURCE.parent / "fem.h"]


def write_template(folder: Path) -> list[Path]:
    """Write the files of the template to a folder, and return their paths.

    Raises
    ------
    OutputError
        One of the files exists; nothing is written.
    InputError
        The folder cannot be written.
    """
    make_folder(folder)
    targets = [folder / source.name for source in _SOURCES]
    for target in targets:
        if target.exists():
            raise OutputError(f"refusing to overwrite '{target}': nothing was written")
    for source, target in zip(_SOURCES, targets, strict=True):
        write_atomically(target, source.read_bytes())
    return targets
