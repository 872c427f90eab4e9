"""One flat file out of a folder of chunks, with no more in memory than a chunk or two; and back again."""

import os
import tempfile
from pathlib import Path

from pxr import Sdf, UsdUtils

from warpgrains.errors import SceneError
from warpgrains.files import publish
from warpgrains.usd.chunks import (
    STATIC,
    ChunkFolder,
    count_codes,
    find_chunks,
    freeing_at_once,
    reporting_os_errors,
    require_frames,
)

_SAVED_AT_ONCE = 16e6  # bytes of chunks between two saves of the flat file


def count_frames(folder: Path) -> int:
    """Return how many frames from frame 0 on the chunks in `folder` hold without a gap.

    Raises
    ------
    SceneError
        If there are none.
    """
    frames = 0
    for first, path in find_chunks(folder):
        if first != frames:
            break
        frames += count_codes(path)
    if not frames:
        raise SceneError(f"'{folder}' holds no frames of a recording")
    return frames


def flatten(folder: Path, target: Path, frames: int) -> None:
    """Write the first `frames` frames of the chunks in `folder` to the one file `target`.

    There must be the end of a chunk. The file, ``.usdc``, ``.usda`` or ``.usdz``, is replaced only when the
    new one is whole and on the disk.

    Raises
    ------
    OSError
        If the file cannot be written, or would not hold all these frames.
    """
    chunks = [path for first, path in find_chunks(folder) if first < frames]
    with tempfile.TemporaryDirectory(dir=folder, prefix=".flat.") as workplace:
        binary = Path(workplace) / f"{target.stem}.usdc"
        draft = Path(workplace) / target.name
        with reporting_os_errors(target), freeing_at_once():
            attributes = _join(folder / STATIC, chunks, frames, binary)
            if target.suffix == ".usda":
                Sdf.Layer.FindOrOpen(str(binary)).Export(str(draft))
            elif target.suffix == ".usdz":
                UsdUtils.CreateNewUsdzPackage(str(binary), str(draft))
            require_frames(draft, attributes, frames)
        publish(draft, target)


def reopen(recording: Path, chunks: Path) -> None:
    """Write the frames of a recording to a new folder of chunks, which appears when it is whole.

    Raises
    ------
    OSError
        The file cannot be read, or the folder cannot be written.
    """
    draft = chunks.with_name(f".{chunks.name}.draft")
    with reporting_os_errors(recording):
        flat = Sdf.Layer.FindOrOpen(str(recording))
        attributes = _animated_attributes(flat)
        folder = ChunkFolder(draft, _without_frames(flat, attributes))
        if draft.exists():
            folder.remove()
        for code in flat.ListAllTimeSamples():
            folder.add({attribute: flat.QueryTimeSample(attribute, code) for attribute in attributes})
        folder.flush()
    os.rename(draft, chunks)


def resume(recording: Path, folder: ChunkFolder, frames: int) -> None:
    """Cut the chunks of a recording to so many frames; if they are joined to its file, take that apart first.

    Raises
    ------
    SceneError
        They are not those of this recording, or do not hold these frames.
    """
    is_joined = recording.exists() and not folder.path.exists()
    if is_joined:
        reopen(recording, folder.path)
    try:
        folder.cut(frames)
    except SceneError:
        if is_joined:
            folder.remove()
        raise


def _join(static: Path, chunks: list[Path], frames: int, binary: Path) -> list[Sdf.Path]:
    """Write the static layer and all chunks to the usdc file `binary`; return what is animated."""
    flat = Sdf.Layer.CreateNew(str(binary))
    flat.TransferContent(Sdf.Layer.FindOrOpen(str(static)))
    flat.startTimeCode, flat.endTimeCode = 0, frames - 1
    unsaved = 0
    for path in chunks:
        chunk = Sdf.Layer.FindOrOpen(str(path))
        attributes = _animated_attributes(chunk)
        for attribute in attributes:
            for code in chunk.ListTimeSamplesForPath(attribute):
                flat.SetTimeSample(attribute, code, chunk.QueryTimeSample(attribute, code))
        unsaved += path.stat().st_size
        if unsaved > _SAVED_AT_ONCE:
            flat.Save()
            unsaved = 0
    flat.Save()
    return attributes


def _animated_attributes(layer: Sdf.Layer) -> list[Sdf.Path]:
    """Return the attributes that have time samples in `layer`."""
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    return [path for path in paths if path.IsPrimPropertyPath() and layer.GetNumTimeSamplesForPath(path)]


def _without_frames(flat: Sdf.Layer, attributes: list[Sdf.Path]) -> Sdf.Layer:
    """Return an anonymous layer with everything that no frame changes."""
    static = Sdf.Layer.CreateAnonymous(".usdc")
    static.TransferContent(flat)
    for attribute in attributes:
        static.GetAttributeAtPath(attribute).ClearInfo("timeSamples")
    static.ClearStartTimeCode()
    static.ClearEndTimeCode()
    return static
