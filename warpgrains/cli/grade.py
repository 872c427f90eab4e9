"""`warpgrains grade`: grade homeworks, and print or write what is right and wrong in them."""

import json
import os
import re
import sys
from argparse import Namespace
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from tqdm import tqdm

from warpgrains.console import in_columns, stop_on_signals
from warpgrains.errors import InputError, OutputError
from warpgrains.files import make_folder, read_table, require_writable_path, table_text, write_atomically
from warpgrains.grade.grader import Grader
from warpgrains.grade.page import GENERATOR, Pages
from warpgrains.grade.sandbox import Processes
from warpgrains.grade.template import write_template
from warpgrains.grade.verdict import Verdict
from warpgrains.locks import Lock

RIGHT, WRONG, NOT_GRADED = 0, 1, 2

_BAR = "{percentage:3.0f}%|{bar}| {n}/{total} homeworks [{elapsed}, {remaining} left]"


def grade(arguments: Namespace) -> int:
    """Grade a homework or a folder of homeworks, or write an empty one.

    Returns
    -------
    int
        0: all are right; 1: one is wrong; 2: one cannot be graded because it cannot be read or compiled.
    """
    if arguments.template is not None:
        others = ("homework", "output", "json", "strict", "html")
        if any(getattr(arguments, name) for name in others):
            raise InputError(
                "--template takes no other option and no HOMEWORK: it only writes an empty homework"
            )
        print("\n".join(map(str, write_template(Path(arguments.template)))))
        return RIGHT
    if arguments.homework is None:
        raise InputError(
            "HOMEWORK is missing: give a file or a folder, or --template to write an empty homework"
        )
    path = Path(arguments.homework)
    return _grade_folder(path, arguments) if path.is_dir() else _grade_one(path, arguments)


def _grade_one(path: Path, arguments: Namespace) -> int:
    if arguments.output is not None:
        raise InputError("-o needs a folder of homeworks: for one homework, use --json")
    if arguments.html is not None:
        _require_pages(Path(arguments.html))
    verdict = _grade_all([path], arguments.strict)[0]
    if verdict.problem:
        raise InputError(verdict.problem)
    if arguments.html is not None:
        write_atomically(
            Path(arguments.html) / "index.html", Pages(arguments.lang).homework(verdict).encode()
        )
    print(json.dumps(verdict.as_json()) if arguments.json else verdict.text(_has_color(), arguments.lang))
    return _code(verdict)


def _grade_folder(folder: Path, arguments: Namespace) -> int:
    paths = sorted(path for path in folder.rglob("*.c") if not path.is_dir())
    if not paths:
        raise InputError(f"folder '{folder}' holds no homework: no file ends in .c")
    if arguments.html is not None:
        _require_pages(Path(arguments.html))
    if arguments.output is None:
        if not arguments.json and arguments.html is None:
            raise InputError("a folder of homeworks needs -o TABLE.csv, --html DIR, or --json")
        verdicts = _grade_all(paths, arguments.strict)
    else:
        output = Path(arguments.output)
        require_writable_path("table", output, ".csv")
        with Lock(output):
            _require_table(output)
            verdicts = _grade_all(paths, arguments.strict)
            rows = [
                verdict.as_row(arguments.lang) | {"file": _in_utf8(str(path.relative_to(folder)))}
                for path, verdict in zip(paths, verdicts, strict=True)
            ]
            write_atomically(output, table_text(rows).encode())
    if arguments.html is not None:
        names = [_in_utf8(str(path.relative_to(folder))) for path in paths]
        named = [replace(verdict, file=name) for verdict, name in zip(verdicts, names, strict=True)]
        _write_pages(Path(arguments.html), named, arguments.lang)
    if arguments.json:
        print(json.dumps([verdict.as_json() for verdict in verdicts]))
    else:
        print(_lines(verdicts, arguments.output, arguments.html))
    return max(map(_code, verdicts))


def _write_pages(folder: Path, verdicts: list[Verdict], language: str) -> None:
    """Write a page for each homework of a class, and an index page."""
    pages = Pages(language)
    links = [f"{k:03}_{re.sub(r'[^A-Za-z0-9.-]', '_', v.file)[-100:]}.html" for k, v in enumerate(verdicts)]
    for verdict, link in zip(verdicts, links, strict=True):
        write_atomically(folder / link, pages.homework(verdict).encode())
    write_atomically(folder / "index.html", pages.course(verdicts, links).encode())


def _require_pages(folder: Path) -> None:
    """Create a folder for pages. Raises OutputError if its index is not a page of `warpgrains grade`."""
    make_folder(folder)
    index = folder / "index.html"
    if index.exists() and GENERATOR not in index.read_text(errors="replace"):
        raise OutputError(f"refusing to overwrite '{index}': not a page of warpgrains grade")


def _grade_all(paths: list[Path], strict: bool) -> list[Verdict]:
    """Grade homeworks in parallel."""
    processes = Processes()
    with (
        stop_on_signals(processes.stop),
        TemporaryDirectory() as folder,
        ThreadPoolExecutor(os.cpu_count()) as pool,
    ):
        # The grader, too, starts its processes in a thread, because signals interrupt the main thread.
        grader = pool.submit(Grader, Path(folder), strict, processes=processes).result()
        for warning in grader.unprotected():
            print(f"warpgrains: warning: {warning}", file=sys.stderr)

        def grade_one(path: Path) -> Verdict:
            try:
                verdict = grader.grade(path)
            except InputError as error:
                verdict = Verdict(str(path), problem=_in_utf8(str(error)))
            return replace(verdict, file=_in_utf8(str(path)))

        is_quiet = len(paths) == 1 or not sys.stderr.isatty()
        return list(tqdm(pool.map(grade_one, paths), total=len(paths), bar_format=_BAR, disable=is_quiet))


def _require_table(output: Path) -> None:
    """Raise OutputError if the file exists and is no table of grades."""
    if output.exists() and not {"file", "status", "mistakes"} <= set((read_table(output) or [{}])[0]):
        raise OutputError(f"refusing to overwrite '{output}': not a table of grades")


def _lines(verdicts: list[Verdict], table: str | None, pages: str | None) -> str:
    counts = Counter(str(verdict.status) for verdict in verdicts)
    rows = {
        "homeworks": len(verdicts),
        "right": counts["right"],
        "wrong": counts["wrong"],
        "not compiled": counts["does not compile"],
        "not read": counts["cannot be read"],
        "with warnings": sum(bool(verdict.warnings) for verdict in verdicts),
        **({"table": _in_utf8(table)} if table else {}),
        **({"pages": _in_utf8(pages)} if pages else {}),
    }
    return in_columns(rows)


def _in_utf8(text: str) -> str:
    """Escape those bytes of a file name that are not UTF-8, as Python does."""
    return text.encode(errors="surrogateescape").decode(errors="backslashreplace")


def _has_color() -> bool:
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ


def _code(verdict: Verdict) -> int:
    return {"right": RIGHT, "wrong": WRONG}.get(str(verdict.status), NOT_GRADED)
