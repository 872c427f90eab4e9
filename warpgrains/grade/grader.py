"""A homework held against the reference: each of its functions with the reference's other one, then both."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from threading import Lock
from time import perf_counter

from warpgrains.grade.child import DEFAULT, Answer, Child, Function, Limits
from warpgrains.grade.compare import difference
from warpgrains.grade.compiler import (
    CONTACT,
    UPDATE,
    WITHOUT,
    CompileError,
    compile_child,
    compile_homework,
    compile_library,
    read_homework,
)
from warpgrains.grade.diagnosis import answers_of_mistakes, explain
from warpgrains.grade.ended import EndedError
from warpgrains.grade.probes import Probe, make_probes
from warpgrains.grade.verdict import BOTH, Part, Verdict
from warpgrains.reference.reference import SOURCE


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

    Raises
    ------
    SceneError
        There is no C compiler.
    """

    def __init__(self, folder: Path, strict: bool = False, limits: Limits = DEFAULT):
        self._folder, self._strict, self._limits = folder, strict, limits
        shutil.copy(SOURCE, folder)
        self._program = compile_child(folder)
        self._reference = compile_library(SOURCE.name, folder)[0]
        with self._child(self._reference, self._reference) as child:
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
        start = perf_counter()
        with self._lock:
            self._count += 1
            folder = self._folder / f"homework{self._count}"
        try:
            return self._grade(source, folder, start)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _grade(self, source: Path, folder: Path, start: float) -> Verdict:
        text = read_homework(source)
        has_markers = any(marker[2:].encode() in text for marker in WITHOUT.values())
        libraries: dict[str, Path] = {}
        said: dict[str, str] = {}
        for part, defines in {BOTH: (), UPDATE: (WITHOUT[CONTACT],), CONTACT: (WITHOUT[UPDATE],)}.items():
            if part != BOTH and not has_markers:
                libraries.update({part: libraries[BOTH]} if BOTH in libraries else {})
                continue
            try:
                libraries[part], said[part] = compile_homework(text, folder, defines)
            except CompileError as error:
                said[part] = str(error)
        lines = next(filter(None, said.values()), "")
        if not libraries:
            return Verdict(str(source), False, lines, (), perf_counter() - start)
        parts = [self._part(part, libraries) for part in (UPDATE, CONTACT)]
        both = self._part(BOTH, libraries, all(part.ended is None for part in parts))
        if both.status == "wrong" and all(part.status == "right" for part in parts):
            both = replace(both, remark="each is right alone: do they keep something between calls?")
        parts.append(both)
        return Verdict(str(source), True, lines, tuple(parts), perf_counter() - start)

    def _part(self, name: str, libraries: dict[str, Path], may_run: bool = True) -> Part:
        """Grade one function, or both together."""
        function = CONTACT if name == CONTACT else UPDATE
        if name not in libraries:
            return Part(name, "does not compile")
        if not may_run:
            return Part(name, "not run")
        own = libraries[name]
        update, contact = (own if name in (each, BOTH) else self._reference for each in (UPDATE, CONTACT))
        answers: list[Answer] = []
        ended, printed, probes = None, "", self.probes[function]
        try:
            with self._child(update, contact) as child:
                try:
                    if not ((child.updates or name == CONTACT) and (child.iterates or name == UPDATE)):
                        return Part(name, "missing", ended=child.printed.strip() or None)
                    for probe in probes:
                        answers.append(child.ask(probe.call))
                finally:
                    printed = child.printed
        except EndedError as error:
            ended = f"{_where(probes[len(answers)])}: it {error}"
        return self._judged(name, function, answers, ended, printed)

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
        return answers_of_mistakes(function, self._program, self._reference, folder, self.probes[function])

    def _child(self, update: Path, contact: Path) -> Child:
        functions = Function(update, UPDATE), Function(contact, CONTACT)
        return Child(self._program, *functions, self._limits)


def _is_near(probe: Probe, expected: Answer, found: Answer) -> bool:
    return difference(probe, expected, found) is None


def _where(probe: Probe) -> str:
    iteration = f", iteration {probe.call.iteration}" if probe.call.iteration >= 0 else ""
    return f"scene {probe.scene}, step {probe.step}{iteration}"
