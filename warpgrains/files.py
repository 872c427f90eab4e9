"""Files that appear under their name only when they are whole, and tables of results, in CSV."""

import csv
import io
import os
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from warpgrains.errors import InputError

_NUMBER, _WORD = r"-\d+(?:\.\d+)?(?:e[+-]?\d+)?", r"[A-Za-z0-9][\w.+-]*"
_PLAIN = re.compile(rf"(?:(?:{_WORD}|{_NUMBER})?(?:,|$))*", re.ASCII)
"""A line of cells that need neither quotes nor guards, as most are."""

Row = dict[str, str]
"""A line of a table: what its cells hold, by column."""


def require_writable_folder(folder: Path) -> None:
    """Raise InputError unless a file can be created in `folder` now."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(f"output folder '{folder}' cannot be written: {error.strerror}") from error


def make_folder(folder: Path) -> None:
    """Create a folder for outputs, unless it exists; raise InputError if it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"output folder '{folder}' cannot be created: {error.strerror}") from error
    require_writable_folder(folder)


def require_place(kind: str, path: Path, *suffixes: str) -> None:
    """Raise InputError unless a file of this kind, with one of these endings, can be created there now."""
    path = followed(path)
    if path.suffix not in suffixes:
        raise InputError(f"{kind} '{path}' must end in {', '.join(suffixes)}")
    if path.is_dir():
        raise InputError(f"{kind} '{path}' is a folder")
    require_writable_folder(path.parent)


def followed(path: Path) -> Path:
    """Return the file that a symbolic link leads to, or else the path itself.

    What is written to a link replaces that file, and the link stays.
    """
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def read_regular(path: Path) -> bytes:
    """Return the content of a regular file; InputError for anything else: a pipe would block."""
    if not path.is_file():
        raise InputError(f"'{path}' is not a regular file")
    return path.read_bytes()


@contextmanager
def _naming(target: Path, draft: Path) -> Iterator[None]:
    """Name the target in errors that name no file, such as that of a full disk, or only its draft."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(draft)):
            raise
        raise OSError(f"'{target}' cannot be written: {error.strerror}") from error


def sync(path: Path) -> None:
    """Wait until the file or folder `path` is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def publish(draft: Path, target: Path) -> None:
    """Put the finished file `draft` in the place of `target`, on the same file system, and on the disk."""
    with _naming(target, draft):
        sync(draft)
        os.replace(draft, target)
        sync(target.parent)


@contextmanager
def draft_of(target: Path, writer: str = "") -> Iterator[Path]:
    """Give the name of a file to write: once it is written, it takes the place of `target`.

    Where several processes may write the same file at once, `writer` tells them apart.

    Raises
    ------
    OSError
        It cannot be written: the message names the target.
    """
    target = followed(target)
    draft = target.with_name(f".draft{writer}.{target.name}")
    try:
        with _naming(target, draft):
            yield draft
        publish(draft, target)
    finally:
        draft.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes | memoryview, writer: str = "") -> None:
    """Put content under a name and on the disk, whole; until then an earlier file of that name stays.

    Raises
    ------
    OSError
        It cannot be written, or reads back different from what was written.
    """
    with draft_of(path, writer) as draft:
        draft.write_bytes(content)
        if draft.read_bytes() != content:
            raise OSError(f"'{path}' reads back different from what was written: check the disk")


def table_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table as CSV: names in the first line, then a line a row, see `csv_line`."""
    lines = [csv_line(rows[0]), *(csv_line(row.values()) for row in rows)]
    return b"".join(lines).decode()


def csv_line(cells: Iterable[Any]) -> bytes:
    """Return a line of a table as CSV.

    A spreadsheet takes what begins with =, +, - or @ for a formula: such a cell, if it is no number, has an
    apostrophe before it, which `read_table` takes away.
    """
    texts = list(map(str, cells))
    line = ",".join(texts)
    if _PLAIN.fullmatch(line) and line.count(",") == len(texts) - 1 > 0:
        return f"{line}\n".encode()
    text = io.StringIO()
    csv.writer(text).writerow(map(_guarded, texts))  # whose lines end in \r\n, so that it quotes these
    return f"{text.getvalue()[:-2]}\n".encode()


def _guarded(cell: str) -> str:
    return f"'{cell}" if _is_formula(cell) and not _is_number(cell) else cell


def _unguarded(cell: Any) -> Any:
    is_guarded = isinstance(cell, str) and cell.startswith("'") and _is_formula(cell)
    return cell[1:] if is_guarded else cell


def _is_formula(cell: str) -> bool:
    """Return whether a spreadsheet would take a cell for a formula, without the apostrophes before it."""
    return cell.lstrip("'").startswith(("=", "+", "-", "@", "\t", "\r"))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def read_table(path: Path) -> list[Row]:
    """Read a table as rows of text, by column; raise InputError if it is none."""
    with _opened(path) as lines:
        rows = csv.DictReader(lines, strict=True)
        return [{name: _unguarded(cell) for name, cell in row.items()} for row in rows]


def read_columns(path: Path, wanted: Callable[[list[str]], Iterable[str]]) -> dict[str, list[str]]:
    """Read some columns of a table, see `columns_of`; raise InputError if it is none."""
    with _opened(path) as lines:
        return columns_of(lines, wanted)


def columns_of(lines: Iterable[str], wanted: Callable[[list[str]], Iterable[str]]) -> dict[str, list[str]]:
    """Return some columns of a table that may have millions of rows.

    Parameters
    ----------
    lines
        Of the table.
    wanted
        Returns the names of these columns, given those of all.

    Raises
    ------
    csv.Error
        It is no table.
    """
    rows = csv.reader(lines, strict=True)
    head = next(rows, [])
    columns: dict[str, list[str]] = {name: [] for name in wanted(head)}
    indices = [(column, head.index(name)) for name, column in columns.items()]
    for row in rows:
        if len(row) != len(head):
            raise csv.Error(f"line {rows.line_num} has {len(row)} cells")
        for column, index in indices:
            column.append(_unguarded(row[index]))
    return columns


@contextmanager
def _opened(path: Path) -> Iterator[Iterable[str]]:
    if not path.is_file():
        raise InputError(f"'{path}' cannot be read: it is not a regular file")
    try:
        with path.open(newline="", encoding="utf-8") as lines:
            yield lines
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"'{path}' cannot be read: {error}") from None
