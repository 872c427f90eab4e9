"""Tables of results, in CSV."""

import csv
import io
from pathlib import Path

from warpgrains.errors import SceneError

Row = dict[str, str]
"""A line of a table: what its cells hold, by column."""


def table_text(rows: list[Row]) -> str:
    """Return a table as CSV: names in the first line, then a line a row."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def read_table(path: Path) -> list[Row]:
    """Read a table.

    Raises
    ------
    SceneError
        It is not there, or no table.
    """
    try:
        with path.open(newline="", encoding="utf-8") as lines:
            return list(csv.DictReader(lines, strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SceneError(f"'{path}' cannot be read: {error}") from None
