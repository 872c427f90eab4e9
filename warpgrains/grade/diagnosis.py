"""Diagnosis of a homework: search for the one or two mistakes that explain all its wrong answers.

The search tries all mistakes in a model (model.c), an implementation of both functions. In it, each term of
an equation is a macro, which can also expand to a wrong expression.
"""

import ctypes
import re
import tomllib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from warpgrains.grade.compare import Difference
from warpgrains.grade.compiler import Compiler
from warpgrains.grade.probes import Probe
from warpgrains.grade.sandbox import CONTACT, RECORDED, Answer, Call, Request
from warpgrains.grade.words import Words

_HERE = Path(__file__).parent
_MOST = 256  # largest number of explanations that are compared
_SLOTS = 6  # of a term
_LOOKED_AT = 4  # wrong answers that decide which pairs are tried, as in model.c
_FIRST, _LATER, _ALL = 1, 2, 3  # iterations in which a mistake occurs
_ALONE = ((_ALL, 0), (_LATER, 0), (_FIRST, 0))
_TOGETHER = ((_ALL, _ALL), (_ALL, _LATER), (_LATER, _LATER))
_SAID = {_FIRST: "{mistake}, in iteration 0", _LATER: "{mistake}, except in iteration 0"}
_TERM = re.compile(r"([A-Z_]+)(\d*)")
_Numbers = ctypes.POINTER(ctypes.c_double)


class Hint(NamedTuple):
    """Advice to a student: an equation of the course text, and what to check in the program."""

    equation: Words
    look: Words


class Mistake(NamedTuple):
    """A known mistake in a function, with its hint.

    A term of model.c, such as NORMAL, occurs in up to six numbered places, its slots, such as x or y of a
    pair or of a wall. `terms` maps (term, slot) to the wrong expression, for all slots that the mistake
    changes.
    """

    function: str
    name: Words
    hint: Hint
    terms: dict[tuple[str, int], str]


class Explanation(NamedTuple):
    """Mistakes that a homework certainly has, and whether they explain all of its answers."""

    mistakes: tuple[Mistake, ...]
    is_complete: bool


def read_mistakes() -> list[Mistake]:
    """Return the mistakes of mistakes.toml: each once for every slot and every way in which it can occur."""
    mistakes = []
    for group in _table()["group"]:
        for english, french, slots, *ways in group["mistakes"]:
            family, *chosen = slots.split()
            for slot, *where in _table()["slots"][family]:
                if chosen and slot not in chosen:
                    continue
                name = Words(english, french, where=Words(*where))
                is_wall = set(slot) <= set(_table()["walls"].get(family, ""))
                hint = _hint(group["wall"] if is_wall and "wall" in group else group)
                for terms in ways:
                    mistakes.append(Mistake(group["function"], name, hint, _in_slots(terms, slot)))
    return mistakes


def _in_slots(terms: dict[str, str], slots: str) -> dict[tuple[str, int], str]:
    """Return `Mistake.terms`, the wrong expression by (term, slot), from the expressions in `terms` by term.

    A key with digits names its slots: "GAP12" is GAP in slots 1 and 2. A key without digits, such as "GAP",
    has the slots that the digits of `slots` give.
    """
    found = ((_TERM.fullmatch(term), expression) for term, expression in terms.items())
    return {
        (match[1], int(slot)): expression
        for match, expression in found
        if match
        for slot in match[2] or slots
    }


def hint_of(first: Difference | None) -> Hint:
    """Return the hint for the first difference of a homework.

    None stands for a homework that has no wrong value, but uses an index beyond the end of `dvContacts`.
    """
    groups = (each for group in _table()["group"] for each in (group, group.get("wall", {})))
    entry = _entry(first) if first else "index"
    return next(_hint(group) for group in groups if entry in group.get("shows", ()))


def _entry(first: Difference) -> str:
    """Return the kind of a difference, such as "wall", by which `shows` in mistakes.toml selects hints."""
    entry, iteration = first.quantity.partition("[")[0], first.probe.call.iteration
    if iteration < 0:
        return "free" if "before" in first.quantity else "position" if entry in ("x", "y") else "loop"
    if iteration == 0:
        return "iter"
    return "wall" if entry in ("vx", "vy") and "wall" in (first.contact or "") else entry


