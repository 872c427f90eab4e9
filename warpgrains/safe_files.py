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
def draft_of(target: Path) -> Iterator[Path]:
    """Give the name of a file to write: once it is written, it takes the place of `target`."""
    draft = target.with_name(f".draft.{target.name}")
    try:
        yield draft
        publish(draft, target)
    finally:
        draft.unlink(missing_ok=True)
