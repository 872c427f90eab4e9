"""`warpgrains grade`: say what is right and what is wrong in homeworks."""

import json
import os
import sys
from argparse import Namespace
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

from tqdm import tqdm

from warpgrains.console import in_columns
from warpgrains.errors import OutputError, SceneError
from warpgrains.files import read_table, require_place, table_text, write_whole
from warpgrains.grade.grader import Grader
from warpgrains.grade.template import write_template
from warpgrains.grade.verdict import Verdict
from warpgrains.locks import Lock

RIGHT, WRONG, NOT_GRADED = 0, 1, 2

_BAR = "{percentage:3.0f}%|{bar}| {n}/{total} homeworks [{elapsed}, {remaining} left]"


def grade(arguments: Namespace) -> int:
    """Grade a homework or a folder of them, or write an empty one.

    Returns
    -------
    int
        0: all are right; 1: one is wrong; 2: one cannot be graded, as it does not compile.
    """
    if arguments.template is not None:
        if arguments.homework or arguments.output or arguments.json or arguments.strict:
            raise SceneError("--template goes alone: it writes an empty homework")
        print("\n".join(map(str, write_template(Path(arguments.template)))))
        return RIGHT
    if arguments.homework is None:
        raise SceneError("HOMEWORK is missing, or --template to write an empty one")
    path = Path(arguments.homework)
    return _grade_folder(path, arguments) if path.is_dir() else _grade_one(path, arguments)


def _grade_one(path: Path, arguments: Namespace) -> int:
    if arguments.output is not None:
        raise SceneError("-o needs a folder of homeworks; --json prints the verdict on one")
    verdict = _grade_all([path], arguments.strict)[0]
    print(json.dumps(verdict.as_json()) if arguments.json else verdict.text(_has_color()))
    return _code(verdict)


def _grade_folder(folder: Path, arguments: Namespace) -> int:
    paths = sorted(path for path in folder.rglob("*.c") if path.is_file())
    if not paths:
        raise SceneError(f"folder '{folder}' holds no homework: no file ends in .c")
    if arguments.output is None:
        if not arguments.json:
            raise SceneError("a folder of homeworks needs -o TABLE.csv, or --json")
        verdicts = _grade_all(paths, arguments.strict)
    else:
        output = Path(arguments.output)
        require_place("table", output, ".csv")
        with Lock(output):
            _require_table(output)
            verdicts = _grade_all(paths, arguments.strict)
            rows = [
                verdict.as_row() | {"file": str(path.relative_to(folder))}
                for path, verdict in zip(paths, verdicts, strict=True)
            ]
            write_whole(output, table_text(rows).encode())
    print(
        json.dumps([verdict.as_json() for verdict in verdicts])
        if arguments.json
        else _lines(verdicts, output)
    )
    return max(map(_code, verdicts))


def _grade_all(paths: list[Path], strict: bool) -> list[Verdict]:
    """Grade homeworks side by side."""
    with TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as pool:
        grader = Grader(Path(folder), strict)
        if not grader.confined:
            unsafe = "this system has no filter of system calls: homeworks can open files and start processes"
            print(f"warpgrains: warning: {unsafe}", file=sys.stderr)
        is_quiet = len(paths) == 1 or not sys.stderr.isatty()
        return list(tqdm(pool.map(grader.grade, paths), total=len(paths), bar_format=_BAR, disable=is_quiet))


def _require_table(output: Path) -> None:
    """Raise OutputError if a file is there that is no table of grades."""
    if output.exists() and not {"file", "status", "mistakes"} <= set((read_table(output) or [{}])[0]):
        raise OutputError(f"'{output}' is there, and no table of grades: it is left as it is")


def _lines(verdicts: list[Verdict], output: Path) -> str:
    counts = [sum(_code(verdict) == code for verdict in verdicts) for code in (RIGHT, WRONG, NOT_GRADED)]
    rows = {
        "homeworks": len(verdicts),
        **dict(zip(("right", "wrong", "not compiled"), counts, strict=True)),
        "table": output,
    }
    return in_columns(rows)


def _has_color() -> bool:
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ


def _code(verdict: Verdict) -> int:
    return {"right": RIGHT, "wrong": WRONG}.get(verdict.status, NOT_GRADED)
