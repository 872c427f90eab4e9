"""The verdict on a homework, for people, for a course's server, and for the table of a class."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from warpgrains.base.console import printable
from warpgrains.base.errors import InputError
from warpgrains.grade.diagnosis import Hint, Mistake
from warpgrains.grade.sandbox import CONTACT, FIELDS, UPDATE, Answer, Call
from warpgrains.grade.words import Words, in_language, joined

BOTH = "both together"
MOST_SHOWN = 3  # largest number of grains of a scene that is printed

NOTHING = Words("", "")

_PARTS = (UPDATE, CONTACT, BOTH)
_COLORS = {"right": "32", "not run": "33"}  # red by default


class Shown(NamedTuple):
    """The call with the fewest grains that has a wrong answer, with both answers."""

    call: Call
    expected: Answer
    found: Answer

    def rows(self) -> list[list[str]]:
        """Return the scene before the call as a table: column names, then one row per grain."""
        arrays = self.call.state[: 7 * self.call.n].reshape(7, -1).T
        rows = [[str(i), *(f"{value:.6g}" for value in row)] for i, row in enumerate(arrays)]
        return [["", *FIELDS[:7]], *rows]

    def numbers(self) -> Words:
        """Return the parameters of the call as C assignments."""
        call = self.call
        numbers: dict[str, float] = {"iter": call.iteration} if call.iteration >= 0 else {}
        numbers |= {"dt": call.dt}
        numbers |= {"tol": call.tolerance, "iterMax": call.max_iterations} if call.iteration < 0 else {}
        numbers |= {"radiusIn": call.radius_in, "radiusOut": call.radius_out}
        numbers |= {"gravity[0]": call.gravity[0], "gravity[1]": call.gravity[1], "gamma": call.drag}
        corrections = call.state[7 * call.n :]
        numbers |= {f"dvContacts[{k}]": value for k, value in enumerate(corrections) if value}
        text = ", ".join(f"{name} = {value:.6g}" for name, value in numbers.items())
        return Words(text, text)


@dataclass(frozen=True)
class Part:
    """Verdict on one function, or on both together."""

    name: str
    """Name of the function, or `BOTH`."""
    status: str
    """One of: right, wrong, missing, does not compile, not run."""
    scenes: Mapping[str, Words] = field(default_factory=dict)
    """What is wrong, by the name of the scene; empty texts for scenes that are right."""
    ended: Words | None = None
    """What the homework did instead of answering, with the call; None if it answered."""
    mistakes: tuple[Mistake, ...] = ()
    """Mistakes that the homework has. If they do not explain all of its answers, `remark` says so."""
    hint: Hint | None = None
    """Hint for the first wrong value, if no known mistakes explain the answers."""
    remark: Words = NOTHING
    """A further remark for the student; empty if there is none."""
    shown: Shown | None = None
    """The wrong answer to the call with the fewest grains; None if no answer is wrong."""
    printed: str = ""
    """The beginning of what the homework printed."""
    warnings: tuple[Words, ...] = ()
    """Forbidden features that do not change the grade."""
    values: bytes = b""
    """Answers to the fixed calls or, if no fixed one is wrong, to the random calls, as bytes.

    Empty if `shown` is None, and for both functions together.
    """

    @property
    def first(self) -> Words | None:
        """The first error; None if everything is right."""
        return next(filter(None, self.scenes.values()), None) or self.ended

    @property
    def share(self) -> float:
        """Fraction of the scenes that are right."""
        return sum(word == "right" for word in self.words) / max(len(self.words), 1)

    @property
    def words(self) -> list[Words]:
        """For each scene, in the order of `scenes`: right, wrong or not run."""
        return [
            wrong if wrong == "not run" else Words("wrong" if wrong else "right")
            for wrong in self.scenes.values()
        ]

    def advice(self) -> list[tuple[Words, Words]]:
        """Return the advice to the student as pairs of a heading and a text.

        It consists of the mistakes, the equations and checks of their hints, and the remark.
        """
        lines: list[tuple[Words, Words]] = []
        for mistake in self.mistakes:
            lines += [(Words("mistake"), mistake.name), *_advice(mistake.hint)]
        lines += _advice(self.hint) if self.hint else []
        return lines + ([(Words("note"), self.remark)] if self.remark else [])


def _advice(hint: Hint) -> list[tuple[Words, Words]]:
    return [(Words("course text"), hint.equation), (Words("look"), hint.look)]


@dataclass(frozen=True)
class Verdict:
    """Verdict on a homework."""

    file: str
    compiler: str = ""
    """The compiler's messages."""
    parts: tuple[Part, ...] = ()
    """Verdicts on femGrainsUpdate, femGrainsContactIterate, and both; empty if nothing compiles."""
    warnings: tuple[Words, ...] = ()
    """Forbidden features that do not change the grade."""
    problem: str = ""
    """Reason why the file cannot be read; empty if it can."""
    values: str = ""
    """Hash of the answers of each function alone that has a wrong call to show; empty if there is none.

    It is equal for two homeworks with bit-identical answers.
    """
    seed: int | None = None
    """Seed of the random calls; None if the file cannot be read."""
    seconds: float = 0.0
    """Wall time of grading [s]."""
    points: Mapping[str, float] | None = None
    """Largest number of points of each part, by its name; None if no points are given."""

    @property
    def status(self) -> Words:
        """One of: right, wrong, does not compile, cannot be read."""
        if self.problem:
            return Words("cannot be read")
        if not self.parts or any(part.status == "does not compile" for part in self.parts):
            return Words("does not compile")
        return Words("right" if all(part.status == "right" for part in self.parts) else "wrong")

    @property
    def scenes(self) -> list[str]:
        """Names of the scenes in which the homework was called."""
        return list(next((part.scenes for part in self.parts if part.scenes), {}))

    @property
    def earned(self) -> dict[str, float]:
        """Points that each part has earned: its points times the fraction of its scenes that are right."""
        shares = {part.name: part.share for part in self.parts}
        return {name: most * shares.get(name, 0.0) for name, most in (self.points or {}).items()}

    def reported_parts(self) -> list[Part]:
        """Return the parts that have an error; the part `BOTH` only if each function alone is right."""
        alone = [part for part in self.parts if part.name != BOTH]
        told = alone if any(part.status != "right" for part in alone) else self.parts
        return [part for part in told if part.first]

    def seeded(self) -> Words:
        """Return a text that says how to draw the same random calls again."""
        return Words("(--seed {seed} draws the same calls again)", seed=self.seed)

    def graded(self) -> Words:
        """Return a text such as "points 15 of 30", for the sum and for each part."""

        def told(name: object, own: float, most: float) -> Words:
            return Words("{name} {own} of {most}", name=name, own=f"{own:.4g}", most=f"{most:g}")

        points, earned = self.points or {}, self.earned
        parts = [told(Words(name), earned[name], most) for name, most in points.items()]
        return joined([told(Words("points"), sum(earned.values()), sum(points.values())), *parts])

    def text(self, color: bool, language: str = "en") -> str:
        """Return the verdict as text for people, in a language of `LANGUAGES`.

        If `color`, the text is colored for a terminal.
        """

        def say(text: object) -> str:
            return printable(in_language(text, language))

        def paragraph(heading: str, said: Words) -> str:
            return say(Words("{heading}: {said}", heading=Words(heading), said=said))

        lines = [f"{printable(self.file)}: {_colored(say(self.status), self.status, color)}"]
        lines += [f"  {paragraph('warning', warning)}" for warning in self.warnings]
        lines += ["", *printable(self.compiler).splitlines()] if self.compiler else []
        lines += ["", *self._table(color, language), say(self.seeded())] if self.parts else []
        lines += [say(self.graded())] if self.points else []
        for part in self.reported_parts():
            lines += ["", say(Words(part.name)), f"  {say(part.first)}"]
            lines += [f"  {paragraph(heading, said)}" for heading, said in part.advice()]
            if part.shown and part.shown.call.n <= MOST_SHOWN:
                lines += [f"  {paragraph('scene before this call', part.shown.numbers())}"]
                lines += ["    " + " ".join(f"{cell:>11}" for cell in row) for row in part.shown.rows()]
        return "\n".join(lines)

    def _table(self, color: bool, language: str) -> list[str]:
        names = [in_language(Words(part.name), language) for part in self.parts]
        width = max(map(len, names)) + 2
        lines = ["".join([" " * width, *(f"{scene:<14}" for scene in self.scenes)]).rstrip()]
        for name, part in zip(names, self.parts, strict=True):
            told = [(in_language(w, language), w) for w in part.words or [Words(part.status)]]
            cells = [_colored(said, word, color) + " " * (14 - len(said)) for said, word in told]
            lines.append("".join([f"{name:<{width}}", *cells]).rstrip())
        return lines

    def as_json(self) -> dict[str, Any]:
        """Return the attributes of the verdict for JSON, in English."""
        parts = [
            {
                "name": part.name,
                "status": part.status,
                "scenes": {scene: wrong or "right" for scene, wrong in part.scenes.items()},
                "ended": part.ended,
                "mistakes": [mistake.name for mistake in part.mistakes],
                "advice": [": ".join(line) for line in part.advice()],
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
            "seed": self.seed,
            "seconds": self.seconds,
            **({} if self.points is None else {"points": self.earned}),
        }

    def as_row(self, language: str = "en") -> dict[str, str]:
        """Return the verdict as a row of a table: its cells by column, in a language of `LANGUAGES`."""
        status = {part.name: part.status for part in self.parts}

        def say(texts: Any) -> str:
            return "; ".join(in_language(text, language) for text in texts)

        row = {
            "file": self.file,
            "status": say([self.status]),
            **{name: say([Words(status.get(name, self.status))]) for name in _PARTS},
            **({} if self.points is None else {"points": f"{sum(self.earned.values()):.4g}"}),
            "mistakes": say(mistake.name for part in self.parts for mistake in part.mistakes),
            "warnings": say(self.warnings),
            "seed": "" if self.seed is None else str(self.seed),
            "first": self.first_line(language),
        }
        return {in_language(Words(name), language): printable(cell) for name, cell in row.items()}

    def first_line(self, language: str) -> str:
        """Return the first error, of reading, compiling or running, as one line; empty without an error.

        An error of running is in a language of `LANGUAGES`.
        """
        if self.problem or self.status == "right":
            return self.problem
        errors = [line for line in self.compiler.splitlines() if "error" in line.lower()]
        if self.status == "does not compile" and errors:
            return errors[0]
        return in_language(next((part.first for part in self.parts if part.first), ""), language)


def points_of(field: str, text: str) -> dict[str, float]:
    """Return the points by part from a text such as "10,20" or "10,20,5".

    The numbers are for femGrainsUpdate, femGrainsContactIterate and both together. Raises InputError, which
    names `field`.
    """
    words = text.split(",")
    try:
        points = [float(word) for word in words]
    except ValueError:
        points = []
    if not 2 <= len(points) <= 3 or not all(0.0 <= one < float("inf") for one in points):
        raise InputError(f"{field} is {text!r}: it must be points of each function, such as 10,20")
    return dict(zip(_PARTS, points, strict=False))


def _colored(said: str, word: str, color: bool) -> str:
    return f"\x1b[{_COLORS.get(word, '31')}m{said}\x1b[0m" if color else said
