"""Homeworks written from the course text alone, without sight of the grader: 30 right ones and 60 wrong ones.

A homework is a style of each of its two functions (`iterate/`, `update/`), and, if it is wrong, edits of them
(`wrong.toml`).
"""

import tomllib
from pathlib import Path

HERE = Path(__file__).parent
ITERATE = sorted(path.stem for path in (HERE / "iterate").glob("*.c"))
UPDATE = sorted(path.stem for path in (HERE / "update").glob("*.c"))

# Every style of femGrainsContactIterate about twice, every style of femGrainsUpdate about four times.
RIGHT = [(ITERATE[k % len(ITERATE)], UPDATE[(k + k // len(UPDATE)) % len(UPDATE)]) for k in range(30)]


def source(iterate: str, update: str, edits: list[list[str]] | None = None) -> str:
    """Return the homework of two styles; raises ValueError unless each edited text occurs once."""
    first = HERE / "iterate" / f"{iterate}.c"
    second = HERE / "update" / f"{update}.c"
    text = (
        f'#include "fem.h"\n\n#ifndef NOCONTACTITERATE\n\n{first.read_text()}\n#endif\n'
        f"#ifndef NOUPDATE\n\n{second.read_text()}\n#endif\n"
    )
    for old, new in edits or []:
        if text.count(old) != 1:
            raise ValueError(f"{iterate}, {update}: found {text.count(old)} times: {old!r}")
        text = text.replace(old, new)
    return text


def wrong() -> list[tuple[list[str], str]]:
    """Return the names of the mistakes of each wrong homework, and its source."""
    table = tomllib.loads((HERE / "wrong.toml").read_text())
    cases = table["one"] + table["two"]
    return [(case["named"], source(*case["styles"], case["edits"])) for case in cases]
