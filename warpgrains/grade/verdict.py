"""What is said of a homework: to people, to a course's server, and in a table of many."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from warpgrains.grade.mistakes import MISTAKES

BOTH = "both together"

_ADVICE = {(mistake.function, mistake.name): mistake.advice for mistake in MISTAKES}
_COLORS = {"right": "32", "not run": "33"}  # else red


@dataclass(frozen=True)
class Part:
    """What is said of one function, or of both together.

    Attributes
    ----------
    name, status : str
        Status: right, wrong, missing, does not compile, or not run.
    scenes : mapping
        What is wrong in each scene, in words; empty: right.
    ended : str or None
        What it did instead of an answer, and where.
    mistakes : tuple of str
        Known mistakes that explain what is wrong.
    remark : str
        What else is known of it.
    printed : str
        The beginning of what it printed.
    warnings : tuple of str
        What the course forbids, though it may pass.
    """

    name: str
    status: str
    scenes: Mapping[str, str] = field(default_factory=dict)
    ended: str | None = None
    mistakes: tuple[str, ...] = ()
    remark: str = ""
    printed: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def first(self) -> str:
        """The first thing that is wrong."""
        return next(filter(None, self.scenes.values()), "")

    def advice(self) -> list[str]:
        """Return its mistakes, each with what to look at."""
        return [f"{name} ({_ADVICE[self.name, name]})" for name in self.mistakes]


@dataclass(frozen=True)
class Verdict:
    """What is said of a homework.

    Attributes
    ----------
    file : str
    compiler : str
        The compiler's own lines.
    parts : tuple of Part
        femGrainsUpdate, femGrainsContactIterate, and both; empty if it does not compile.
    warnings : tuple of str
        What the course forbids, though it may pass.
    problem : str
        Why it cannot be read; empty if it can.
    seconds : float
        Wall time [s].
    """

    file: str
    compiler: str = ""
    parts: tuple[Part, ...] = ()
    warnings: tuple[str, ...] = ()
    problem: str = ""
    seconds: float = 0.0

    @property
    def status(self) -> str:
        """In a word: right, wrong, does not compile, or cannot be read."""
        if self.problem:
            return "cannot be read"
        if not self.parts:
            return "does not compile"
        return "right" if all(part.status == "right" for part in self.parts) else "wrong"

    def text(self, color: bool) -> str:
        """Return the verdict as people read it."""
        lines = [f"{_printable(self.file)}: {_colored(self.status, color)}"]
        lines += [f"  warning: {warning}" for warning in self.warnings]
        lines += ["", *_printable(self.compiler).splitlines()] if self.compiler else []
        lines += ["", *self._table(color)] if self.parts else []
        alone = [part for part in self.parts if part.name != BOTH]
        told = alone if any(part.status != "right" for part in alone) else self.parts
        for part in told:
            if part.first or part.ended:
                lines += ["", part.name, f"  {_printable(part.first or part.ended or '')}"]
                lines += [f"  mistake: {each}" for each in part.advice()]
                lines += [f"  {part.remark}"] if part.remark else []
        return "\n".join(lines)

    def _table(self, color: bool) -> list[str]:
        scenes = list(next((part.scenes for part in self.parts if part.scenes), {}))
        width = max(len(part.name) for part in self.parts) + 2
        lines = ["".join([" " * width, *(f"{scene:<14}" for scene in scenes)]).rstrip()]
        for part in self.parts:
            words = [_word(part.scenes[scene]) for scene in scenes] if part.scenes else [part.status]
            cells = [_colored(word, color) + " " * (14 - len(word)) for word in words]
            lines.append("".join([f"{part.name:<{width}}", *cells]).rstrip())
        return lines

    def as_json(self) -> dict[str, Any]:
        """Return the verdict for a program: what its attributes say."""
        parts = [
            {
                "name": part.name,
                "status": part.status,
                "scenes": {scene: wrong or "right" for scene, wrong in part.scenes.items()},
                "ended": part.ended,
                "mistakes": list(part.mistakes),
                "advice": part.advice(),
                "remark": part.remark,
                "printed": part.printed,
            }
            for part in self.parts
        ]
        return {
            "file": self.file,
            "status": self.status,
            "problem": self.problem,
            "warnings": list(self.warnings),
            "compiler": self.compiler,
            "parts": parts,
            "seconds": self.seconds,
        }

    def as_row(self) -> dict[str, str]:
        """Return the verdict as a line of a table."""
        status = {part.name: part.status for part in self.parts}
        return {
            "file": self.file,
            "status": self.status,
            **{name: status.get(name, self.status) for name in _PARTS},
            "mistakes": "; ".join(name for part in self.parts for name in part.mistakes),
            "warnings": "; ".join(self.warnings),
            "first": next(
                filter(None, (part.first or part.ended for part in self.parts)), self._first_line()
            ),
        }

    def _first_line(self) -> str:
        """Return why nothing has run, if so."""
        if self.problem or self.parts:
            return self.problem
        return next((line for line in self.compiler.splitlines() if "error" in line), "")


_PARTS = ("femGrainsUpdate", "femGrainsContactIterate", BOTH)


def _word(wrong: str) -> str:
    return wrong if wrong == "not run" else "wrong" if wrong else "right"


def _colored(word: str, color: bool) -> str:
    return f"\x1b[{_COLORS.get(word, '31')}m{word}\x1b[0m" if color else word


def _printable(text: str) -> str:
    """Take away what could command a terminal."""
    return "".join(character for character in text if character.isprintable() or character == "\n")
