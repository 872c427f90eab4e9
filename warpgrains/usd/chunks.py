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

_CHUNK_NAME = re.compile(r"chunk\.(\d{8})\.usdc")
_SECONDS_BETWEEN_ROOTS = 1.0


def find_chunks(folder: Path) -> list[tuple[int, Path]]:
    """Return the first frame and the path of each chunk in `folder`, in order."""
    names = ((_CHUNK_NAME.fullmatch(path.name), path) for path in folder.iterdir())
    return sorted((int(match[1]), path) for match, path in names if match)


class ChunkFolder:
    """The folder of one growing recording.

    Parameters
    ----------
    path : Path
        The folder; the first chunk creates it, `cut` continues one.
    static : Sdf.Layer
        What no frame changes; it declares the attributes that the frames set.
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
        """Write one chunk, and now and then the root that shows all chunks.

        Parameters
        ----------
        first : int
            Number of the chunk's first frame.
        frames : sequence of mappings
            The value of each attribute, frame by frame.
        """
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


def _text(layer: Sdf.Layer) -> str:
    return layer.ExportToString()
