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


def source(iterate, update, edits=()):
    """Return the homework of two styles, in which each edited text occurs once."""
    first, second = ((HERE / f"{name}.c").read_text() for name in (f"iterate/{iterate}", f"update/{update}"))
    text = (
        f'#include "fem.h"\n\n#ifndef NOCONTACTITERATE\n\n{first}\n#endif\n'
        f"#ifndef NOUPDATE\n\n{second}\n#endif\n"
    )
    for old, new in edits:
        assert text.count(old) == 1, (iterate, update, old)
        text = text.replace(old, new)
    return text


def right():
    """Return the right homeworks, each by a name."""
    return {f"{styles[0]}, {styles[1]}": source(*styles) for styles in RIGHT}


def wrong(kind):
    """Return the names of the mistakes of each wrong homework with "one" mistake or "two", and its source."""
    table = tomllib.loads((HERE / "wrong.toml").read_text())
    return {str(one["what"]): (one["named"], source(*one["styles"], one["edits"])) for one in table[kind]}
