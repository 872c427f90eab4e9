"""The file that a recording becomes: where it may be, what it may replace, and who may write it."""

from pathlib import Path

from pxr import Sdf, Tf

from warpgrains.errors import InputError
from warpgrains.files import require_place
from warpgrains.locks import Lock, lock_own

SUFFIXES = (".usdc", ".usda", ".usdz")
RECORDED_BY = "warpgrains"
"""Key in a layer's own data by which a recording is known."""


def log_of(path: Path) -> Path:
    """Return the file that holds the frames of the recording `path` until it is complete."""
    return path.with_name(path.name + ".frames")


def lock_output(path: Path) -> Lock:
    """Return the lock on a recording.

    Raises
    ------
    InputError
        It cannot be written there; as an `OutputError`, if another process does so, or there is something
        that is no recording.
    """
    require_place("output", path, *SUFFIXES)
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"output '{path}' is not UTF-8: USD cannot write a file of this name") from None
    return lock_own(path, _is_recording, "recording of warpgrains")


def _is_recording(path: Path) -> bool:
    if not path.is_file():
        return False
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path), metadataOnly=True)
    except Tf.ErrorException:
        return False
    return layer is not None and RECORDED_BY in layer.customLayerData
