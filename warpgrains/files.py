"""Files that appear under their name only when they are whole."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from warpgrains.errors import SceneError


def require_writable_folder(folder: Path) -> None:
    """Raise SceneError unless a file can be created in `folder` now."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise SceneError(f"output folder '{folder}' cannot be written: {error.strerror}") from error


def sync(path: Path) -> None:
    """Wait until the file or folder `path` is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def publish(draft: Path, target: Path) -> None:
    """Put the finished file `draft` in the place of `target`, on the same file system, and on the disk."""
    sync(draft)
    os.replace(draft, target)
    sync(target.parent)


@contextmanager
def draft_of(target: Path, writer: str = "") -> Iterator[Path]:
    """Give the name of a file to write: once it is written, it takes the place of `target`.

    Where several processes may write the same file at once, `writer` tells them apart.
    """
    draft = target.with_name(f".draft{writer}.{target.name}")
    try:
        yield draft
        publish(draft, target)
    finally:
        draft.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes | memoryview, writer: str = "") -> None:
    """Put content under a name and on the disk, whole; until then an earlier file of that name stays.

    Parameters
    ----------
    path
        The name.
    content
        All that the file is to hold.
    writer
        Who writes, where several processes may write the same file at once.

    Raises
    ------
    OSError
        It cannot be written, or is not read back as it was written.
    """
    with draft_of(path, writer) as draft:
        draft.write_bytes(content)
        if draft.read_bytes() != content:
            raise OSError(f"'{path}' is not read back as it was written")
