"""Homeworks: right ones pass, each mistake is named, and hostile ones do no harm and are named."""

import json
import tomllib
from copy import copy
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from homeworks import (
    BEFORE,
    CHEATING,
    DRAWN,
    HOSTILE,
    OWN_ARRAYS,
    PLAIN,
    PLAIN_WRONG,
    RIGHT,
    SNOOPING,
    UNKNOWN,
    UNSET,
    changed,
    contact_that,
    right_of_styles,
    wrong_of_styles,
)

from warpgrains.grade import words
from warpgrains.grade.compare import difference
from warpgrains.grade.diagnosis import read_mistakes
from warpgrains.grade.grader import Grader
from warpgrains.grade.probes import draw_probes
from warpgrains.grade.sandbox import CONTACT, UPDATE, Limits
from warpgrains.grade.verdict import BOTH
from warpgrains.reference.reference import SOURCE


@pytest.fixture(scope="module")
def grader(tmp_path_factory):
    return Grader(tmp_path_factory.mktemp("grader"), limits=Limits(seconds=0.3))


@pytest.fixture
def grade(grader, tmp_path):
    """Grade a text, by a grader with other attributes if they are given."""

    def graded(text, **attributes):
        source, own = tmp_path / "homework.c", copy(grader)
        source.write_bytes(text.encode("latin-1"))
        vars(own).update(attributes)
        return own.grade(source)

    return graded


def some(kinds, fast):
    """Mark all but the first few cases as slow."""
    marks = [[]] * fast + [pytest.mark.slow] * len(kinds)
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=own, id=name)
        for (name, case), own in zip(kinds.items(), marks, strict=False)
    ]


def parts(verdict):
    return {part.name: part for part in verdict.parts}


def names(part):
    return [mistake.name for mistake in part.mistakes]


def statuses(verdict):
    return [parts(verdict)[name].status for name in (UPDATE, CONTACT, BOTH)]


@pytest.mark.parametrize(("text", "warned"), some(RIGHT, 4) + some(right_of_styles(), 1))
def test_right_ones_pass_and_what_the_course_forbids_is_a_warning(grade, text, warned):
    verdict = grade(text)
    assert verdict.status == "right", verdict.text(False)
    assert len(verdict.warnings) == len(warned)
    assert all(word in warning for word, warning in zip(warned, verdict.warnings, strict=True))
    assert verdict.text(False).count("\n  warning: ") == len(warned)
    assert verdict.as_json()["warnings"] == list(verdict.warnings)
    assert verdict.as_row()["warnings"] == "; ".join(verdict.warnings)


STRICT = {
    "k < iterMax": "right",
    "k <= iterMax": "right",
    "k < iterMax - 1": "wrong",
    "(k < iterMax || (myGrains->x[0] = NAN, 0))": "wrong",
}


@pytest.mark.parametrize(("limit", "status"), STRICT.items())
def test_strict_accepts_both_readings_of_iter_max_and_nothing_else(grade, limit, status):
    verdict = grade(OWN_ARRAYS.replace("k < iterMax", limit), _strict=True)
    assert parts(verdict)[UPDATE].status == status


CHANGED = {mistake: ([mistake], text) for mistake, text in sorted(PLAIN_WRONG.items())}
WRITTEN = some(wrong_of_styles("one"), 1) + some(wrong_of_styles("two"), 1)


@pytest.mark.parametrize(("mistakes", "text"), some(CHANGED, 2) + WRITTEN)
def test_each_mistake_is_named(grade, mistakes, text):
    verdict = grade(text)
    assert [name for part in verdict.parts for name in names(part)] == mistakes, verdict.text(False)
    for part in verdict.parts[:2]:
        assert part.status == ("wrong" if part.mistakes else "right")
        assert part.first is None or part.first.startswith("scene ")
    assert {part.remark for part in verdict.reported_parts()} == {""}
    assert parts(verdict)[BOTH].status == "wrong"


def answers_with(grader, mistakes):
    """Return the probes of a function, the answers with mistakes, and which are wrong; None if it ends."""
    probes, expected, *_ = grader.fixed[mistakes[0].function]
    own = [each for probe in probes if (each := grader.model.answer(mistakes, probe.call))]
    if len(own) < len(probes):
        return None
    return (
        probes,
        own,
        [k for k, each in enumerate(zip(probes, expected, own, strict=True)) if difference(*each)],
    )


