"""Results of short runs, many in a file: tables that appear whole and are never changed.

A shard is a CSV table with the columns of `results.csv` and the seconds, named after its first run, its last
one and its content: ``0000512-0001023-a1b2c3d4e5f60718.csv``. Any number of processes and machines write
shards at the same time. A shard whose content is not that of its name is damaged: it is set aside, as
``….csv.damaged``, and its runs are done again. A run may be in two shards, done twice.
"""

import re
import sys
from collections.abc import Collection, Iterable, Mapping
from hashlib import sha256
from pathlib import Path

from warpgrains.errors import InputError, OutputError
from warpgrains.files import Row, csv_line, write_whole
from warpgrains.sweep.results import Values

DIGITS = 16  # of a shard's hash

_NAME = re.compile(r"(?P<first>\d+)-(?P<last>\d+)-[0-9a-f]+\.csv")

OTHERWISE = "has other columns: choose another -o, or the same --measure"


class ResultShards:
    """The shards in a folder, as far as they have been read.

    Parameters
    ----------
    path
        The folder, which need not exist.
    columns
        Names of their columns, the run's number first.

    Attributes
    ----------
    lines : dict of int to bytes
        Lines of the table, by the number of their run.
    """

    def __init__(self, path: Path, columns: Iterable[str]):
        self.path, self._head = path, csv_line(columns)
        self.lines: dict[int, bytes] = {}
        self._read: set[str] = set()

    def write(self, results: Mapping[int, tuple[Row, Values]], writer: str) -> None:
        """Add a shard of labels and values of runs, by number; `writer` names this process."""
        if results:
            lines = (_line(*results[number]) for number in sorted(results))
            content = self._head + b"".join(lines)
            name = f"{min(results):07}-{max(results):07}-{_hash(content)}.csv"
            write_whole(self.path / name, content, writer)

    def refresh(self, numbers: Collection[int]) -> None:
        """Read the shards that are new and may hold some of these runs; set damaged ones aside.

        Raises
        ------
        InputError
            One is of another sweep.
        """
        first, last = min(numbers, default=0), max(numbers, default=-1)
        for path in sorted(self.path.glob("*.csv")):
            shard = _NAME.fullmatch(path.name)
            if shard is None or path.name in self._read:
                continue
            if int(shard["first"]) <= last and int(shard["last"]) >= first:
                self._take(path)

    def _take(self, path: Path) -> None:
        """Take the lines of a shard; set it aside if it is damaged."""
        content = path.read_bytes() if path.is_file() else b""
        if path.name.rpartition("-")[2] != f"{_hash(content)}.csv":
            path.rename(path.with_name(f"{path.name}.damaged"))
            print(f"'{path}' is damaged: its runs are repeated", file=sys.stderr)
            return
        if not content.startswith(self._head):
            raise InputError(f"'{path}' is of another sweep, or {OTHERWISE}")
        for line in content[len(self._head) :].splitlines(keepends=True):
            self.lines.setdefault(int(line.partition(b",")[0]), line)
        self._read.add(path.name)

    def require_own(self, number: int, labels: Row) -> None:
        """Raise OutputError if the result of a run that has these labels is that of another run."""
        if not self.lines[number].startswith(_cells(labels) + b","):
            raise OutputError(f"run {number} in '{self.path}' belongs to another sweep: choose another -o")


def _cells(labels: Row) -> bytes:
    return csv_line(labels.values())[:-1]


def _line(labels: Row, values: Values) -> bytes:
    """Return a line of a shard; its values are numbers, which need no quotes."""
    return b"%b,%b\n" % (_cells(labels), ",".join(map(str, values)).encode())


def _hash(content: bytes) -> str:
    return sha256(content).hexdigest()[:DIGITS]
