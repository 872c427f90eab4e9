"""Result shards: tables with the results of groups of runs, written atomically and never changed.

A shard is a CSV table with the columns of `results.csv` and the seconds. Its name consists of its first run,
its last run and a hash of its content: ``0000512-0001023-a1b2c3d4e5f60718.csv``. Any number of processes and
machines may write shards at the same time. If the content does not match the hash, the shard is damaged. It
is not read, so that its runs are done again.

A run that was done twice is in two shards. A result replaces a failure, and a later failure replaces an
earlier one.
"""

import os
import re
import socket
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from warpgrains.base.errors import OutputError
from warpgrains.base.files import Row, csv_line, write_atomically
from warpgrains.sweep.results import RunResult

DIGITS = 16  # hexadecimal digits of a shard's hash

_NAME = re.compile(r"(?P<first>\d+)-(?P<last>\d+)-[0-9a-f]+\.csv")


class ResultShards:
    """The shards in a folder, which may not exist yet.

    `lines` has the results that were read so far, as lines of CSV by number of the run. `repeated` has the
    numbers of the runs that failed in earlier processes and have no new result yet.
    """

    def __init__(self, path: Path, columns: Iterable[str]):
        self.path, self._head = path, csv_line(columns)
        self.lines: dict[int, bytes] = {}
        self.repeated: set[int] = set()
        self._damaged: list[Path] = []
        self._read: dict[str, int] = {}

    def write(self, results: Mapping[int, tuple[Row, RunResult]]) -> None:
        """Write a shard. `results` maps numbers of runs to their labels and results; {} writes no shard."""
        if results:
            rows = (results[number] for number in sorted(results))
            content = self._head + b"".join(csv_line([*labels.values(), *values]) for labels, values in rows)
            name = f"{min(results):07}-{max(results):07}-{_hash(content)}.csv"
            write_atomically(self.path / name, content, writer())

    def refresh(self, numbers: Collection[int]) -> set[int]:
        """Read the shards that are new and may contain one of the runs `numbers`.

        Return the numbers of all runs with new results, which may include other runs.
        """
        self._damaged.clear()
        first, last = min(numbers, default=0), max(numbers, default=-1)
        new: list[tuple[int, Path]] = []
        for path in self.path.glob("*.csv"):
            shard = _NAME.fullmatch(path.name)
            if shard is None or int(shard["first"]) > last or int(shard["last"]) < first:
                continue
            with suppress(FileNotFoundError):  # another process has renamed it
                if self._read.get(path.name) != (written := path.stat().st_mtime_ns):
                    new.append((written, path))
        return set().union(*(self._take(*shard) for shard in sorted(new)))

    def _take(self, written: int, path: Path) -> set[int]:
        """Read a shard, last written at `written` [ns]; return the numbers of runs with new results.

        A damaged shard has none; OutputError if the shard is of another sweep.
        """
        content = b""
        with suppress(FileNotFoundError):
            content = path.read_bytes() if path.is_file() else b""
        if path.name.rpartition("-")[2] != f"{_hash(content)}.csv":
            self._damaged.append(path)
            return set()
        if not content.startswith(self._head):
            raise OutputError(f"'{path}' is of another sweep: choose another -o")
        found = {int(line.partition(b",")[0]): line for line in _records(content[len(self._head) :])}
        for number in found.keys() & self.lines.keys():
            if not has_failed(self.lines[number]):
                del found[number]
        self.lines |= found
        self.repeated -= found.keys()
        self._read[path.name] = written  # a repeated failure is written to the same name
        return set(found)

    def set_damaged_aside(self) -> None:
        """Rename the damaged shards that `refresh` has found to ``….csv.damaged``, and report them."""
        for path in self._damaged:
            with suppress(FileNotFoundError):  # another process has renamed it
                path.rename(path.with_name(f"{path.name}.damaged"))
                print(f"'{path}' is damaged: its runs are repeated", file=sys.stderr)

    def require_this_run(self, number: int, labels: Row) -> None:
        """Raise OutputError if the result of run `number` is of another sweep, because its labels differ."""
        if not self.lines[number].startswith(csv_line(labels.values())[:-1] + b","):
            raise OutputError(f"run {number} in '{self.path}' belongs to another sweep: choose another -o")


def _records(content: bytes) -> Iterator[bytes]:
    """Yield the rows of a CSV table. A row has several lines if a quoted cell contains line ends."""
    begun = b""
    for line in content.splitlines(keepends=True):
        begun += line
        if begun.count(b'"') % 2 == 0:
            yield begun
            begun = b""


def has_failed(line: bytes) -> bool:
    """Return whether a line of results says that the run failed: its second-to-last cell is not empty.

    This cell is the reason of the failure.
    """
    return line.rsplit(b",", 2)[1] != b""


def writer() -> str:
    """Return a name of this process that is unique among all processes that may write to the folder."""
    return f".{socket.gethostname()}.{os.getpid()}"


def _hash(content: bytes) -> str:
    return sha256(content).hexdigest()[:DIGITS]
