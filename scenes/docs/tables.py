"""Write the tables of the pages from the code and the results of benches: `python scenes/docs/tables.py`.

A table stands between the comments `<!-- table: NAME -->` and `<!-- end of table -->` of a page.
"""

import csv
import re
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

from tests.bench.__main__ import BENCHES
from tests.bench.plane_shear import FIGURES, error
from warpgrains.analysis.quantity_table import GROUPS, OF_WALLS, QUANTITIES
from warpgrains.cli.scenes import Key, exchange_keys, keys, wall_keys
from warpgrains.scene.layouts import LAYOUTS
from warpgrains.scene.radii import DISTRIBUTIONS, OF_MEAN
from warpgrains.scene.reader import keyword_parameters
from warpgrains.sweep import axes, sweep
from warpgrains.sweep.results import COLUMNS

ROOT = Path(__file__).parents[2]
OURS = "warpgrains"
OVERLAPS = 1e-1, 1e-2, 1e-3  # radii
ACCURACY = 0.1  # relative error in a shear
_TABLE = re.compile(r"(?<=<!-- table: )(\w+)( -->\n).*?(?=<!-- end of table -->)", re.S)


def _scene() -> Iterable[Sequence[str]]:
    yield "key", "unit", "default", "meaning"
    for key in keys(None):
        yield f"`{key.section}.{key.name}`", key.unit, _code(key.shown_default), key.meaning


def _layouts() -> Iterable[Sequence[str]]:
    yield "layout", "key", "unit", "default", "meaning"
    found: dict[Key, list[str]] = {}
    for layout, function in LAYOUTS.items():
        for key in keys(layout):
            if key.section == "grains" and key.name in keyword_parameters(function):
                found.setdefault(key, []).append(layout)
    for key, layouts in sorted(found.items(), key=lambda item: -len(item[1])):
        yield ", ".join(layouts), f"`{key.name}`", key.unit, _code(key.shown_default), key.meaning


def _walls() -> Iterable[Sequence[str]]:
    yield "key", "unit", "default", "meaning"
    for key in wall_keys():
        yield f"`{key.name}`", key.unit, _code(key.shown_default), key.meaning


def _exchange() -> Iterable[Sequence[str]]:
    yield "key", "unit", "default", "meaning"
    for key in exchange_keys():
        yield f"`{key.section}.{key.name}`", key.unit, _code(key.shown_default), key.meaning


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
    for name, found in OF_WALLS.items():
        yield "", f"`{name}:WALL`", found.unit, found.meaning


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


