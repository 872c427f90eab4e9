"""A recording while it grows: a folder of chunk files that a viewer opens through value clips.

The folder holds what no frame changes (`static.usdc`), the frames in chunks named by their first frame
(`chunk.00000300.usdc`) and two small layers that make one animation of them (`root.usda`,
`manifest.usda`). Each file appears under its name only when it is whole and on the disk, so a killed run
loses no more than the chunk it was filling.
"""

import os
import re
import shutil
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from pxr import Sdf

from warpgrains.errors import SceneError
from warpgrains.files import publish
from warpgrains.usd.layers import (
    Samples,
    chunk_layer,
    clips_layer,
    count_codes,
    freeing_at_once,
    manifest_layer,
    reporting_os_errors,
    require_frames,
)

STATIC = "static.usdc"
MANIFEST = "manifest.usda"
ROOT = "root.usda"
CHUNK_FRAMES = 100
CHUNK_BYTES = 16e6

_CHUNK_NAME = re.compile(r"chunk\.(\d{8})\.usdc")
_SECONDS_BETWEEN_ROOTS = 1.0


def find_chunks(folder: Path) -> list[tuple[int, Path]]:
    """Return the first frame and the path of each chunk in `folder`, in order."""
    names = ((_CHUNK_NAME.fullmatch(path.name), path) for path in folder.iterdir())
    return sorted((int(match[1]), path) for match, path in names if match)


class ChunkFolder:
    """The folder of one growing recording: the first chunk creates it, `cut` continues one.

    What no frame changes, `static`, declares the attributes that the frames set.
    """

    def __init__(self, path: Path, static: Sdf.Layer) -> None:
        self.path = path
        self._static = static
        self._is_ours = False
        self._shown_at = 0.0

    def require_absent(self) -> None:
        """Raise SceneError if the folder exists: it may hold the only copy of a run, or of one that runs."""
        if self.path.exists():
            raise SceneError(
                f"'{self.path}' holds frames of another run;"
                " make a file of them with 'warpgrains recover', or delete it"
            )

    def cut(self, frames: int) -> None:
        """Drop all chunks from frame number `frames` on, so that the next chunk can begin there.

        Raises
        ------
        SceneError
            If the folder is not of this recording, or its chunks do not hold the earlier frames.
        """
        static = self.path / STATIC
        if not static.is_file() or _text(Sdf.Layer.FindOrOpen(str(static))) != _text(self._static):
            raise SceneError(f"'{self.path}' holds no frames of this scene, drawn as now asked for")
        chunks = find_chunks(self.path)
        held = sum(count_codes(path) for first, path in chunks if first < frames)
        if held != frames:
            raise SceneError(f"'{self.path}' holds {held} of the {frames} frames to continue from")
        for first, path in chunks:
            if first >= frames:
                path.unlink()
        self._is_ours = True
        if frames:
            self.show(frames)

    def append(self, first: int, frames: Sequence[Samples]) -> None:
        """Write one chunk, whose first frame is number `first`, and now and then the root that shows all."""
        if not self._is_ours:
            self._start(frames[0])
        name = f"chunk.{first:08d}.usdc"
        with freeing_at_once():
            self._publish(chunk_layer(self._static, first, frames), name, frames[0], len(frames))
        if time.monotonic() - self._shown_at > _SECONDS_BETWEEN_ROOTS:
            self.show(first + len(frames))

    def show(self, frames: int) -> None:
        """Write the root that shows all chunks, which hold `frames` frames."""
        root = clips_layer(self.path / STATIC, self.path / MANIFEST, find_chunks(self.path), frames - 1)
        self._publish(root, ROOT)
        self._shown_at = time.monotonic()

    def remove_if_empty(self) -> None:
        """Delete the folder if this recording created it and it holds no chunk."""
        if self._is_ours and not find_chunks(self.path):
            self.remove()

    def remove(self) -> None:
        """Delete the folder, at once to anyone who looks for it by its name."""
        doomed = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        self.path.rename(doomed)
        self._is_ours = False
        shutil.rmtree(doomed)

    def _start(self, attributes: Iterable[Sdf.Path]) -> None:
        """Create the folder, with all that is known before the first chunk."""
        self.require_absent()
        self.path.mkdir()
        self._is_ours = True
        try:
            self._publish(self._static, STATIC)
            self._publish(manifest_layer(self._static, attributes), MANIFEST)
        except OSError:
            self.remove()
            raise

    def _publish(
        self, layer: Sdf.Layer, name: str, attributes: Iterable[Sdf.Path] = (), frames: int = 0
    ) -> None:
        draft = self.path / f".draft.{name}"
        try:
            with reporting_os_errors(self.path / name):
                layer.Export(str(draft))
                require_frames(draft, attributes, frames)
            publish(draft, self.path / name)
        finally:
            draft.unlink(missing_ok=True)


class ChunkWriter:
    """Writes a chunk when 100 frames or 16 MB have come together.

    It writes then and there, not in a thread: a killed run must not lose a second chunk, the one that a
    thread was about to write. Frames that could not be written are kept and tried again.

    The folder may hold some frames already.
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


def _text(layer: Sdf.Layer) -> str:
    return layer.ExportToString()
