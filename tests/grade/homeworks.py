"""Right, wrong and hostile homeworks, written from the course text alone, without the reference.

Thirty right ones and 60 wrong ones are a style of each of the two functions (`written/iterate/`,
`written/update/`), and edits if they are wrong (`written/homeworks.toml`); others are changes of a plain one.
"""

import tomllib
from pathlib import Path

HERE = Path(__file__).parent
PLAIN, HELPERS, OWN_ARRAYS = (
    (HERE / f"right/{name}.c").read_text() for name in ("plain", "helpers", "own_arrays")
)
_TABLE = tomllib.loads((HERE / "written/homeworks.toml").read_text())


def changed(*edits, text=PLAIN):
    """Return the plain homework with some texts replaced."""
    for right, instead in edits:
        assert right in text, right
        text = text.replace(right, instead)
    return text


MAIN = "int main(void) { return 0; }\n"
RIGHT = {
    "helpers, no markers, columns first": (HELPERS, ["#ifndef"]),
    "a program, and a marker with another name": (
        PLAIN.replace("NOUPDATE", "UPDATE") + MAIN,
        ["main", "#ifndef"],
    ),
    "own arrays, other sums": (OWN_ARRAYS, []),
    "the course's style, a program that is left out": (f"{PLAIN}#ifdef TEST\n{MAIN}#endif\n", []),
    "one marker": (PLAIN.replace("#ifndef NOUPDATE", "#if 1"), ["#ifndef"]),
    "fast math": (f'#pragma GCC optimize("O3,fast-math")\n{PLAIN}', []),
    **{name: (changed(*edits), []) for name, edits in _TABLE["right"].items()},
}
"""Homeworks, and a word of each warning that they get."""

PLAIN_WRONG = {mistake: changed(*edits) for mistake, edits in _TABLE["plain"].items()}
"""The plain homework with one mistake, by its name."""
UNKNOWN, DRAWN, UNSET = (_TABLE[kind] for kind in ("unknown", "drawn", "unset"))


def of_styles(iterate, update, edits=()):
    """Return the homework of two styles, in which each edited text occurs once."""
    first, second = (
        (HERE / f"written/{name}.c").read_text() for name in (f"iterate/{iterate}", f"update/{update}")
    )
    text = (
        f'#include "fem.h"\n\n#ifndef NOCONTACTITERATE\n\n{first}\n#endif\n'
        f"#ifndef NOUPDATE\n\n{second}\n#endif\n"
    )
    assert all(text.count(old) == 1 for old, _ in edits), (iterate, update)
    return changed(*edits, text=text)


def right_of_styles():
    """Return every style of femGrainsContactIterate about twice, of femGrainsUpdate about four times."""
    iterate, update = (
        sorted(path.stem for path in (HERE / "written" / of).glob("*.c")) for of in ("iterate", "update")
    )
    pairs = [(iterate[k % len(iterate)], update[(k + k // len(update)) % len(update)]) for k in range(30)]
    return {", ".join(styles): (of_styles(*styles), []) for styles in pairs}


def wrong_of_styles(kind):
    """Return the names of the mistakes of each wrong homework with "one" mistake or "two", and its source."""
    return {str(one["what"]): (one["named"], of_styles(*one["styles"], one["edits"])) for one in _TABLE[kind]}


BEFORE = (HERE / "hostile/before.h").read_text()
_HOSTILE = tomllib.loads((HERE / "hostile/hostile.toml").read_text())
HOSTILE, SNOOPING, CHEATING = (_HOSTILE[kind] for kind in ("hostile", "snooping", "cheating"))


def contact_that(does, before=""):
    """Return a homework whose femGrainsContactIterate does something else first."""
    start = "    double zeta = 0.0;\n"
    return changed(
        (start, f"{start}    {does}\n"), ('#include "fem.h"\n', f'#include "fem.h"\n{BEFORE}{before}\n')
    )