def _measured(bench: str) -> list[dict[str, str]]:
    with (ROOT / "tests/bench/results" / f"{bench}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def _benches() -> Iterable[Sequence[str]]:
    yield "bench", "what it measures", "commit", "date", "processor"
    for name, bench in BENCHES.items():
        file = f"[`{name}`](../../tests/bench/results/{name}.csv)"
        rows = _measured(name)
        stamps = (dict.fromkeys(row[key] for row in rows) for key in ("commit", "date", "processor"))
        yield file, bench.measures, *(", ".join(values) for values in stamps)


def _compared(bench: str) -> Iterable[Sequence[str]]:
    """Yield the rows of a bench that compares medians, with missed aims in bold."""
    yield "what", "grains", "threads", "median", "compared with", "its median", "ratio", "aim"
    for row in _measured(bench):
        unit, other, target = row["unit"], row["its median"], row["target"]
        sign = "x faster" if row["ratio is"].startswith("its") else "x"
        missed = target and not _is_reached(float(row["ratio"] or row["median"]), target)
        yield (
            row["name"],
            f"{int(row['n']):,}",
            row["threads"],
            f"{_plain(row['median'])} {unit}",
            row["compared with"],
            f"{_plain(other)} {unit}" if other else "",
            f"{_plain(row['ratio'])} {sign}" if other else "",
            f"**{target}: missed**" if missed else target,
        )


def _is_reached(value: float, target: str) -> bool:
    sign, limit = target.split()
    return value <= float(limit) if sign == "<=" else value >= float(limit)


def _plain(number: str) -> str:
    value = float(number)
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _ratios(bench: str, head: str) -> Iterable[Sequence[str]]:
    rows = _measured(bench)
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    yield head, *scenes
    for feature in dict.fromkeys(row["feature"] for row in rows):
        own = {row["scene"]: row for row in rows if row["feature"] == feature}
        numbers = ([float(own[scene][f"ratio_{of}"]) for of in ("median", "min", "max")] for scene in scenes)
        yield feature, *("{:.2f} ({:.2f} to {:.2f})".format(*values) for values in numbers)


def _cheapest(friction: str, n: int, most: float, programs: re.Pattern[str]) -> dict[str, str] | None:
    """Return the fastest setting of programs that keeps overlaps of grains below `most` [radii]."""
    fit = (row for row in _measured("peers") if (row["friction"], int(row["n"])) == (friction, n))
    fit = (
        row for row in fit if programs.fullmatch(row["program"]) and float(row["overlap of pairs"]) <= most
    )
    return min(fit, key=lambda row: float(row["ms of 10 ms"]), default=None)


def _speed() -> Iterable[Sequence[str]]:
    frictions = {"0": "", "0.5": " with friction"}
    heads = ([f"{OURS}{text}", f"fastest other program{text}"] for text in frictions.values())
    yield "overlaps below [radii]", *(head for pair in heads for head in pair)
    for most in OVERLAPS:
        cells = []
        for friction, ours in ((friction, ours) for friction in frictions for ours in (True, False)):
            row = _cheapest(friction, 1000, most, re.compile(f"{OURS}.*" if ours else f"(?!{OURS}).*"))
            name = "" if ours or not row else f" ({row['program']})"
            cells.append(f"{_plain(row['ms of 10 ms'])} ms{name}" if row else "none")
        yield f"{most:g}", *cells


def _over_grains() -> Iterable[Sequence[str]]:
    rows = _measured("peers")
    columns = [(friction, n) for friction in ("0", "0.5") for n in sorted({int(row["n"]) for row in rows})]
    yield "program", *(f"{n:,}{', friction' if friction != '0' else ''}" for friction, n in columns)
    for program in dict.fromkeys(row["program"] for row in rows):
        found = (_cheapest(*column, OVERLAPS[1], re.compile(re.escape(program))) for column in columns)
        yield (
            program,
            *(f"{_plain(row['ms of 10 ms'])} ({row['overlap of pairs']})" if row else "" for row in found),
        )


def _shear() -> Iterable[Sequence[str]]:
    """Yield the fastest setting of each program that measures mu, phi and rate accurately, if one does."""
    yield "grains", "I", "program", "fastest setting", "a unit of strain", *FIGURES, "worst overlap [radii]"
    rows = _measured("shear")
    cases: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in rows:
        cases.setdefault((row["n"], row["I"]), []).append(row)
    for (n, number), case in cases.items():
        for program in dict.fromkeys(row["program"] for row in case):
            fit = (row for row in case if row["program"] == program and error(row, case) <= ACCURACY)
            best = min(fit, key=lambda row: float(row["s of a strain"]), default=None)
            head = f"{int(n):,}", number, program
            if best is None:
                yield *head, "none", *("" for _ in (0, *FIGURES, 0))
            else:
                values = (f"{best[name]} +- {best[f'error of {name}']}" for name in FIGURES)
                time, overlap = f"{_plain(best['s of a strain'])} s", best["worst overlap"]
                yield *head, best["setting"], time, *values, overlap


TABLES = {
    "benches": _benches,
    **{name: partial(_compared, name) for name in ("threads", "moving", "step", "batch", "exact", "gpu")},
    "features": partial(_ratios, "features", "feature"),
    "measuring": partial(_ratios, "measuring", "measured after each step"),
    "speed": _speed,
    "over_grains": _over_grains,
    "shear": _shear,
    "scene": _scene,
    "layouts": _layouts,
    "walls": _walls,
    "exchange": _exchange,
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
    for path in [ROOT / "README.md", *sorted(Path(__file__).parent.glob("*.md"))]:
        path.write_text(with_tables(path.read_text()))