def _hint(group: dict[str, Any]) -> Hint:
    return Hint(
        *(
            Words(*text) if isinstance(text, list) else Words(text, text)
            for text in (group["equation"], group["look"])
        )
    )


@cache
def _table() -> dict[str, Any]:
    return tomllib.loads((_HERE / "mistakes.toml").read_text())


class _Probe(ctypes.Structure):
    _fields_ = (("request", Request), ("state", _Numbers))


class _Answer(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int) for name in ("calls", "recorded", "end")),
        ("zeta", ctypes.c_double),
        *((name, _Numbers) for name in ("state", "before", "record")),
    )


class _Found(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int) for name in ("count", "wrongs", "ended")),
        *((name, ctypes.POINTER(ctypes.c_int)) for name in ("wrong", "ends")),
        ("probes", ctypes.POINTER(_Probe)),
        *((name, ctypes.POINTER(_Answer)) for name in ("answers", "right")),
    )


class Model:
    """Model of a homework (model.c), whose mistakes can be chosen."""

    def __init__(self, compiler: Compiler, folder: Path):
        self.mistakes = read_mistakes()
        wrong: dict[str, list[str]] = {}
        for mistake in self.mistakes:
            for (term, _), expression in mistake.terms.items():
                if expression not in wrong.setdefault(term, []):
                    wrong[term].append(expression)
        places = {term: _SLOTS * k for k, term in enumerate(wrong)}
        self._variants = [
            np.array(
                [
                    number
                    for (term, slot), expression in mistake.terms.items()
                    for number in (places[term] + slot, 1 + wrong[term].index(expression))
                ]
                + [-1],
                np.int32,
            )
            for mistake in self.mistakes
        ]
        self._count = _SLOTS * len(wrong)
        lines = [f"#define TERMS {self._count}"]
        for term, expressions in wrong.items():
            variant = f"variant[{places[term]} + (slot)]"
            choices = "".join(f"{variant} == {c} ? ({e}) : " for c, e in enumerate(expressions, 1))
            lines.append(f"#define {term}(slot, ...) (!{variant} ? (__VA_ARGS__) : {choices}0)")
        (folder / "mistakes.h").write_text("\n".join(lines) + "\n")
        self._library = ctypes.CDLL(str(compiler.compile_model(folder)))

    def answer(self, mistakes: Sequence[Mistake], call: Call) -> Answer | None:
        """Return the answer of a homework with these mistakes to a call.

        None means that it would not answer, but loop for ever or use an index beyond an array.
        """
        variant = np.zeros(self._count, np.int32)
        for mistake in mistakes:
            *numbers, _ = self._variants[self.mistakes.index(mistake)]
            variant[numbers[::2]] = numbers[1::2]
        arrays = _answer_arrays(call.n)
        answer = _answer(*arrays)
        chosen = (_pointer(variant), _pointer(variant))
        self._library.answer(*chosen, ctypes.byref(_probe(call)), ctypes.byref(answer))
        state, before, record = arrays
        found = Answer(answer.zeta, answer.calls, state, before, record[: answer.recorded])
        return found if answer.end == -1 else None

    def explain(
        self,
        function: str,
        probes: Sequence[Probe],
        found: Sequence[Answer],
        wrong: Sequence[int],
        *,
        ends: Sequence[int] = (),
    ) -> Explanation:
        """Find the one or two mistakes that explain all answers of a homework.

        Parameters
        ----------
        function
            The function in which mistakes are searched.
        probes
            Calls of the function: first those that the homework answered, then those that ended it.
        found
            Answers of the homework to the first ``len(found)`` probes.
        wrong
            Indices of the wrong ones of these answers.
        ends
            The failures at the last ``len(ends)`` probes, as numbers, see `EndedError.how`.
        """
        chosen = [k for k, mistake in enumerate(self.mistakes) if mistake.function == function]
        variants = (ctypes.c_void_p * len(chosen))(*(self._variants[k].ctypes.data for k in chosen))
        asked = (_Probe * len(probes))(*(_probe(probe.call) for probe in probes))
        answers = (_Answer * len(probes))(*(_found(answer) for answer in found))
        first = _most_telling(wrong, probes)
        right = [each for k in first[:_LOOKED_AT] if (each := self.answer([], probes[k].call))]
        rights = (_Answer * len(right))(*(_found(answer) for answer in right))
        numbers = (len(found), len(first), len(ends), _integers(first), _integers(ends))
        facts = _Found(*numbers, asked, answers, rights)
        room = _answer_arrays(max(probe.call.n for probe in probes))
        own = _answer(*room)
        explaining = np.zeros((_MOST, 2), np.int32)
        for when in (*_ALONE, *_TOGETHER) if function == CONTACT else (_ALONE[0], _TOGETHER[0]):
            given = (_pointer(np.array(when, np.int32)), len(chosen), variants, ctypes.byref(facts))
            hits = self._library.search(*given, ctypes.byref(own), _MOST, _pointer(explaining))
            if hits:
                return _simplest([self._named(chosen, row, when) for row in explaining[:hits]])
        return Explanation((), False)

    def _named(self, chosen: Sequence[int], row: np.ndarray, when: tuple[int, int]) -> list[Mistake]:
        """Return the one or two mistakes that model.c found, with iterations in their names if needed.

        `row` holds two indices into `chosen`, and `chosen` indices into `self.mistakes`. `when` says for each
        of both in which iterations the mistake occurs: 1 for the first, 2 for all later, 3 for all, and 0 if
        there is no such mistake.
        """
        pairs = zip(row, when, strict=True)
        return [
            mistake._replace(name=Words(_SAID[bits], mistake=mistake.name)) if bits != _ALL else mistake
            for mistake, bits in ((self.mistakes[chosen[k]], bits) for k, bits in pairs if bits)
        ]


