"""Diagnosis of a homework: search for the one or two mistakes that explain all its wrong answers.

The search tries all mistakes in a model (model.c), an implementation whose terms have wrong variants.
"""

import ctypes
import tomllib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from warpgrains.grade.compare import Difference
from warpgrains.grade.compiler import CONTACT, Compiler
from warpgrains.grade.probes import Probe
from warpgrains.grade.sandbox import MOST_CALLS, Answer, Call
from warpgrains.grade.words import Words

_HERE = Path(__file__).parent
_MOST = 64  # largest number of explanations that are compared
_FIRST, _LATER, _ALL = 1, 2, 3  # iterations in which a mistake occurs
_ALONE = ((_ALL, 0), (_LATER, 0), (_FIRST, 0))
_TOGETHER = ((_ALL, _ALL), (_ALL, _LATER), (_LATER, _ALL), (_LATER, _LATER))
_SAID = {_FIRST: "{mistake}, in iteration 0", _LATER: "{mistake}, except in iteration 0"}
_Numbers = ctypes.POINTER(ctypes.c_double)


class Hint(NamedTuple):
    """An equation of the course text, with advice on what to check."""

    equation: Words
    look: Words


class Mistake(NamedTuple):
    """A mistake of a function, its equation, and the terms of model.c that it changes."""

    function: str
    name: Words
    hint: Hint
    terms: dict[str, str]


class Explanation(NamedTuple):
    """Mistakes that a homework certainly has, and whether they explain all its answers."""

    mistakes: tuple[Mistake, ...]
    is_complete: bool


def read_mistakes() -> list[Mistake]:
    """Return all mistakes of mistakes.toml."""
    return [
        Mistake(group["function"], Words(*names), _hint(group), terms)
        for group in _groups()
        for *names, terms in group["mistakes"]
    ]


def hint_of(first: Difference, is_iteration: bool) -> Hint:
    """Return the hint for the equation of the first wrong value."""
    entry = first.quantity.partition("[")[0]
    if is_iteration and first.iteration == 0:
        entry = "iter"
    elif is_iteration and entry in ("vx", "vy") and "wall" in (first.contact or ""):
        entry = "wall"
    elif not is_iteration:
        entry = "free" if "before" in first.quantity else "position" if entry in ("x", "y") else "loop"
    return next(_hint(group) for group in _groups() if entry in group.get("shows", ()))


def _hint(group: dict[str, Any]) -> Hint:
    return Hint(
        *(
            Words(*text) if isinstance(text, list) else Words(text, text)
            for text in (group["equation"], group["look"])
        )
    )


@cache
def _groups() -> list[dict[str, Any]]:
    return tomllib.loads((_HERE / "mistakes.toml").read_text())["group"]


class _Probe(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int) for name in ("n", "iter")),
        *((name, ctypes.c_double) for name in ("dt", "tol", "iterMax", "radiusIn", "radiusOut")),
        ("gravity", ctypes.c_double * 2),
        ("gamma", ctypes.c_double),
        ("state", _Numbers),
    )


class _Answer(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int) for name in ("calls", "recorded", "outside")),
        ("zeta", ctypes.c_double),
        *((name, _Numbers) for name in ("state", "before", "record")),
    )


class _Found(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int) for name in ("count", "first", "outside")),
        ("probes", ctypes.POINTER(_Probe)),
        ("answers", ctypes.POINTER(_Answer)),
    )


