"""Grader: compares a homework with the reference.

Each of its two functions is first run with the other function of the reference, then both are run together.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from math import inf
from pathlib import Path
from secrets import randbelow
from threading import Lock
from time import monotonic
from typing import NamedTuple

import numpy as np

from warpgrains.base.console import printable
from warpgrains.base.errors import InputError
from warpgrains.base.files import read_regular
from warpgrains.grade.compare import DOUBLE, FLOAT, Difference, difference
from warpgrains.grade.compiler import HOMEWORK, LONGEST, WITHOUT, CompileError, Compiler
from warpgrains.grade.diagnosis import Explanation, Model, hint_of
from warpgrains.grade.probes import Probe, draw_probes, make_probes
from warpgrains.grade.sandbox import (
    CONTACT,
    DEFAULT,
    UPDATE,
    Answer,
    Call,
    Child,
    EndedError,
    Limits,
    Processes,
)
from warpgrains.grade.verdict import BOTH, NOTHING, Part, Shown, Verdict
from warpgrains.grade.words import Words

_UNCONFINED = "filter of system calls: homeworks can open files and start processes"
_UNFENCED = "Landlock for the compiler: homeworks can include any file that you can read"
_ONLY = "no known mistake explains it; only calls with {what} {relation} {value} are wrong"
_CHANCE = 1e-2  # that all wrong calls are extreme in a number that has nothing to do with it
_UNSET = (
    "the same call has other results when it is repeated: is a variable, or memory from malloc, read before "
    "it is set, or is a value kept between calls?"
)
_UNKNOWN = "no known mistake explains it"
_UNGUARDED = (
    "the lines #ifndef NOUPDATE, #ifndef NOCONTACTITERATE and #endif around the two functions are missing or "
    "changed: put them back as they are in the empty homework"
)
_MAIN = "it defines main: hand in the two functions without the program that tests them"


class Round(NamedTuple):
    """Calls (probes) with the answers that the reference gives to them.

    Some homeworks count iteration 0 for iterMax. For them, `fewer` holds the calls of femGrainsUpdate with
    iterMax - 1, and `expected_of_fewer` the answers of the reference to these.
    """

    probes: list[Probe]
    expected: list[Answer]
    fewer: list[Probe]
    expected_of_fewer: list[Answer]


class Grader:
    """Grader of homeworks, which several threads may use at the same time.

    Parameters
    ----------
    folder
        An empty folder for compiled files.
    strict
        Whether to require bit-identical results, rather than results that are equal up to rounding.
    limits
        Time and memory of a homework.
    processes
        Collection to which the grader adds each compiler and each sandboxed process that it starts, so that
        the caller can end them.
    seed
        Seed of the random calls; by default, it is random.
    """

    def __init__(
        self,
        folder: Path,
        strict: bool = False,
        limits: Limits = DEFAULT,
        processes: Processes | None = None,
        seed: int | None = None,
    ):
        self.seed = randbelow(2**31) if seed is None else seed
        self._folder, self._strict, self._limits = folder, strict, limits
        self._processes = processes or Processes()
        self._compiler = Compiler(folder, self._processes)
        self._program = self._compiler.compile_child(folder)
        self._reference = {  # separate, so that a homework cannot call the function that it must provide
            function: self._compiler.compile_reference(folder, ("-DNOCREATE", WITHOUT[other]))
            for function, other in ((UPDATE, CONTACT), (CONTACT, UPDATE))
        }
        with self._child({}) as child:
            self._confined = child.confined
            self.fixed, self.drawn = (
                {function: _round(child, asked) for function, asked in probes.items()}
                for probes in (make_probes(child), draw_probes(child, self.seed))
            )
            """`Round` of the fixed scenes, and that of the random calls, by the name of the function."""
        self.model = Model(self._compiler, folder)
        self._lock = Lock()
        self._count = 0

    def unprotected(self) -> list[str]:
        """Return warnings about protections that this system lacks."""
        found = {_UNCONFINED: self._confined, _UNFENCED: self._compiler.is_fenced}
        return [f"this system has no {what}" for what, is_safe in found.items() if not is_safe]

    def grade(self, source: Path) -> Verdict:
        """Grade a homework. Raises InputError if the file cannot be read."""
        start = monotonic()
        with self._lock:
            self._count += 1
            folder = self._folder / f"homework{self._count}"
        try:
            return self._grade(source, folder, start)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def run(self, source: Path) -> tuple[Child, Child]:
        """Start two sandboxed processes, one with the reference and one with a homework; return both.

        Raises InputError if the homework cannot be run.
        """
        folder = self._folder / "run"
        try:
            library, _ = self._compiler.compile_homework(_source(source), folder)
            child = self._child(dict.fromkeys((UPDATE, CONTACT), library), self._limits)
        except CompileError as error:
            first = next((line for line in str(error).splitlines() if "error:" in line), str(error))
            raise InputError(f"'{source}' does not compile: {_named(first, source)}") from None
        except EndedError as error:
            raise InputError(f"'{source}' cannot be run: {error}") from None
        if child.updates and child.iterates:
            return self._child({}), child
        child.close()
        raise InputError(f"'{source}' cannot be run: {UPDATE} or {CONTACT} is missing")

    def _grade(self, source: Path, folder: Path, start: float) -> Verdict:
        text, until = _source(source), start + self._limits.total
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
        lines = next((lines for part, lines in said.items() if part not in libraries), said[BOTH])
        lines = _named(lines, source)
        if not libraries:
            return Verdict(str(source), lines, seed=self.seed, seconds=monotonic() - start)
        parts = [self._part(part, libraries, until) for part in (UPDATE, CONTACT)]
        both = self._part(BOTH, libraries, until, all(part.ended is None for part in parts))
        if both.status == "wrong" and all(part.status == "right" for part in parts):
            remark = Words("each function is right alone: does one of the two keep a value between calls?")
            both = replace(both, remark=remark)
        parts.append(both)
        warnings = tuple(dict.fromkeys(warning for part in parts for warning in part.warnings))
        wrong = b"".join(part.values for part in parts)
        values = sha256(wrong).hexdigest() if wrong else ""
        seconds = monotonic() - start
        return Verdict(str(source), lines, tuple(parts), warnings, "", values, self.seed, seconds)

    def _part(self, name: str, libraries: dict[str, Path], until: float, may_run: bool = True) -> Part:
        """Grade the function `name`, or for `BOTH` both together.

        `libraries` holds the compiled homework by part, without the parts that do not compile. `until` is the
        time of `time.monotonic` at which calls end [s]. If not `may_run`, the result is "not run".
        """
        function = CONTACT if name == CONTACT else UPDATE
        if name not in libraries:
            return Part(name, "does not compile")
        if not may_run:
            return Part(name, "not run")
        own = {each: libraries[name] for each in (UPDATE, CONTACT) if name in (each, BOTH)}
        rounds = self.fixed[function], self.drawn[function]
        not_run = {probe.scene: Words("not run") for each in rounds for probe in each.probes}
        part = Part(name, "", scenes=not_run)
        for each in rounds:
            answers: dict[int, Answer] = {}
            ends: dict[str, tuple[int, EndedError]] = {}  # the probe at which it ended, by scene
            todo = list(range(len(each.probes)))
            while todo:
                try:
                    with self._child(own, self._limits, until) as child:
                        try:
                            part = replace(part, warnings=_warnings(child))
                            if not (
                                (child.updates or name == CONTACT) and (child.iterates or name == UPDATE)
                            ):
                                printed = child.printed.strip()
                                missing = Words(printed, printed) if printed else None
                                return Part(name, "missing", ended=missing, warnings=part.warnings)
                            while todo:
                                answers[todo[0]] = child.ask(each.probes[todo[0]].call)
                                todo.pop(0)
                        finally:
                            part = replace(part, printed=child.printed)
                except EndedError as error:
                    ends[each.probes[todo[0]].scene] = todo[0], error
                    is_index = error.how not in (-1, -2)
                    todo = [k for k in todo if is_index and each.probes[k].scene not in ends]
            if each is rounds[0]:
                counts_0 = function == UPDATE and _counts_0(each, answers)
            part = self._judged(part, each, counts_0, answers, ends)
            if part.status == "wrong":
                break
        if part.shown and part.hint and not self._repeats(own, part.shown.call, until):
            part = replace(part, remark=Words(_UNSET))
        has_values = part.shown and name != BOTH
        return replace(part, values=b"".join(a.bytes for a in answers.values()) if has_values else b"")

    def _repeats(self, own: dict[str, Path], call: Call, until: float) -> bool:
        """Return whether a homework gives bit-identical answers if a call is repeated; True if it fails.

        The two calls find different values in memory that the homework does not set. For `own`, see `_child`.
        """
        try:
            with self._child(own, self._limits, until) as child:
                return child.ask(call) == child.ask(call)
        except EndedError:
            return True

    def _judged(
        self,
        part: Part,
        asked: Round,
        counts_0: bool,
        answered: Mapping[int, Answer],
        ends: Mapping[str, tuple[int, EndedError]],
    ) -> Part:
        """Return `part` with the verdict on the calls of a round, `asked`.

        `answered` holds the answers by index of the probe in `asked`. `ends` holds, by scene, the index of
        the probe that the homework did not answer, and its failure. `counts_0` is that of `_counts_0`.
        Mistakes are named for the fixed calls only, not for random ones.
        """
        function = CONTACT if part.name == CONTACT else UPDATE
        modeled, right = (
            (asked.fewer, asked.expected_of_fewer) if counts_0 else (asked.probes, asked.expected)
        )
        probes, answers = [asked.probes[k] for k in answered], list(answered.values())
        expected = [right[k] for k in answered]
        eps = 0.0 if self._strict else DOUBLE
        differences = _differences(probes, expected, answers, eps)
        wrongs: dict[str, Words] = {}
        for probe, first in zip(probes, differences, strict=True):
            if not wrongs.get(probe.scene):
                wrongs[probe.scene] = first.words() if first else NOTHING
        said = {
            scene: Words("{where}: it {does}", where=asked.probes[k].place(), does=error.words)
            for scene, (k, error) in ends.items()
        }
        wrongs |= {scene: wrongs.get(scene) or words for scene, words in said.items()}
        ended = next(iter(ends.values()), None)
        status, scenes = "wrong" if any(wrongs.values()) else "right", {**part.scenes, **wrongs}
        part = replace(part, status=status, scenes=scenes, ended=next(iter(said.values()), None))
        if wrong := [k for k, first in enumerate(differences) if first]:
            k = min(wrong, key=lambda k: probes[k].call.n)
            part = replace(part, shown=Shown(probes[k].call, expected[k], answers[k]))
        if part.status == "right" or part.name == BOTH:
            return part
        near = differences if eps else _differences(probes, expected, answers, DOUBLE)
        first = next(filter(None, near), None)
        if first is None and (not ended or ended[1].how == -1):
            return part if ended else replace(part, remark=Words("it differs by rounding only"))
        found = [k for k, each in enumerate(near) if each]
        calls = [modeled[k] for k in (*answered, *(k for k, _ in ends.values()))]
        hows = [error.how for _, error in ends.values()]
        mistakes, is_complete = Explanation((), False)
        if asked is self.fixed[function]:
            mistakes, is_complete = self.model.explain(function, calls, answers, found, ends=hows)
        if is_complete:
            return replace(part, mistakes=mistakes)
        if mistakes:
            remark = Words("there is another mistake, which has no name")
            return replace(part, mistakes=mistakes, remark=remark)
        if first is None:
            is_index = any(error.how >= 0 for _, error in ends.values())
            return replace(part, hint=hint_of(None)) if is_index else part
        is_float = not ended and not any(_differences(probes, expected, answers, FLOAT))
        remark = Words("it differs as if float were used: use double" if is_float else _UNKNOWN)
        if not (is_float or ended):
            is_drawn = asked is self.drawn[function]
            common = _common(probes, expected, found)
            remark = common or (is_drawn and _extreme(probes, expected, found)) or remark
        return replace(part, hint=hint_of(first), remark=remark)

    def _child(self, own: dict[str, Path], limits: Limits = DEFAULT, until: float = inf) -> Child:
        """Start a sandboxed process with a homework.

        `own` holds libraries of the homework by function; functions that it lacks are those of the reference.
        """
        return Child(self._program, self._reference | own, self._processes, limits, until=until)


def _round(child: Child, probes: list[Probe]) -> Round:
    """Return the round of these probes; `child` runs the reference, which answers them."""
    fewer = [
        probe._replace(call=probe.call._replace(max_iterations=probe.call.max_iterations - 1.0))
        for probe in probes
        if probe.call.iteration < 0
    ]
    expected, of_fewer = ([child.ask(probe.call) for probe in each] for each in (probes, fewer))
    return Round(probes, expected, fewer, of_fewer)


def _counts_0(asked: Round, answered: Mapping[int, Answer]) -> bool:
    """Return whether a homework counts iteration 0 for iterMax.

    Where the reference does iterMax + 1 iterations, from 0 to iterMax, such a homework does iterMax.
    """
    limits = [probe.call.max_iterations for probe in asked.probes]
    ended = [k for k in answered if asked.expected[k].calls > limits[k]]
    return max((answered[k].calls - limits[k] for k in ended), default=1) == 0


def _source(path: Path) -> bytes:
    text = read_regular(path, LONGEST)
    if b"\0" in text:
        raise InputError(
            f"'{path}' is not C source, because it holds null bytes: give a file such as homework.c"
        )
    return text


def _named(lines: str, source: Path) -> str:
    """Replace the name of the compiled copy in the compiler's messages by that of the student's file."""
    return lines.replace(f"{HOMEWORK}:", f"{printable(source.name)}:")


def _warnings(child: Child) -> tuple[Words, ...]:
    """Return warnings about forbidden features of a homework that do not change its grade."""
    found = {_MAIN: child.has_main, _UNGUARDED: child.is_unguarded}
    return tuple(Words(warning) for warning, holds in found.items() if holds)


def _common(probes: Sequence[Probe], expected: Sequence[Answer], wrong: Sequence[int]) -> Words | None:
    """Return a remark if iterMax ends the steps of all wrong answers, or if only large scenes have some.

    `wrong` holds the indices of the wrong answers. Large scenes have more grains than any scene without wrong
    answers. None if neither is the case.
    """
    if all(expected[k].calls >= probes[k].call.max_iterations for k in wrong):
        return Words("no known mistake explains it; only steps that iterMax ends are wrong")
    scenes, least = {probes[k].scene for k in wrong}, min(probes[k].call.n for k in wrong)
    if 0 < max((probe.call.n for probe in probes if probe.scene not in scenes), default=0) < least:
        return Words("no known mistake explains it; only scenes of {n} or more grains are wrong", n=least)
    return None


def _extreme(probes: Sequence[Probe], expected: Sequence[Answer], wrong: Sequence[int]) -> Words | None:
    """Return a remark on a parameter that is large, or small, in all wrong calls.

    For each parameter of `_NUMBERS`, the probability is computed that calls chosen by chance are as extreme.
    The remark is on the one with the smallest probability. None if no probability is below `_CHANCE`.
    """
    chance, remark = _CHANCE, None
    for name, number in _NUMBERS.items():
        values = np.array([number(*each) for each in zip(probes, expected, strict=True)])
        for sign, relation in ((1.0, ">="), (-1.0, "<=")):
            limit = (sign * values[wrong]).min()
            share = float(np.mean(sign * values >= limit) ** len(wrong))
            if share < chance:
                value, what = f"{sign * limit:.3g}", Words(name)
                chance, remark = share, Words(_ONLY, what=what, relation=relation, value=value)
    return remark


def _overlap(probe: Probe, _: Answer) -> float:
    """Return the deepest overlap of two grains before a call [m]; 0 if none overlap."""
    n, state = probe.call.n, probe.call.state
    (x, y), r, (i, j) = state[: 2 * n].reshape(2, n), state[4 * n : 5 * n], np.triu_indices(n, 1)
    return float((r[i] + r[j] - np.hypot(x[j] - x[i], y[j] - y[i])).max(initial=0.0))


_NUMBERS: dict[str, Callable[[Probe, Answer], float]] = {
    "n": lambda probe, _: probe.call.n,
    "dt": lambda probe, _: probe.call.dt,
    "gravity": lambda probe, _: float(np.hypot(*probe.call.gravity)),
    "gamma": lambda probe, _: probe.call.drag,
    "the deepest overlap": _overlap,
    "iter": lambda probe, expected: max(probe.call.iteration, expected.calls - 1, 1),
    "the number of calls before": lambda probe, _: probe.step,
}
"""Functions that return parameters of a call, by name. `_extreme` searches them for large or small values."""


def _differences(
    probes: Sequence[Probe], expected: Sequence[Answer], answers: Sequence[Answer], eps: float
) -> list[Difference | None]:
    return [difference(*each, eps) for each in zip(probes, expected, answers, strict=False)]