def _most_telling(wrong: Sequence[int], probes: Sequence[Probe]) -> list[int]:
    """Return the indices `wrong` of wrong answers, sorted so that the first answers differ most.

    For each pair of scene and iteration, the answer with the fewest grains comes first. All other answers
    follow. Both groups are sorted by the number of grains.
    """
    order = sorted(wrong, key=lambda k: probes[k].call.n)
    firsts = {(probes[k].scene, probes[k].call.iteration): k for k in reversed(order)}
    return sorted(order, key=lambda k: k not in firsts.values())


def _simplest(explanations: Sequence[Sequence[Mistake]]) -> Explanation:
    """Return the mistakes that all simplest explanations share, by name.

    An explanation is a list of mistakes that produces the answers of the homework. The simplest have the
    fewest wrong terms. The result is complete if these explanations contain no other mistakes.
    """
    sizes = [sum(len(mistake.terms) for mistake in each) for each in explanations]
    simple = [each for each, size in zip(explanations, sizes, strict=True) if size == min(sizes)]
    first = {str(mistake.name): mistake for mistake in simple[0]}
    shared = set(first).intersection(*({str(m.name) for m in each} for each in simple))
    mistakes = tuple(mistake for name, mistake in first.items() if name in shared)
    return Explanation(mistakes, len(mistakes) == len(first))


def _answer_arrays(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return zeroed arrays for an answer with n grains: `state`, `before` and `record` of `Answer`."""
    return np.zeros(7 * n + n * (n - 1) // 2), np.zeros(4 * n), np.zeros((2 * RECORDED, 3))


def _answer(state: np.ndarray, before: np.ndarray, record: np.ndarray) -> _Answer:
    return _Answer(0, 0, -1, 0.0, *(array.ctypes.data_as(_Numbers) for array in (state, before, record)))


def _found(answer: Answer) -> _Answer:
    found = _answer(answer.state, answer.before, answer.record)
    found.calls, found.recorded, found.zeta = answer.calls, len(answer.record), answer.zeta
    return found


def _probe(call: Call) -> _Probe:
    return _Probe(call.request(), call.state.ctypes.data_as(_Numbers))


def _integers(numbers: Sequence[int]) -> Any:
    return (ctypes.c_int * len(numbers))(*numbers)


def _pointer(array: np.ndarray) -> Any:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_int32))
