"""`warpgrains grade`: grade homeworks, and print or write what is right and wrong in them."""

import json
import os
import re
import sys
from argparse import Namespace
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from tqdm import tqdm

from warpgrains.base.checks import whole_number
from warpgrains.base.console import in_columns, printable, stop_on_signals
from warpgrains.base.errors import InputError, OutputError
from warpgrains.base.files import (
    make_folder,
    read_regular,
    read_table,
    require_writable_path,
    table_text,
    write_atomically,
)
from warpgrains.base.locks import lock_own
from warpgrains.grade.grader import Grader
from warpgrains.grade.page import GENERATOR, Pages
from warpgrains.grade.sandbox import Processes
from warpgrains.grade.verdict import Verdict, points_of
from warpgrains.grade.words import LANGUAGES, Words, in_language
from warpgrains.reference.reference import SOURCE

RESULTS = {"right": 0, "wrong": 1}
NOT_GRADED = 2
"""Exit code for any status of a homework that `RESULTS` lacks; the largest code of all is returned."""
INDEX = "index.html"

_BAR = "{percentage:3.0f}%|{bar}| {n}/{total} homeworks [{elapsed}, {remaining} left]"


def grade(arguments: Namespace) -> int:
    """Grade homeworks, or write an empty one; return 0 if all are right, 2 if any is not graded, else 1."""
    if arguments.template is not None:
        others = ("homework", "output", "json", "strict", "html", "seed", "points")
        if any(getattr(arguments, name) not in (None, False, []) for name in others):
            raise InputError(
                "--template takes no other option and no HOMEWORK: it only writes an empty homework"
            )
        print("\n".join(map(str, write_template(Path(arguments.template)))))
        return False
    if not arguments.homework:
        raise InputError(
            "HOMEWORK is missing: give a file or a folder, or --template to write an empty homework"
        )
    if arguments.seed is not None:
        whole_number("--seed", arguments.seed, least=0)
    paths, table, site = [Path(name) for name in arguments.homework], arguments.output, arguments.html
    path, points = paths[0], None if arguments.points is None else points_of("--points", arguments.points)
    is_folder = len(paths) == 1 and path.is_dir()
    is_class = is_folder or len(paths) > 1
    if is_folder:
        paths = sorted(each for each in path.rglob("*.c") if not each.is_dir())
    if not paths:
        raise InputError(f"folder '{path}' holds no homework: no file ends in .c")
    if is_class and table is site is None and not arguments.json:
        raise InputError("several homeworks need -o TABLE.csv, --html DIR, or --json")
    if not is_class and table is not None:
        raise InputError("-o needs several homeworks: for one homework, use --json")
    with ExitStack() as held:
        if site is not None:
            make_folder(Path(site))
            held.enter_context(lock_own(Path(site, INDEX), _is_page, "page of warpgrains grade"))
        if table is not None:
            require_writable_path("table", Path(table), ".csv")
            held.enter_context(lock_own(Path(table), _is_table, "table of grades"))
        verdicts = _grade_all(paths, arguments.strict, arguments.seed, path if is_folder else None)
        if not is_class and verdicts[0].problem:
            raise InputError(verdicts[0].problem)
        verdicts = [replace(verdict, points=points) for verdict in verdicts]
        names = [printable(str(each.relative_to(path) if is_folder else each)) for each in paths]
        named = [replace(verdict, file=name) for verdict, name in zip(verdicts, names, strict=True)]
        if table is not None:
            rows = [verdict.as_row(arguments.lang) for verdict in named]
            write_atomically(Path(table), table_text(rows).encode())
        if site is not None:
            _write_pages(Path(site), named, arguments.lang, is_class)
    if arguments.json:
        told = [verdict.as_json() for verdict in verdicts]
        print(json.dumps(told if is_class else told[0]))
    else:
        has_color = sys.stdout.isatty() and "NO_COLOR" not in os.environ
        language = arguments.lang
        print(_lines(verdicts, table, site, language) if is_class else verdicts[0].text(has_color, language))
    return max(RESULTS.get(verdict.status, NOT_GRADED) for verdict in verdicts)


