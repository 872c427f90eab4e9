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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pxr import Sdf, Tf, Vt, Work

from warpgrains.errors import SceneError
from warpgrains.files import publish

STATIC = "static.usdc"
MANIFEST = "manifest.usda"
ROOT = "root.usda"
CHUNK_FRAMES = 100
CHUNK_BYTES = 16e6

Samples = Mapping[Sdf.Path, object]
"""One frame: the value of each attribute."""

_CHUNK_NAME = re.compile(r"chunk\.(\d{8})\.usdc")
_SECONDS_BETWEEN_ROOTS = 1.0


def find_chunks(folder: Path) -> list[tuple[int, Path]]:
    """Return the first frame and the path of each chunk in `folder`, in order."""
    names = ((_CHUNK_NAME.fullmatch(path.name), path) for path in folder.iterdir())
    return sorted((int(match[1]), path) for match, path in names if match)


class ChunkFolder:
    """The folder of one growing recording: the first chunk creates it, `cut` continues one.

    What no frame changes, `static`, declares the attributes that the frames set. A chunk is written when
    100 frames or 16 MB have come together: then and there, not in a thread, since a killed run must not lose
    a second chunk, the one that a thread was about to write. Frames that could not be written are kept and
    tried again.
    """

    def __init__(self, path: Path, static: Sdf.Layer) -> None:
        self.path = path
        self._static = static
        self._is_ours = False
        self._shown_at = 0.0
        self._written = 0
        self._pending: list[Samples] = []
        self._pending_bytes = 0

    @property
    def frames(self) -> int:
        """Number of frames so far, on the disk or not."""
        return self._written + len(self._pending)

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
        static, ours = self.path / STATIC, self._static.ExportToString()
        if not static.is_file() or Sdf.Layer.FindOrOpen(str(static)).ExportToString() != ours:
            raise SceneError(f"'{self.path}' holds no frames of this scene, drawn as now asked for")
        chunks = find_chunks(self.path)
        held = sum(count_codes(path) for first, path in chunks if first < frames)
        if held != frames:
            raise SceneError(f"'{self.path}' holds {held} of the {frames} frames to continue from")
        for first, path in chunks:
            if first >= frames:
                path.unlink()
        self._is_ours, self._written = True, frames
        if frames:
            self._show()

    def add(self, samples: Samples) -> None:
        """Append one frame."""
        self._pending.append(samples)
        self._pending_bytes += sum(np.asarray(value).nbytes for value in samples.values())
        if len(self._pending) >= CHUNK_FRAMES or self._pending_bytes >= CHUNK_BYTES:
            self.append(self._written, self._pending)

    def flush(self) -> None:
        """Put all frames so far on the disk, and show them."""
        if self._pending:
            self.append(self._written, self._pending)
        if self.frames:
            self._show()

    def append(self, first: int, frames: Sequence[Samples]) -> None:
        """Write the frames that wait as one chunk, numbered from `first`, and now and then the root."""
        if not self._is_ours:
            self._start(frames[0])
        with freeing_at_once():
            chunk = chunk_layer(self._static, first, frames)
            self._publish(chunk, f"chunk.{first:08d}.usdc", frames[0], len(frames))
        if time.monotonic() - self._shown_at > _SECONDS_BETWEEN_ROOTS:
            self._show()
        self._written, self._pending, self._pending_bytes = self.frames, [], 0

    def _show(self) -> None:
        """Write the root that shows all chunks on the static layer."""
        chunks, last = find_chunks(self.path), self.frames - 1
        root, below = Sdf.Layer.CreateAnonymous(".usda"), self._static.pseudoRoot
        for key in below.ListInfoKeys():
            root.pseudoRoot.SetInfo(key, below.GetInfo(key))
        root.startTimeCode, root.endTimeCode = 0, last
        root.subLayerPaths.append(f"./{STATIC}")
        world = Sdf.CreatePrimInLayer(root, f"/{root.defaultPrim}")
        clips = {
            "primPath": str(world.path),
            "manifestAssetPath": Sdf.AssetPath(f"./{MANIFEST}"),
            "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(f"./{path.name}") for _, path in chunks]),
            "active": Vt.Vec2dArray([(first, index) for index, (first, _) in enumerate(chunks)]),
            "times": Vt.Vec2dArray([(0, 0), (last, last)] if last else [(0, 0)]),
        }
        world.SetInfo("clips", {"default": clips})
        self._publish(root, ROOT)
        self._shown_at = time.monotonic()

    @property
    def has_written(self) -> bool:
        """Whether there are chunks on the disk."""
        return self._written > 0

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
            self._publish(_declaring(attributes, self._static, ".usda"), MANIFEST)
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


def chunk_layer(static: Sdf.Layer, first: int, frames: Sequence[Samples]) -> Sdf.Layer:
    """Return a binary layer with the values of `frames`, numbered from `first`, and nothing else."""
    chunk = _declaring(frames[0], static, ".usdc")
    for code, samples in enumerate(frames, start=first):
        for attribute, value in samples.items():
            chunk.SetTimeSample(attribute, code, value)
    return chunk


def _declaring(attributes: Iterable[Sdf.Path], static: Sdf.Layer, suffix: str) -> Sdf.Layer:
    """Return a new layer that declares some attributes of the static one, and nothing else."""
    layer = Sdf.Layer.CreateAnonymous(suffix)
    for attribute in attributes:
        prim = Sdf.CreatePrimInLayer(layer, attribute.GetPrimPath())
        Sdf.AttributeSpec(prim, attribute.name, static.GetAttributeAtPath(attribute).typeName)
    return layer


def count_codes(path: Path) -> int:
    """Return the number of time codes in a layer's file."""
    with reporting_os_errors(path):
        return len(Sdf.Layer.FindOrOpen(str(path)).ListAllTimeSamples())


def require_frames(path: Path, attributes: Iterable[Sdf.Path], frames: int) -> None:
    """Raise OSError unless `path` can be read and holds `frames` time samples of each attribute."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    for attribute in attributes:
        written = layer.GetNumTimeSamplesForPath(attribute)
        if written != frames:
            raise OSError(f"'{path}' holds {written} frames of {attribute} after writing {frames}")


@contextmanager
def reporting_os_errors(path: Path) -> Iterator[None]:
    """Turn what USD raises when it cannot write `path` or read it back into an OSError of one line."""
    try:
        yield
    except Tf.ErrorException as error:
        reasons = [one.commentary.strip() for one in error.args]
        raise OSError(
            f"'{path}' cannot be written and read back: {reasons[0] if reasons else error}"
        ) from error


@contextmanager
def freeing_at_once() -> Iterator[None]:
    """Keep USD from freeing saved values in threads of its own: on a busy machine it would be late by all."""
    limit = Work.GetConcurrencyLimit()
    Work.SetConcurrencyLimit(1)
    try:
        yield
    finally:
        Work.SetConcurrencyLimit(limit)