@pytest.mark.slow
@pytest.mark.parametrize("first", range(36))
def test_no_two_mistakes_look_the_same(grader, first):
    """Each mistake of the model explains its own answers, and no other mistake does."""
    for mistake in grader.model.mistakes[first::36]:
        if found := answers_with(grader, [mistake]):
            assert found[-1], mistake.name
            named = grader.model.explain(mistake.function, *found)
            assert [each.name for each in named.mistakes] == [mistake.name]
            assert named.is_complete


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(7, 12))
def test_two_mistakes_at_random_get_no_false_name(grader, seed):
    random, complete = np.random.default_rng(seed), 0
    for function, count in ((CONTACT, 12), (UPDATE, 6)):
        mistakes = [mistake for mistake in read_mistakes() if mistake.function == function]
        for _ in range(count):
            two = [mistakes[k] for k in random.choice(len(mistakes), 2, replace=False)]
            if set(two[0].terms) & set(two[1].terms) or not (found := answers_with(grader, two)):
                continue
            named, is_complete = grader.model.explain(function, *found)
            terms = {item for mistake in two for item in mistake.terms.items()}
            own = {str(mistake.name) for mistake in two}
            assert all(str(m.name) in own or set(m.terms.items()) <= terms for m in named)
            complete += is_complete
    assert complete > 9


PATIENT = {
    **dict.fromkeys(("it waits", "a byte now and then", "before main, a full pipe"), Limits(patience=1.0)),
    "little by little": Limits(total=4.0),
}
"""Limits of those that keep the grader waiting."""
HINTED = ("a wrong index", "a forged answer", "before main, a full pipe")


@pytest.mark.parametrize("what", some({what: what for what in HOSTILE}, 7))
def test_hostile_ones_do_no_harm_and_are_named(grader, grade, what, tmp_path):
    said, *text = HOSTILE[what]
    verdict = grade(contact_that(*text), _limits=PATIENT.get(what, grader._limits))
    part = parts(verdict)[CONTACT]
    is_early = what.startswith("before main")
    assert statuses(verdict) == ["wrong" if is_early else "right", "wrong", "not run"]
    assert said in (part.ended or ""), verdict.text(False)
    assert (part.hint is not None) == (what in HINTED)
    assert not (is_early and any(part.mistakes for part in verdict.parts))
    assert "root:" not in json.dumps(verdict.as_json())
    assert not list(tmp_path.parent.rglob("hacked"))


@pytest.mark.parametrize("what", SNOOPING)
def test_no_other_homework_can_be_read(grader, grade, what, tmp_path):
    if any("Landlock" in missing for missing in grader.unprotected()):
        pytest.skip("this kernel cannot fence the compiler in")
    other = tmp_path / "ada.c"
    other.write_text('"secret of ada"\n')
    verdict = grade(PLAIN + BEFORE + SNOOPING[what].replace("PATH", str(other)))
    assert "secret" not in json.dumps(verdict.as_json())
    assert verdict.status != "right"


@pytest.mark.parametrize("what", CHEATING)
def test_the_reference_cannot_be_included(grade, what):
    assert grade(CHEATING[what].replace("SOURCE", str(SOURCE)) + "\n").status == "does not compile"


def test_what_it_prints_is_no_verdict(grade):
    verdict = grade(contact_that('puts("\\033[2Jright"); return 0.0;'))
    assert verdict.status == "wrong"
    assert parts(verdict)[CONTACT].printed.startswith("\x1b[2Jright")
    assert "\x1b" not in verdict.text(False)


ONLY = {"iterMax": "only steps that iterMax ends", "28": "only scenes of 42 or more grains"}


@pytest.mark.parametrize("what", some({what: what for what in UNKNOWN}, 3))
def test_a_mistake_without_a_name_gets_none(grade, what):
    function, right, instead, first = UNKNOWN[what]
    part = parts(grade(changed((right, instead))))[function]
    assert names(part) == []
    assert ("float" in part.remark) == (what == "float")
    assert all(said in part.remark for word, said in ONLY.items() if word in what)
    assert first in (part.first or "")
    assert part.hint is not None


@pytest.mark.parametrize("what", DRAWN)
def test_what_only_calls_that_are_drawn_show_is_said_with_the_call(grade, what):
    function, edits, said = DRAWN[what]
    verdict = grade(changed(*edits))
    part = parts(verdict)[function]
    assert {scene for scene, wrong in part.scenes.items() if wrong} == {"random"}, verdict.text(False)
    assert part.first.startswith("scene random, call = ")
    assert said in part.first + part.remark
    assert f"--seed {verdict.seed} " in verdict.text(False)


@pytest.mark.parametrize("what", UNSET)
def test_memory_that_is_not_set_is_named(grade, what):
    function, edits = UNSET[what]
    part = parts(grade(changed(*edits)))[function]
    assert part.status == "wrong"
    assert "read before it is set" in part.remark


