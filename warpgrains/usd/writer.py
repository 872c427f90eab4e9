"""Conversion of a log of frames to a USD file and back, with at most about 28 MB of frames in memory."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, UsdUtils

from warpgrains.base.errors import InputError
from warpgrains.base.files import draft_folder, draft_of, publish, resolve_link, suffix_of
from warpgrains.base.frame_log import FrameLog, LogReader, kind_of
from warpgrains.usd.grains import GRAINS
from warpgrains.usd.stage import RECORDED_BY, refusing_untrusted_content

_SAVED_AT_ONCE = 28e6  # bytes of frames between two saves of the file
_PACKED = time.mktime((1980, 1, 1, 0, 0, 0, 0, 1, -1))  # of every package, so that its bytes repeat
_DEEPEST = 1000  # brackets in brackets of the constants; USD crashes at some 20,000
_SAMPLE = 128  # bytes of memory per value in addition to its array


def write_recording(log: Path, target: Path, frames: int | None = None) -> int:
    """Convert a log, or its first `frames` frames, to the USD file `target`, and read it back as a check.

    Returns the number of frames.
    """
    reader, target = LogReader(log), resolve_link(target)
    with refusing_untrusted_content(log):
        constants = _constants(reader)
    with draft_folder(target) as folder:
        binary, draft = folder / f"{target.stem}.usdc", folder / target.name
        with _reporting_os_errors(target):
            written = _write_binary(reader, constants, binary, frames)
            if suffix_of(target) == ".usdz":
                os.utime(binary, (_PACKED, _PACKED))
                UsdUtils.CreateNewUsdzPackage(str(binary), str(draft))
            elif draft != binary:  # USD knows the format by the ending
                Sdf.Layer.OpenAsAnonymous(str(binary)).Export(str(draft))
            _require_frames(draft, reader.kinds, written if frames is None else frames)
        publish(draft, target)
    return written


def reopen_log(recording: Path, log: Path) -> None:
    """Convert a finished recording to a log with the same frames, which appears when it is complete."""
    with draft_of(log) as draft, _reporting_os_errors(recording):
        draft.unlink(missing_ok=True)
        flat = Sdf.Layer.OpenAsAnonymous(str(recording))
        paths: list[Sdf.Path] = []
        flat.Traverse(Sdf.Path.absoluteRootPath, paths.append)
        animated = [
            path for path in paths if path.IsPrimPropertyPath() and flat.GetNumTimeSamplesForPath(path)
        ]
        frames = FrameLog(draft, _without_frames(flat, animated))
        for code in flat.ListAllTimeSamples():
            frames.append({str(path): _logged(flat.QueryTimeSample(path, code)) for path in animated})
        frames.close()


def identity(constants: str) -> str:
    """Return the part of a log's constants that a run must share to continue this log.

    `constants` is a USD layer as text. The part consists of the scene, the frame rate and the look.
    """
    flat, own = _layer_of(constants), Sdf.Layer.CreateAnonymous(".usda")
    data = dict(flat.customLayerData.get(RECORDED_BY, {}))
    data.pop("version", None)
    own.customLayerData, own.timeCodesPerSecond = data, flat.timeCodesPerSecond
    if flat.GetPrimAtPath(GRAINS):
        Sdf.CreatePrimInLayer(own, GRAINS)
        Sdf.CopySpec(flat, GRAINS, own, GRAINS)
    return str(own.ExportToString())


def _logged(value: Any) -> NDArray[Any]:
    """Convert the value of an attribute to an array for the log, which has float32 instead of float16."""
    array = np.array(value)
    return array.astype(np.float32) if array.dtype == np.float16 else array


def _layer_of(constants: str) -> Sdf.Layer:
    """Return the layer with the content of a text.

    Raises ValueError if brackets are nested too deep for USD.
    """
    text = np.frombuffer(constants.encode(), np.uint8)
    opening, closing = (np.isin(text, list(brackets)).view(np.int8) for brackets in (b"([{", b")]}"))
    if (opening - closing).cumsum(dtype=np.int32).max(initial=0) > _DEEPEST:
        raise ValueError(f"brackets are nested deeper than {_DEEPEST}")
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(constants)
    return layer


def _constants(reader: LogReader) -> Sdf.Layer:
    """Return the constants of a log, all that is the same in its frames, as a USD layer.

    Raises ValueError unless the layer defines an attribute of the right type for each array of the frames.
    """
    layer = _layer_of(reader.constants)
    for name, kind in reader.kinds.items():
        spec = layer.GetAttributeAtPath(name) if Sdf.Path.IsValidPathString(name)[0] else None
        if spec is None or kind_of(_logged(spec.typeName.defaultValue)) != kind:
            raise ValueError(f"it has no attribute {name} of type {kind}")
    return layer


def _without_frames(flat: Sdf.Layer, animated: list[Sdf.Path]) -> str:
    """Return the content of a layer as text, without the time samples of the animated attributes."""
    constants = Sdf.Layer.CreateAnonymous(".usdc")
    constants.TransferContent(flat)
    for path in animated:
        constants.GetAttributeAtPath(path).ClearInfo("timeSamples")
    constants.ClearStartTimeCode()
    constants.ClearEndTimeCode()
    return str(constants.ExportToString())


def _write_binary(reader: LogReader, constants: Sdf.Layer, binary: Path, frames: int | None) -> int:
    """Write the first `frames` frames of a log, or all, to a usdc file; return their number."""
    flat = Sdf.Layer.CreateNew(str(binary))
    flat.TransferContent(constants)
    attributes = {name: flat.GetAttributeAtPath(name) for name in reader.kinds}
    samples = {name: (spec.path, type(spec.typeName.defaultValue)) for name, spec in attributes.items()}
    written = unsaved = 0
    for written, frame in enumerate(islice(reader, frames), start=1):
        for name, array in frame.items():
            path, kind = samples[name]
            flat.SetTimeSample(path, written - 1, kind.FromNumpy(array))
            unsaved += array.nbytes + _SAMPLE
        if unsaved > _SAVED_AT_ONCE:
            flat.Save()
            unsaved = 0
    if not written:
        raise InputError(f"'{reader.path}' holds no frames of a recording")
    flat.startTimeCode, flat.endTimeCode = 0, written - 1
    flat.Save()
    return written


def _require_frames(path: Path, names: Any, frames: int) -> None:
    """Raise OSError unless a USD file can be read and has `frames` time samples of each named attribute."""
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    for name in names:
        found = layer.GetNumTimeSamplesForPath(name)
        if found != frames:
            raise OSError(f"'{path}' reads back {found} frames of {name}, but {frames} were written")


@contextmanager
def _reporting_os_errors(path: Path) -> Iterator[None]:
    """Turn an exception of USD in the ``with`` block into an OSError whose message has one line.

    `path` is the file that the block writes or reads back.
    """
    try:
        yield
    except Tf.ErrorException as error:
        reasons = [one.commentary.strip() for one in error.args]
        raise OSError(
            f"'{path}' cannot be written and read back: {reasons[0] if reasons else error}"
        ) from error
