"""A homework held against the reference: each of its functions with the reference's other one, then both."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from math import inf
from pathlib import Path
from threading import Lock
from time import monotonic

from warpgrains.grade.child import DEFAULT, Answer, Child, Function, Limits
from warpgrains.grade.compare import difference
from warpgrains.grade.compiler import CONTACT, UPDATE, WITHOUT, CompileError, Compiler, read_homework
from warpgrains.grade.diagnosis import answers_of_mistakes, explain
from warpgrains.grade.ended import EndedError
from warpgrains.grade.probes import Probe, make_probes
from warpgrains.grade.processes import Processes
from warpgrains.grade.verdict import BOTH, Part, Verdict
from warpgrains.reference.reference import SOURCE

_UNGUARDED = (
    "the lines #ifndef NOUPDATE, #ifndef NOCONTACTITERATE and #endif around the two functions are missing or "
    "changed: put them back as they are in the empty homework"
)
_MAIN = "it defines main: hand in the two functions without the program that tests them"


class Grader:
    """What grades homeworks, one or many at once, from several threads.

    Parameters
    ----------
    folder : Path
        An empty one, for what is compiled.
    strict : bool
        Whether a right homework has the bits of the reference, or differs by no more than rounding.
    limits : Limits
        What a homework may use.
    processes : Processes
        Where the compiler and homeworks run; once they are stopped, `grade` raises StoppedError.

    Attributes
    ----------
    confined, fenced : bool
        Whether this system keeps homeworks from all but computing, and from including files of others.

    Raises
    ------
    SceneError
        There is no C compiler.
    """

    def __init__(
        self,
        folder: Path,
        strict: bool = False,
        limits: Limits = DEFAULT,
        processes: Processes | None = None,
    ):
        self._folder, self._strict, self._limits = folder, strict, limits
        self._processes = processes or Processes()
        self._compiler = Compiler(folder, self._processes)
        self.fenced = self._compiler.is_fenced
        self._program = self._compiler.compile_child(folder)
        self._reference = {  # apart, so that a homework has nothing of the function that it is to write
            function: self._compiler.compile_library(SOURCE, folder, ("-DNOCREATE", WITHOUT[other]))
            for function, other in ((UPDATE, CONTACT), (CONTACT, UPDATE))
        }
        with self._child({}) as child:
            self.confined = child.confined
            probes = make_probes(child)
            self.probes: dict[str, Sequence[Probe]] = {CONTACT: probes.contact, UPDATE: probes.update}
            self.expected = {
                function: [child.ask(probe.call) for probe in asked]
                for function, asked in self.probes.items()
            }
        self._lock = Lock()
        self.answers_of_mistakes = cache(self._answers_of_mistakes)
        self._count = 0

    def grade(self, source: Path) -> Verdict:
        """Grade a homework.

        Raises
        ------
        SceneError
            It cannot be read.
        """
        start = monotonic()
        with self._lock:
            self._count += 1
            folder = self._folder / f"homework{self._count}"
        try:
            return self._grade(source, folder, start)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _grade(self, source: Path, folder: Path, start: float) -> Verdict:
        text, until = read_homework(source), start + self._limits.in_all
        has_markers = any(marker[2:].encode() in text for marker in WITHOUT.values())
        libraries: dict[str, Path] = {}
        said: dict[str, str] = {}
        for part, defines in {BOTH: (), UPDATE: (WITHOUT[CONTACT],), CONTACT: (WITHOUT[UPDATE],)}.items():
            if part != BOTH and not has_markers:
                libraries.update({part: libraries[BOTH]} if BOTH in libraries else {})
                continue
            try:
                libraries[part], said[part] = self._compiler.compile_homework(text, folder, defines, until)
            except CompileError as error:
                said[part] = str(error)
        lines = next(filter(None, said.values()), "")
        if not libraries:
            return Verdict(str(source), lines, seconds=monotonic() - start)
        parts = [self._part(part, libraries, until) for part in (UPDATE, CONTACT)]
        both = self._part(BOTH, libraries, until, all(part.ended is None for part in parts))
        if both.status == "wrong" and all(part.status == "right" for part in parts):
            both = replace(both, remark="each is right alone: do they keep something between calls?")
        parts.append(both)
        warnings = tuple(dict.fromkeys(warning for part in parts for warning in part.warnings))
        return Verdict(str(source), lines, tuple(parts), warnings, seconds=monotonic() - start)

    def _part(self, name: str, libraries: dict[str, Path], until: float, may_run: bool = True) -> Part:
        """Grade one function, or both together."""
        function = CONTACT if name == CONTACT else UPDATE
        if name not in libraries:
            return Part(name, "does not compile")
        if not may_run:
            return Part(name, "not run")
        own = {each: Function(libraries[name], each) for each in (UPDATE, CONTACT) if name in (each, BOTH)}
        answers: list[Answer] = []
        warnings: tuple[str, ...] = ()
        ended, printed, probes = None, "", self.probes[function]
        try:
            with self._child(own, self._limits, until) as child:
                try:
                    warnings = _warnings(child)
                    if not ((child.updates or name == CONTACT) and (child.iterates or name == UPDATE)):
                        missing = child.printed.strip() or None
                        return Part(name, "missing", ended=missing, warnings=warnings)
                    for probe in probes:
                        answers.append(child.ask(probe.call))
                finally:
                    printed = child.printed
        except EndedError as error:
            ended = f"{_where(probes[len(answers)])}: it {error}"
        return replace(self._judged(name, function, answers, ended, printed), warnings=warnings)

    def _judged(
        self, name: str, function: str, answers: Sequence[Answer], ended: str | None, printed: str
    ) -> Part:
        probes, expected = self.probes[function], self.expected[function]
        scenes: dict[str, str] = {}
        for probe, right, found in zip(probes, expected, answers, strict=False):
            first = difference(probe, right, found, self._strict)
            if not scenes.get(probe.scene):
                scenes[probe.scene] = str(first or "")
        if ended:
            scenes[probes[len(answers)].scene] = scenes.get(probes[len(answers)].scene) or ended
        for probe in probes:
            scenes.setdefault(probe.scene, "not run")
        status = "wrong" if any(scenes.values()) else "right"
        part = Part(name, status, scenes, ended, printed=printed)
        if status == "right" or name == BOTH:
            return part
        if all(map(_is_near, probes, expected, answers)):
            return part if ended else replace(part, remark="it differs by rounding only")
        with self._lock:
            mistakes = self.answers_of_mistakes(function)
        names, left = explain(probes, expected, answers, mistakes)
        unknown = "these do not explain all of it" if names else "no known mistake explains it"
        return replace(part, mistakes=tuple(names), remark=unknown if left else "")

    def _answers_of_mistakes(self, function: str) -> dict[str, list[Answer]]:
        folder = self._folder / function
        folder.mkdir()

        def start(mistake: Function) -> Child:
            return self._child({function: mistake})

        return answers_of_mistakes(function, self._compiler, folder, start, self.probes[function])

    def _child(
        self, functions: Mapping[str, Function], limits: Limits = DEFAULT, until: float = inf
    ) -> Child:
        """Start a child with some functions, and the reference's others."""
        update, contact = (
            functions.get(name, Function(self._reference[name], name)) for name in (UPDATE, CONTACT)
        )
        return Child(self._program, update, contact, self._processes, limits, until)


def _warnings(child: Child) -> tuple[str, ...]:
    """Return what the course forbids and a homework does all the same."""
    found = {_MAIN: child.has_main, _UNGUARDED: child.is_unguarded}
    return tuple(warning for warning, holds in found.items() if holds)


def _is_near(probe: Probe, expected: Answer, found: Answer) -> bool:
    return difference(probe, expected, found) is None


def _where(probe: Probe) -> str:
    iteration = f", iteration {probe.call.iteration}" if probe.call.iteration >= 0 else ""
    return f"scene {probe.scene}, step {probe.step}{iteration}"
