"""Files that are written atomically, and tables of results in CSV.

A file appears under its name only when it is complete, so that a killed process leaves no damaged file.
"""

import csv
import errno
import io
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from warpgrains.base.errors import InputError

_LARGEST = 2**31
"""Largest size of a file that is read [bytes]."""

_WITHOUT_LINKS = (errno.EPERM, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP)

csv.field_size_limit(sys.maxsize)  # a cell may hold a list of all grains

Row = dict[str, str]
"""A row of a table: the text of its cells by column."""


def require_writable_folder(folder: Path) -> None:
    """Raise InputError unless a file can be created in the folder."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        is_missing = isinstance(error, FileNotFoundError) and not folder.exists()
        told = "does not exist: create it" if is_missing else f"cannot be written: {error.strerror}"
        raise InputError(f"output folder '{folder}' {told}") from error


def make_folder(folder: Path) -> None:
    """Create a folder for outputs, unless it exists. Raises InputError if it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        told = "it is a file" if folder.is_file() else error.strerror
        raise InputError(f"output folder '{folder}' cannot be created: {told}") from error
    require_writable_folder(folder)


def require_writable_path(kind: str, path: Path, *suffixes: str) -> None:
    """Raise InputError unless a file can be created at `path`; messages call it `kind`.

    If `suffixes` are given, its name must end in one of them.
    """
    path = resolve_link(path)
    if suffixes and suffix_of(path) not in suffixes:
        raise InputError(f"{kind} '{path}' must end in {', '.join(suffixes)}")
    if path.is_dir():
        raise InputError(f"{kind} '{path}' is a folder")
    require_writable_folder(path.parent)


def suffix_of(path: str | os.PathLike[str]) -> str:
    """Return the suffix of a file's name in lower case, such as ".csv"."""
    return Path(path).suffix.lower()


def resolve_link(path: Path) -> Path:
    """Return the target of a symbolic link, so that the target is written; return any other path as it is."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


@contextmanager
def open_regular(path: Path, most: int = _LARGEST) -> Iterator[BinaryIO]:
    """Open a regular file of at most `most` bytes; a pipe would block, and a device might never end."""
    try:
        with open(path, "rb", opener=_open_nonblocking) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise InputError(f"'{path}' is not a regular file")
            if status.st_size > most:
                raise InputError(f"'{path}' is too large: it has more than {most} bytes")
            yield file
    except IsADirectoryError:
        raise InputError(f"'{path}' is not a regular file") from None
    except OSError as error:
        raise InputError(f"'{path}' cannot be read: {error.strerror or error}") from None


def _open_nonblocking(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)  # otherwise opening a pipe would wait for a writer


def read_regular(path: Path, most: int = _LARGEST) -> bytes:
    """Return the content of a regular file, see `open_regular`."""
    with open_regular(path, most) as file:
        return file.read()


@contextmanager
def naming(target: Path, draft: Path | None = None) -> Iterator[None]:
    """Make an OSError in a block name `target` if it names no file, or only `draft`.

    An error of a full disk names no file.
    """
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(draft)):
            raise
        raise OSError(f"'{target}' cannot be written: {error.strerror}") from error


def sync(path: Path) -> None:
    """Flush the file or folder `path` to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def publish(draft: Path, target: Path, replace: bool = True) -> None:
    """Move the complete file `draft` to `target` on the same file system; flush file and folder to the disk.

    Without `replace`, an existing target stays, unless the file system has no hard links.
    """
    with naming(target, draft):
        sync(draft)
        if replace or not _link(draft, target):
            os.replace(draft, target)
        sync(target.parent)


def _link(draft: Path, target: Path) -> bool:
    """Make `target` a hard link to `draft` unless `target` exists; return False without support for links."""
    try:
        os.link(draft, target)
    except FileExistsError:
        pass
    except OSError as error:
        if error.errno not in _WITHOUT_LINKS:
            raise
        return False
    return True


def draft_path(target: Path, writer: str = "") -> Path:
    """Return the path of the draft of `target`: a hidden file next to it, which is renamed when complete.

    Drafts of processes that may write at the same time differ by the text `writer`.
    """
    return target.with_name(f".draft{writer}.{target.name}")


@contextmanager
def draft_folder(target: Path) -> Iterator[Path]:
    """Yield an empty folder at `draft_path` for files from which `target` is made; delete it at the end."""
    folder = draft_path(target)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


@contextmanager
def draft_of(target: Path, writer: str = "", replace: bool = True) -> Iterator[Path]:
    """Yield the path of a draft, to which a block writes. After the block, the draft becomes `target`.

    For `writer`, see `draft_path`. Without `replace`, an existing target stays.
    """
    target = resolve_link(target)
    draft = draft_path(target, writer)
    try:
        with naming(target, draft):
            yield draft
        publish(draft, target, replace)
    finally:
        draft.unlink(missing_ok=True)


def write_atomically(path: Path, content: bytes | memoryview, writer: str = "", replace: bool = True) -> None:
    """Write `content` to a file atomically; for `writer` and `replace`, see `draft_of`.

    An existing file stays until the new file is on the disk.
    """
    with draft_of(path, writer, replace) as draft:
        draft.write_bytes(content)


def table_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table as CSV: column names first, then one line per row, see `csv_line`."""
    lines = [csv_line(rows[0]), *(csv_line(row.values()) for row in rows)]
    return b"".join(lines).decode()


def csv_line(cells: Iterable[Any]) -> bytes:
    """Return one line of a CSV table."""
    text = io.StringIO()
    csv.writer(text).writerow(map(str, cells))  # quotes \r and \n, its line ends
    return f"{text.getvalue()[:-2]}\n".encode()


def read_table(path: Path) -> list[Row]:
    """Read a table as rows of text by column. Raises InputError if the file is no table."""
    with _opened(path) as lines:
        return list(csv.DictReader(lines, strict=True))


def read_columns(path: Path, wanted: Callable[[list[str]], Iterable[str]]) -> dict[str, list[str]]:
    """Return the columns of a CSV file that `wanted` selects, by name, see `columns_of`.

    Raises InputError if the file is no table.
    """
    with _opened(path) as lines:
        return columns_of(lines, wanted)


def columns_of(lines: Iterable[str], wanted: Callable[[list[str]], Iterable[str]]) -> dict[str, list[str]]:
    """Return the columns that `wanted` selects, by name, from lines of CSV.

    `wanted` receives the names of all columns and returns those to keep. Raises csv.Error if the lines are no
    table.
    """
    rows = csv.reader(lines, strict=True)
    head = next(rows, [])
    columns: dict[str, list[str]] = {name: [] for name in wanted(head)}
    indices = [(column, head.index(name)) for name, column in columns.items()]
    for row in rows:
        if len(row) != len(head):
            raise csv.Error(f"line {rows.line_num} has {len(row)} cells")
        for column, index in indices:
            column.append(row[index])
    return columns


@contextmanager
def _opened(path: Path) -> Iterator[Iterable[str]]:
    try:
        with open_regular(path) as file:
            yield io.TextIOWrapper(file, encoding="utf-8-sig", newline="")
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"'{path}' cannot be read: {error}") from None
