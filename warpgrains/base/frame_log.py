"""The log of a recording: a file to which frames are appended, and which survives a killed process.

The file consists of a magic line and records. A record is the length [bytes] and the CRC-32 of its content,
followed by the content. The first record is JSON with the constants of the recording, and the name and type
of each array of a frame. Each further record is a frame: the lengths of its arrays, then the arrays,
little-endian, in the order of the names. The log ends at the first record that is truncated, damaged, or
holds a number that is not finite.
"""

import json
import os
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from operator import mul
from pathlib import Path
from typing import Any, BinaryIO
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from warpgrains.base.errors import InputError
from warpgrains.base.files import naming, write_atomically

Arrays = Mapping[str, NDArray[Any]]
"""One frame: arrays of numbers by name, shape (n,) or (n, k)."""

LOG_SUFFIX = ".frames"
_KIND = re.compile(r"(\([1-9][0-9]?,\))?<[fiu][248]")
_MAGIC = b"warpgrains frames 1\n"
_HEAD = struct.Struct("<QI")
_SYNC_FRAMES = 100
_SYNC_BYTES = 16e6


def log_of(path: Path) -> Path:
    """Return the path of the log that holds the frames of recording `path` until it is complete."""
    return path.with_name(path.name + LOG_SUFFIX)


def is_complete(path: Path) -> bool:
    """Return whether a recording is complete: its file exists, and its log no longer does."""
    return path.is_file() and not log_of(path).exists()


class FrameLog:
    """Writer that appends frames to the log of a recording; the first frame creates the file.

    Every frame is passed to the operating system at once, so that a killed process loses none. It is flushed
    to the disk after 100 frames or 16 MB, and by `sync`.
    """

    def __init__(self, path: Path, constants: str) -> None:
        self.path, self.frames = path, 0
        self._constants = constants
        self._kinds: dict[str, str] = {}
        self._file: BinaryIO | None = None
        self._end = 0
        self._unsynced = 0, 0

    def require_absent(self) -> None:
        """Raise InputError if the file exists, because it may hold the only copy of another run's frames."""
        if self.path.exists():
            raise InputError(
                f"'{self.path}' holds frames of another run: make a recording of them with"
                " 'warpgrains recover', or delete it"
            )

    def reopen(self, frames: int, identity: Callable[[str], str]) -> None:
        """Continue a log after its first `frames` frames; drop all later ones.

        `identity` returns the part of a log's constants that must not change. Raises InputError if that of
        the log differs from that of this recording, or if the log has fewer frames.
        """
        reader = LogReader(self.path)
        if identity(reader.constants) != identity(self._constants):
            raise InputError(
                f"'{self.path}' holds frames of another scene or of other drawing"
                " options: use those of the first run, or delete it"
            )
        end, held = reader.end, 0
        for _ in reader:
            held, end = held + 1, reader.end
            if held == frames:
                break
        if held != frames:
            raise InputError(
                f"'{self.path}' holds {held} of the {frames} frames that the checkpoint continues from"
            )
        self._kinds, self.frames = reader.kinds, frames
        self._open(end)

    def append(self, arrays: Arrays) -> None:
        """Append one frame; if it cannot be written, the log is unchanged."""
        if self._file is None:
            self._create(arrays)
        count, size = self._unsynced
        if count >= _SYNC_FRAMES or size >= _SYNC_BYTES:
            self.sync()  # before the frame is written: if this fails, the call may be repeated
            count = size = 0
        ordered = [np.ascontiguousarray(arrays[name]) for name in self._kinds]
        lengths = struct.pack(f"<{len(ordered)}I", *map(len, ordered))
        record = _record(b"".join([lengths, *(array.data for array in ordered)]))
        self._write(record)
        self.frames += 1
        self._unsynced = count + 1, size + len(record)

    def sync(self) -> None:
        """Flush all frames to the disk."""
        if self._file is not None:
            os.fsync(self._file.fileno())
        self._unsynced = 0, 0

    def close(self) -> None:
        """Close the log."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def remove(self) -> None:
        """Close and delete the file."""
        self.close()
        self.path.unlink(missing_ok=True)

    def _create(self, arrays: Arrays) -> None:
        self.require_absent()
        self._kinds = {name: kind_of(array) for name, array in sorted(arrays.items())}
        header = json.dumps({"constants": self._constants, "kinds": self._kinds}).encode()
        content = _MAGIC + _record(header)
        write_atomically(self.path, content)
        self._open(len(content))

    def _open(self, end: int) -> None:
        self._file, self._end = self.path.open("r+b", buffering=0), end
        self._file.truncate(end)
        self._file.seek(end)

    def _write(self, record: bytes) -> None:
        assert self._file is not None
        left = memoryview(record)
        try:
            with naming(self.path):
                while left:
                    left = left[self._file.write(left) :]
        except BaseException:
            self._file.truncate(self._end)
            self._file.seek(self._end)
            raise
        self._end += len(record)


class LogReader:
    """Reader of a log. Iterating over it yields all frames, as arrays by name. InputError for other files."""

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise InputError(f"'{path}' does not exist")
        with path.open("rb") as file:
            content = _read(file) if file.read(len(_MAGIC)) == _MAGIC else None
            self._start = self.end = file.tell()
        header = None
        with suppress(ValueError, RecursionError):
            header = json.loads(content or b"")
        match header:
            case {"constants": str(constants), "kinds": dict(kinds)} if kinds and _are_kinds(kinds.values()):
                self.constants: str = constants
                self.kinds: dict[str, str] = kinds
            case _:
                raise InputError(f"'{path}' is not a log of frames")

    def __iter__(self) -> Iterator[dict[str, NDArray[Any]]]:
        with self.path.open("rb") as file:
            file.seek(self._start)
            while (content := _read(file)) is not None and (frame := self._frame(content)) is not None:
                self.end = file.tell()
                yield frame

    def _frame(self, content: bytes) -> dict[str, NDArray[Any]] | None:
        """Return the arrays of a frame by name; None if `content` has a wrong size or non-finite numbers."""
        start = 4 * len(self.kinds)
        lengths = np.frombuffer(content[:start].ljust(start, b"\0"), "<u4").tolist()
        types = [np.dtype(kind) for kind in self.kinds.values()]
        if start + sum(map(mul, lengths, (each.itemsize for each in types))) != len(content):
            return None
        frame = {}
        for name, kind, length in zip(self.kinds, types, lengths, strict=True):
            frame[name] = np.frombuffer(content, kind, length, start).copy()  # aligned, which USD requires
            start += frame[name].nbytes
        return frame if all(np.isfinite(values).all() for values in frame.values()) else None


def _are_kinds(found: Iterable[Any]) -> bool:
    return all(isinstance(kind, str) and _KIND.fullmatch(kind) for kind in found)


def kind_of(array: NDArray[Any]) -> str:
    """Return the little-endian NumPy type of the rows of an array, such as "<f8" or "(2,)<f8"."""
    columns = f"({array.shape[1]},)" if array.ndim == 2 else ""
    return f"{columns}{array.dtype.newbyteorder('<').str}"


def _record(content: bytes) -> bytes:
    return _HEAD.pack(len(content), crc32(content)) + content


def _read(file: BinaryIO) -> bytes | None:
    """Return the content of the next record; None if no complete record follows."""
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    length, checksum = _HEAD.unpack(head)
    content = file.read(min(length, os.fstat(file.fileno()).st_size))
    return content if len(content) == length and crc32(content) == checksum else None