def _write_pages(folder: Path, verdicts: list[Verdict], language: str, is_class: bool) -> None:
    """Write the page of one homework; for a class, write a page per homework and an index page."""
    pages, links = Pages(language), [INDEX]
    if is_class:
        safe = [re.sub(r"[^A-Za-z0-9.-]", "_", verdict.file)[-100:] for verdict in verdicts]
        links = [f"{k:03}_{name}.html" for k, name in enumerate(safe)]
    for verdict, link in zip(verdicts, links, strict=True):
        write_atomically(folder / link, pages.homework(verdict).encode())
    if is_class:
        write_atomically(folder / INDEX, pages.course(verdicts, links).encode())


def _grade_all(paths: list[Path], strict: bool, seed: int | None, folder: Path | None) -> list[Verdict]:
    """Grade homeworks in parallel, and return the verdicts in order of the paths.

    If `folder` is given, links to files outside of this folder are refused.
    """
    processes = Processes()
    with (
        stop_on_signals(processes.stop),
        TemporaryDirectory() as compiled,
        ThreadPoolExecutor(os.cpu_count()) as pool,
    ):
        # The grader, too, starts its processes in a thread, because signals interrupt the main thread.
        grader = pool.submit(Grader, Path(compiled), strict, processes=processes, seed=seed).result()
        for warning in grader.unprotected():
            print(f"warpgrains: warning: {warning}", file=sys.stderr)

        def grade_one(path: Path) -> Verdict:
            try:
                if folder and not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
                    raise InputError(f"'{path}' is a link to a file outside of the folder")
                verdict = grader.grade(path)
            except InputError as error:
                verdict = Verdict(str(path), problem=printable(str(error)))
            return replace(verdict, file=printable(str(path)))

        is_quiet = len(paths) == 1 or not sys.stderr.isatty()
        return list(tqdm(pool.map(grade_one, paths), total=len(paths), bar_format=_BAR, disable=is_quiet))


def _is_page(path: Path) -> bool:
    return GENERATOR.encode() in read_regular(path)


def _is_table(path: Path) -> bool:
    found = set((read_table(path) or [{}])[0])
    heads = [Words(name) for name in ("file", "status", "mistakes")]
    return any({in_language(head, language) for head in heads} <= found for language in LANGUAGES)


def _lines(verdicts: list[Verdict], table: str | None, pages: str | None, language: str) -> str:
    counts = Counter(str(verdict.status) for verdict in verdicts)
    rows = {
        "homeworks": len(verdicts),
        "right": counts["right"],
        "wrong": counts["wrong"],
        "not compiled": counts["does not compile"],
        "not read": counts["cannot be read"],
        "with warnings": sum(bool(verdict.warnings) for verdict in verdicts),
        **({"table": printable(table)} if table else {}),
        **({"pages": printable(pages)} if pages else {}),
    }
    return in_columns({in_language(Words(name), language): value for name, value in rows.items()})


def write_template(folder: Path) -> list[Path]:
    """Write an empty homework to a folder; return its files. OutputError, and no file, if one exists."""
    sources = [*sorted((Path(__file__).parents[1] / "grade" / "template").iterdir()), SOURCE.parent / "fem.h"]
    make_folder(folder)
    targets = [folder / source.name for source in sources]
    for target in targets:
        if target.exists():
            raise OutputError(f"refusing to overwrite '{target}': nothing was written")
    for source, target in zip(sources, targets, strict=True):
        # students do not get what only the reference uses
        text = re.sub(r"^#ifdef REFERENCE\n.*?^#endif\n", "", source.read_text(), flags=re.M | re.S)
        write_atomically(target, text.encode())
    return targets
