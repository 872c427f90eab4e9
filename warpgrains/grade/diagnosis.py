"""Which of the known mistakes explain what a homework does: each is run, and what it does compared."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from warpgrains.grade.child import Answer, Child, Function
from warpgrains.grade.compare import difference
from warpgrains.grade.compiler import CONTACT, UPDATE, WITHOUT, Compiler
from warpgrains.grade.mistake import Mistake
from warpgrains.grade.mistakes import MISTAKES
from warpgrains.grade.probes import Probe

Answers = Sequence[Answer]

_AT_ONCE = 3  # mistakes that are looked for in one function
_PRIVATE = re.compile(r"^static double (\w+)\(", re.MULTILINE)


def answers_of_mistakes(
    function: str,
    compiler: Compiler,
    folder: Path,
    start: Callable[[Function], Child],
    probes: Sequence[Probe],
) -> dict[str, list[Answer]]:
    """Return what the reference with each of the mistakes in a function answers, by the mistake's name.

    `start` starts a child with that function, and the reference's other one.
    """
    mistakes = [mistake for mistake in MISTAKES if mistake.function == function]
    library = _compile(mistakes, function, compiler, folder)
    answers = {}
    for number, mistake in enumerate(mistakes):
        with start(Function(library, f"{function}_{number}")) as child:
            answers[mistake.name] = [child.ask(probe.call) for probe in probes]
    return answers


def _compile(mistakes: Sequence[Mistake], function: str, compiler: Compiler, folder: Path) -> Path:
    """Compile all of them at once, each with names of its own."""
    other = WITHOUT[CONTACT if function == UPDATE else UPDATE].removeprefix("-D")
    text = f"#define {other}\n#define NOCREATE\n"
    for number, mistake in enumerate(mistakes):
        names = (function, "femGrainsContactIterateOrder", *_PRIVATE.findall(mistake.source()))
        text += "".join(f"#define {name} {name}_{number}\n" for name in names)
        text += mistake.source() + "".join(f"#undef {name}\n" for name in names)
    source = folder / f"{function}.c"
    source.write_text(text)
    return compiler.compile_library(source, folder, ("-O0",))


def explain(
    probes: Sequence[Probe], expected: Answers, found: Answers, mistakes: Mapping[str, Answers]
) -> tuple[list[str], int]:
    """Name the mistakes that explain what a homework answers, and say how many wrong answers none explains.

    One that does the same in all calls is the mistake. Else several that together do the same in those calls
    that differ from the reference, and nothing else in the others: two mistakes that show in different calls.
    It may have answered the first calls only. What explains less than half of them explains nothing.
    """

    def agrees(answers: Answers, k: int) -> bool:
        return difference(probes[k], answers[k], found[k]) is None

    right = [k for k in range(len(found)) if agrees(expected, k)]
    wrong = set(range(len(found))) - set(right)
    explained: dict[str, set[int]] = {}
    for name, answers in mistakes.items():
        if wrong and all(agrees(answers, k) for k in right):
            explained[name] = {k for k in wrong if agrees(answers, k)}
    many = len(wrong)
    names: list[str] = []
    while wrong and explained and len(names) < _AT_ONCE:
        best = max(explained, key=lambda name: len(explained[name] & wrong))
        if not explained[best] & wrong:
            break
        names.append(best)
        wrong -= explained[best]
    return ([] if 2 * len(wrong) > many else names), len(wrong)
