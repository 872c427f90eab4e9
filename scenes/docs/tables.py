"""Write the tables of keys in the pages from the code: `python scenes/docs/tables.py`.

A table stands between the comments `<!-- table: NAME -->` and `<!-- end of table -->` of a page.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from warpgrains.analysis.quantities import GROUPS, QUANTITIES
from warpgrains.cli.scenes import keys, wall_keys
from warpgrains.scene.radii import DISTRIBUTIONS, OF_MEAN
from warpgrains.sweep import axes, sweep
from warpgrains.sweep.results import COLUMNS

_TABLE = re.compile(r"(?<=<!-- table: )(\w+)( -->\n).*?(?=<!-- end of table -->)", re.S)


def _scene() -> Iterable[Sequence[str]]:
    yield "key", "unit", "default", "meaning"
    for key in keys(None):
        yield f"`{key.section}.{key.name}`", key.unit, _code(key.shown_default), key.meaning


def _walls() -> Iterable[Sequence[str]]:
    yield "key", "unit", "default", "meaning"
    for key in wall_keys():
        yield f"`{key.name}`", key.unit, _code(key.shown_default), key.meaning


def _code(text: str) -> str:
    return f"`{text}`" if re.search(r"[\d\"{[]", text) else text


def _radii() -> Iterable[Sequence[str]]:
    yield "distribution", "keys", "default"
    for name, own in DISTRIBUTIONS.items():
        bounds = [f"{key} = {share:g} mean" for key, share in OF_MEAN.items() if "mean" in own and key in own]
        default = ", ".join(bounds) or ("equal fractions" if "fractions" in own else "none")
        yield f"`{name}`", ", ".join(f"`{key}`" for key in own), default


def _quantities() -> Iterable[Sequence[str]]:
    yield "group", "quantity", "unit", "meaning"
    for group, names in GROUPS.items():
        for name in names:
            found = QUANTITIES[name]
            yield f"`{group}`", f"`{name}`", found.unit or "1", found.meaning


def _columns() -> Iterable[Sequence[str]]:
    yield "column", "unit", "meaning"
    for name, column in COLUMNS.items():
        yield f"`{name}`", column.unit or "1", column.meaning


def _of_docstring(text: str | None) -> Iterable[Sequence[str]]:
    """Yield the rows of the reStructuredText table in a docstring, whose first line rules the columns."""
    rule, head, _, *lines = re.search(r"^=[= ]+$.*?^=[= ]+$.*?(?=^=[= ]+$)", text or "", re.M | re.S)[
        0
    ].splitlines()
    starts = [found.start() for found in re.finditer("=+", rule)]
    rows: list[list[str]] = []
    for line in (head, *lines):
        cells = [line[a:b].strip() for a, b in zip(starts, [*starts[1:], None], strict=True)]
        if cells[0]:
            rows.append(["" if cell == ".." else cell for cell in cells])
        else:
            rows[-1] = [f"{old} {new}".strip() for old, new in zip(rows[-1], cells, strict=True)]
    return rows


TABLES = {
    "scene": _scene,
    "walls": _walls,
    "radii": _radii,
    "quantities": _quantities,
    "columns": _columns,
    "axes": lambda: ([_code(row[0]), row[1]] for row in _of_docstring(axes.__doc__)),
    "sweep": lambda: _of_docstring(sweep.__doc__),
}


def _markdown(rows: Iterable[Sequence[str]]) -> str:
    head, *body = ([cell.replace("|", "\\|").replace("``", "`") for cell in row] for row in rows)
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, ["---"] * len(head), *body))


def with_tables(page: str) -> str:
    """Return the text of a page with its tables as the code has them now."""
    return _TABLE.sub(lambda found: f"{found[1]}{found[2]}{_markdown(TABLES[found[1]]())}", page)


if __name__ == "__main__":
    for path in sorted(Path(__file__).parent.glob("*.md")):
        path.write_text(with_tables(path.read_text()))
