"""Results of short runs, many in a file: tables that appear whole and are never changed.

A part is a CSV table with the columns of `results.csv` and the seconds, named after its first run, its last
one and its content: ``0000512-0001023-a1b2c3d4e5f60718.csv``. Any number of processes and machines write
parts side by side. A part that is not what its name says is damaged: it is set aside, as ``….csv.damaged``,
and its runs are done again. A run may be in two parts, done twice.
"""

import re
import sys
from collections.abc import Collection, Iterable
from hashlib import sha256
from pathlib import Path

from warpgrains.errors import SceneError
from warpgrains.files import csv_line, write_whole

DIGITS = 16  # of a part's hash

_NAME = re.compile(r"(?P<first>\d+)-(?P<last>\d+)-[0-9a-f]+\.csv")

OTHERWISE = "measures something else: choose another -o, or the same --measure"

Lines = dict[int, bytes]
"""Lines of a table, by the number of their run."""


class Parts:
    """The parts in a folder, as far as they have been read.

    Parameters
    ----------
    path
        The folder, which need not be there.
    columns
        Names of their columns, the run's number first.
    """

    def __init__(self, path: Path, columns: Iterable[str]):
        self.path, self.head = path, csv_line(columns)
        self.lines: Lines = {}
        self._read: set[str] = set()

    def write(self, lines: Lines, writer: str) -> None:
        """Add a part; `writer` tells this process from others."""
        if lines:
            content = self.head + b"".join(lines[run] for run in sorted(lines))
            name = f"{min(lines):07}-{max(lines):07}-{_hash(content)}.csv"
            write_whole(self.path / name, content, writer)

    def refresh(self, numbers: Collection[int]) -> None:
        """Read the parts that have come since and may hold some of these runs; set damaged ones aside.

        Raises
        ------
        SceneError
            One is of another sweep.
        """
        first, last = min(numbers, default=0), max(numbers, default=-1)
        for name in sorted(path.name for path in self.path.glob("*.csv")):
            part = _NAME.fullmatch(name)
            if part is None or name in self._read:
                continue
            if int(part["first"]) <= last and int(part["last"]) >= first and self._is_whole(name):
                for run, line in self._lines_of(name).items():
                    self.lines.setdefault(run, line)
                self._read.add(name)

    def _is_whole(self, name: str) -> bool:
        """Whether a part is what its name says; one that is not is set aside."""
        path = self.path / name
        whole = path.is_file() and name.rpartition("-")[2] == f"{_hash(path.read_bytes())}.csv"
        if not whole:
            path.rename(path.with_name(f"{name}.damaged"))
            print(f"'{path}' is damaged: its runs are done again", file=sys.stderr)
        return whole

    def _lines_of(self, name: str) -> Lines:
        content = (self.path / name).read_bytes()
        if not content.startswith(self.head):
            raise SceneError(f"'{self.path / name}' is of another sweep, or {OTHERWISE}")
        lines = content[len(self.head) :].splitlines(keepends=True)
        return {int(line.partition(b",")[0]): line for line in lines}


def _hash(content: bytes) -> str:
    return sha256(content).hexdigest()[:DIGITS]
