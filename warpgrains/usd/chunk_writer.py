"""Frames gathered into chunks."""

import numpy as np

from warpgrains.usd.chunks import ChunkFolder
from warpgrains.usd.layers import Samples

CHUNK_FRAMES = 100
CHUNK_BYTES = 16e6


class ChunkWriter:
    """Writes a chunk when 100 frames or 16 MB have come together.

    It writes then and there, not in a thread: a killed run must not lose a second chunk, the one that a
    thread was about to write. Frames that could not be written are kept and tried again.

    Parameters
    ----------
    folder : ChunkFolder
        Where the chunks go.
    frames : int
        Frames that the folder holds already.
    """

    def __init__(self, folder: ChunkFolder, frames: int) -> None:
        self._folder = folder
        self._written = frames
        self._pending: list[Samples] = []
        self._pending_bytes = 0

    @property
    def frames(self) -> int:
        """Number of frames so far, on the disk or not."""
        return self._written + len(self._pending)

    @property
    def has_written(self) -> bool:
        """Whether there are chunks on the disk."""
        return self._written > 0

    def add(self, samples: Samples) -> None:
        """Append one frame: the value of each attribute."""
        self._pending.append(samples)
        self._pending_bytes += sum(np.asarray(value).nbytes for value in samples.values())
        if len(self._pending) >= CHUNK_FRAMES or self._pending_bytes >= CHUNK_BYTES:
            self._write()

    def flush(self) -> None:
        """Put all frames so far on the disk, and show them."""
        if self._pending:
            self._write()
        if self.frames:
            self._folder.show(self.frames)

    def _write(self) -> None:
        self._folder.append(self._written, self._pending)
        self._written += len(self._pending)
        self._pending, self._pending_bytes = [], 0
