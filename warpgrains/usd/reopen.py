"""A finished recording turned into chunks again, so that a longer run can continue it."""

import os
from pathlib import Path

from pxr import Sdf

from warpgrains.usd.chunk_writer import ChunkWriter
from warpgrains.usd.chunks import ChunkFolder
from warpgrains.usd.layers import animated_attributes, reporting_os_errors


def reopen(recording: Path, chunks: Path) -> None:
    """Write the frames of a recording to a folder of chunks, which appears when it is whole.

    Parameters
    ----------
    recording : Path
        The file; it is left as it is.
    chunks : Path
        The folder that is to hold its frames; there must be none yet.

    Raises
    ------
    OSError
        The file cannot be read, or the folder cannot be written.
    """
    draft = chunks.with_name(f".{chunks.name}.draft")
    with reporting_os_errors(recording):
        flat = Sdf.Layer.FindOrOpen(str(recording))
        attributes = animated_attributes(flat)
        folder = ChunkFolder(draft, _without_frames(flat, attributes))
        if draft.exists():
            folder.remove()
        writer = ChunkWriter(folder, 0)
        for code in flat.ListAllTimeSamples():
            writer.add({attribute: flat.QueryTimeSample(attribute, code) for attribute in attributes})
        writer.flush()
    os.rename(draft, chunks)


def _without_frames(flat: Sdf.Layer, attributes: list[Sdf.Path]) -> Sdf.Layer:
    """Return an anonymous layer with everything that no frame changes."""
    static = Sdf.Layer.CreateAnonymous(".usdc")
    static.TransferContent(flat)
    for attribute in attributes:
        static.GetAttributeAtPath(attribute).ClearInfo("timeSamples")
    static.ClearStartTimeCode()
    static.ClearEndTimeCode()
    return static