class Model:
    """Model of a homework with selectable mistakes (model.c).

    Parameters
    ----------
    compiler : Compiler
    folder : Path
        An existing folder, for the program.
    """

    def __init__(self, compiler: Compiler, folder: Path):
        self.mistakes = read_mistakes()
        wrong: dict[str, list[str]] = {}
        for mistake in self.mistakes:
            for term, expression in mistake.terms.items():
                if expression not in wrong.setdefault(term, []):
                    wrong[term].append(expression)
        self._variants = np.zeros((len(self.mistakes), len(wrong)), np.int32)
        for row, mistake in zip(self._variants, self.mistakes, strict=True):
            for k, (term, expressions) in enumerate(wrong.items()):
                row[k] = 1 + expressions.index(mistake.terms[term]) if term in mistake.terms else 0
        lines = [f"#define TERMS {len(wrong)}"]
        for k, (term, expressions) in enumerate(wrong.items()):
            choices = "".join(f"variant[{k}] == {c} ? ({e}) : " for c, e in enumerate(expressions, 1))
            lines.append(f"#define {term}(...) (!variant[{k}] ? (__VA_ARGS__) : {choices}0)")
        (folder / "mistakes.h").write_text("\n".join(lines) + "\n")
        self._library = ctypes.CDLL(str(compiler.compile_model(_HERE / "model.c", folder)))

    def answer(self, mistakes: Sequence[Mistake], call: Call) -> Answer:
        """Return the answer of a homework with these mistakes."""
        variant = np.zeros(self._variants.shape[1], np.int32)
        for mistake in mistakes:
            variant += self._variants[self.mistakes.index(mistake)]
        arrays = _answer_arrays(call.n)
        answer = _answer(*arrays)
        chosen = (_pointer(variant), _pointer(variant))
        self._library.answer(*chosen, ctypes.byref(_probe(call)), ctypes.byref(answer))
        state, before, record = arrays
        return Answer(answer.zeta, answer.calls, state, before, record[: answer.recorded])

    def explain(
        self,
        function: str,
        probes: Sequence[Probe],
        found: Sequence[Answer],
        first: int,
        outside: int = -1,
    ) -> Explanation:
        """Find the one or two mistakes of a function that explain all answers.

        Parameters
        ----------
        function : str
        probes, found : sequence
            Calls of the homework and its answers, possibly to the first calls only.
        first : int
            Index of the first wrong answer, or the number of answers.
        outside : int
            Index beyond `dvContacts` that ended the homework after the last answer; -1 if there is none.
        """
        chosen = [k for k, mistake in enumerate(self.mistakes) if mistake.function == function]
        variants = np.ascontiguousarray(self._variants[chosen])
        asked = (_Probe * len(probes))(*(_probe(probe.call) for probe in probes))
        answers = (_Answer * len(probes))(*(_found(answer) for answer in found))
        facts = _Found(len(found), first, outside, asked, answers)
        room = _answer_arrays(max(probe.call.n for probe in probes))
        own = _answer(*room)
        explaining = np.zeros((_MOST, 2), np.int32)
        for when in (*_ALONE, *_TOGETHER) if function == CONTACT else (_ALONE[0], _TOGETHER[0]):
            given = (_pointer(np.array(when, np.int32)), len(chosen), _pointer(variants), ctypes.byref(facts))
            hits = self._library.search(*given, ctypes.byref(own), _MOST, _pointer(explaining))
            if hits:
                return _common([self._named(chosen, row, when) for row in explaining[:hits]])
        return Explanation((), False)

    def _named(self, chosen: Sequence[int], row: np.ndarray, when: tuple[int, int]) -> list[Mistake]:
        """Return the mistakes of an explanation, with iterations in their names unless these are all."""
        pairs = zip(row, when, strict=True)
        return [
            mistake._replace(name=Words(_SAID[bits], mistake=mistake.name)) if bits != _ALL else mistake
            for mistake, bits in ((self.mistakes[chosen[k]], bits) for k, bits in pairs if bits)
        ]


def _common(explanations: Sequence[Sequence[Mistake]]) -> Explanation:
    """Return the mistakes that all explanations share, by their names."""
    first = {str(mistake.name): mistake for mistake in explanations[0]}
    shared = set(first).intersection(*({str(m.name) for m in each} for each in explanations))
    mistakes = tuple(mistake for name, mistake in first.items() if name in shared)
    return Explanation(mistakes, len(mistakes) == len(first))


def _answer_arrays(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return arrays for the answer of a scene of n grains."""
    return np.zeros(7 * n + n * (n - 1) // 2), np.zeros(4 * n), np.zeros((2 * MOST_CALLS, 3))


def _answer(state: np.ndarray, before: np.ndarray, record: np.ndarray) -> _Answer:
    return _Answer(0, 0, -1, 0.0, *(array.ctypes.data_as(_Numbers) for array in (state, before, record)))


def _found(answer: Answer) -> _Answer:
    found = _answer(answer.state, answer.before, answer.record)
    found.calls, found.recorded, found.zeta = answer.calls, len(answer.record), answer.zeta
    return found


def _probe(call: Call) -> _Probe:
    gravity = (ctypes.c_double * 2)(*call.gravity)
    numbers = (call.dt, call.tolerance, call.max_iterations, call.radius_in, call.radius_out)
    return _Probe(call.n, call.iteration, *numbers, gravity, call.drag, call.state.ctypes.data_as(_Numbers))


def _pointer(array: np.ndarray) -> Any:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_int32))