@pytest.mark.parametrize("seed", [0, 1, pytest.param(2, marks=pytest.mark.slow)])
def test_calls_are_drawn_by_the_seed(grader, seed):
    with grader._child({}) as child:
        one, other = (draw_probes(child, seed) for _ in range(2))
    for function, probes in one.items():
        calls = [probe.call for probe in probes]
        again = [probe.call.state.tobytes() for probe in other[function]]
        assert [call.state.tobytes() for call in calls] == again
        assert sum(call.times for call in calls) > 1000
        assert [min(call.n for call in calls), max(call.n for call in calls) > 200] == [1, True]
        assert min(call.dt for call in calls) < 1e-3 < 1e-1 < max(call.dt for call in calls)
        assert 0.0 in {call.drag for call in calls}
        assert (0.0, 0.0) in {call.gravity for call in calls}
        assert {0.0} < {call.radius_in for call in calls}


def test_functions_that_spoil_each_other(grade):
    verdict = grade(
        changed(
            ('#include "fem.h"\n', '#include "fem.h"\nstatic double seen;\n'),
            ("double zeta = 0.0;", "double zeta = 0.0; seen = 0.1;"),
            ("fx * dt", "(fx + seen) * dt"),
        )
    )
    assert statuses(verdict) == ["right", "right", "wrong"]
    assert parts(verdict)[BOTH].remark.startswith("each function is right alone")


def test_one_function_that_is_missing_or_does_not_compile_or_link(grade):
    contact, update = PLAIN.split("#endif\n")[:2]
    alone = contact.replace("#ifndef NOCONTACTITERATE\n", "")
    assert statuses(grade(alone)) == ["missing", "right", "missing"]
    verdict = grade(f"{contact}#endif\n{update.replace('int i,', 'int i')}#endif\n")
    assert statuses(verdict) == ["does not compile", "right", "does not compile"]
    assert "homework.c:" in verdict.compiler
    assert "error" in verdict.compiler
    verdict = grade(contact_that("zeta = elsewhere(1.0);", "double elsewhere(double);\n"))
    assert statuses(verdict) == ["right", "missing", "not run"]
    assert "undefined symbol: elsewhere" in (parts(verdict)[CONTACT].ended or "")


def test_iteration_0_may_count_for_the_limit_beside_a_mistake(grade):
    text = PLAIN_WRONG["tolerance ignored"].replace("iter <= iterMax", "iter < iterMax")
    part = parts(grade(text))[UPDATE]
    assert (names(part), part.remark) == (["tolerance ignored"], "")


def test_only_rounding_passes(grader):
    for asked in grader.fixed.values():
        for probe, expected in list(zip(asked.probes, asked.expected, strict=True))[::7]:
            assert difference(probe, expected, expected, eps=0.0) is None
            for name, start in (("x", 0), ("vx", 2), ("dvBoundary", 6)):
                far, near = (
                    answer_with(expected, start * probe.call.n, by) for by in (1e-7, np.spacing(1.0))
                )
                found = difference(probe, expected, far)
                assert found is not None
                assert found.quantity == f"{name}[0]"
                assert difference(probe, expected, near) is None
                is_same = np.array_equal(near.state, expected.state)
                assert (difference(probe, expected, near, eps=0.0) is None) == is_same


def answer_with(answer, place, change):
    state = answer.state.copy()
    state[place] += change
    return replace(answer, state=state)


def test_zeta_of_no_probe_is_the_tolerance(grader):
    """So that a right homework ends every step where the reference does, however it sums."""
    rounds = grader.fixed[UPDATE], grader.drawn[UPDATE]
    asked = (zip(each.probes, each.expected, strict=True) for each in rounds)
    for probe, expected in chain.from_iterable(asked):
        for zeta in expected.record[1:, 2]:
            near = replace(expected, record=np.array([[1.0, probe.call.dt, probe.call.tolerance]]))
            at = replace(expected, record=np.array([[1.0, probe.call.dt, zeta]]))
            assert difference(probe, near, at) is not None, (probe.scene, probe.step)


def test_all_that_is_said_is_said_in_french():
    french = tomllib.loads(Path(words.__file__).with_name("french.toml").read_text())
    for english, translated in french.items():
        assert sorted(fields(english)) == sorted(fields(translated)), english
    for mistake in read_mistakes():
        for said in (mistake.name, mistake.hint.look):
            assert said.french != said, said


def fields(text):
    return [piece.split("}")[0] for piece in text.split("{")[1:]]
