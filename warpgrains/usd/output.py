"""The output file of a recording: its valid paths, the files that it may replace, and its lock."""

from pathlib import Path

from pxr import Sdf, Tf

from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.errors import InputError
from warpgrains.files import require_writable_path
from warpgrains.locks import Lock, lock_own
from warpgrains.usd.metadata import RECORDED_BY


def lock_output(path: Path) -> Lock:
    """Lock a recording for writing.

    Raises
    ------
    InputError
        It cannot be written there. It is an `OutputError` if another process writes it, or if the file exists
        and is no recording.
    """
    require_writable_path("output", path, *RECORDINGS)
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"output '{path}' is not UTF-8: USD cannot write a file of this name") from None
    return lock_own(path, _is_recording, "recording of warpgrains")


def _is_recording(path: Path) -> bool:
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path), metadataOnly=True)
    except Tf.ErrorException:
        return False
    return layer is not None and RECORDED_BY in layer.customLayerData
