"""An empty homework, its header, and the task in English and French."""

from pathlib import Path

from warpgrains.errors import OutputError
from warpgrains.files import make_folder, write_whole
from warpgrains.reference.reference import SOURCE

_SOURCES = [*sorted((Path(__file__).parent / "template").iterdir()), SOURCE.parent / "fem.h"]


def write_template(folder: Path) -> list[Path]:
    """Write them to a folder, and return what was written.

    Raises
    ------
    OutputError
        One of the files is there: nothing is written.
    InputError
        The folder cannot be written.
    """
    make_folder(folder)
    targets = [folder / source.name for source in _SOURCES]
    for target in targets:
        if target.exists():
            raise OutputError(f"refusing to overwrite '{target}': nothing was written")
    for source, target in zip(_SOURCES, targets, strict=True):
        write_whole(target, source.read_bytes())
    return targets
