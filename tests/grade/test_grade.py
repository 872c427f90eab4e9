"""Homeworks: right ones pass, each mistake is named, and hostile ones do no harm and are named."""

import json
import tomllib
from dataclasses import replace
from operator import itemgetter
from pathlib import Path

import numpy as np
import pytest
import written
from hostile_homeworks import CHEATING, HOSTILE, SLOW_TO_ANSWER, SNOOPING, WAITS, contact_that
from right_homeworks import PLAIN, RIGHT
from wrong_homeworks import CONTACT, UPDATE, WRONG, wrong

from warpgrains.grade.compare import difference
from warpgrains.grade.diagnosis import read_mistakes
from warpgrains.grade.grader import Grader
from warpgrains.grade.sandbox import Limits
from warpgrains.grade.verdict import BOTH

FAST = 2
"""Homeworks of a kind that every run of the tests grades; the others are slow."""


@pytest.fixture(scope="module")
def grader(tmp_path_factory):
    return Grader(tmp_path_factory.mktemp("grader"), limits=Limits(seconds=0.3))


@pytest.fixture(scope="module")
def hasty(tmp_path_factory):
    return Grader(tmp_path_factory.mktemp("hasty"), limits=Limits(patience=1.0))


@pytest.fixture
def grade(grader, tmp_path):
    def graded(text):
        source = tmp_path / "homework.c"
        source.write_bytes(text.encode("latin-1"))
        return grader.grade(source)

    return graded


def parts(verdict):
    return {part.name: part for part in verdict.parts}


def some(kinds, fast=FAST):
    """Mark all but the first few as slow."""
    marks = [[]] * fast + [pytest.mark.slow] * len(kinds)
    cases = ((name, case if isinstance(case, tuple) else (case,)) for name, case in kinds.items())
    return [pytest.param(*case, marks=own, id=name) for (name, case), own in zip(cases, marks, strict=False)]


def names(part):
    return [mistake.name for mistake in part.mistakes]


def statuses(verdict):
    return [parts(verdict)[name].status for name in (UPDATE, CONTACT, BOTH)]


@pytest.mark.parametrize("text", some(RIGHT) + some(written.right(), 1))
def test_right_ones_in_several_styles(grade, text):
    verdict = grade(text)
    assert verdict.status == "right", verdict.text(False)


STRICT = {
    "k < iterMax": "right",
    "k <= iterMax": "right",
    "k < iterMax - 1": "wrong",
    "(k < iterMax || (myGrains->x[0] = NAN, 0))": "wrong",
}


def test_strict_accepts_both_readings_of_iter_max_and_nothing_else(tmp_path):
    strict = Grader(tmp_path, strict=True)
    source = tmp_path / "homework.c"
    for limit, status in STRICT.items():
        source.write_text(RIGHT["own arrays, other sums"].replace("k < iterMax", limit))
        assert parts(strict.grade(source))[UPDATE].status == status, limit


CHANGED = {name: ([name], wrong(WRONG[of, name])) for of, name in sorted(WRONG, key=itemgetter(1))}


@pytest.mark.parametrize(
    ("mistakes", "text"), some(CHANGED) + some(written.wrong("one"), 1) + some(written.wrong("two"), 1)
)
def test_each_mistake_is_named(grade, mistakes, text):
    verdict = grade(text)
    assert [name for part in verdict.parts for name in names(part)] == mistakes, verdict.text(False)
    for part in verdict.parts[:2]:
        assert part.status == ("wrong" if part.mistakes else "right")
        assert part.first is None or part.first.startswith("scene ")
    assert {part.remark for part in verdict.reported_parts()} == {""}
    assert parts(verdict)[BOTH].status == "wrong"


@pytest.mark.slow
@pytest.mark.parametrize("first", range(36))
def test_no_two_mistakes_look_the_same(grader, first):
    """Each mistake of the model explains its own answers, and no other mistake does."""
    for mistake in grader.model.mistakes[first::36]:
        probes, expected = grader.probes[mistake.function], grader.expected[mistake.function]
        own = [each for probe in probes if (each := grader.model.answer([mistake], probe.call))]
        if len(own) < len(probes):  # it ends
            continue
        wrong = [k for k, each in enumerate(zip(probes, expected, own, strict=True)) if difference(*each)]
        assert wrong, mistake.name
        named = grader.model.explain(mistake.function, probes, own, wrong)
        assert [each.name for each in named.mistakes] == [mistake.name]
        assert named.is_complete


@pytest.mark.parametrize("what", some({what: what for what in HOSTILE}))
def test_hostile_ones_do_no_harm_and_are_named(grade, what, tmp_path):
    does, before, said = HOSTILE[what]
    verdict = grade(contact_that(does, before))
    part = parts(verdict)[CONTACT]
    is_early = what.startswith("before main")
    assert statuses(verdict) == ["wrong" if is_early else "right", "wrong", "not run"]
    assert said in (part.ended or ""), verdict.text(False)
    assert (part.hint is not None) == (what == "a wrong index")
    assert not (is_early and any(part.mistakes for part in verdict.parts))
    assert "root:" not in json.dumps(verdict.as_json())
    assert not list(tmp_path.parent.parent.rglob("hacked"))


@pytest.mark.parametrize("what", SNOOPING)
def test_no_other_homework_can_be_read(grader, grade, what, tmp_path):
    if any("Landlock" in missing for missing in grader.unprotected()):
        pytest.skip("this kernel cannot fence the compiler in")
    other = tmp_path / "ada.c"
    other.write_text('"secret of ada"\n')
    verdict = grade(PLAIN + SNOOPING[what].replace("PATH", str(other)))
    assert "secret" not in json.dumps(verdict.as_json())
    assert verdict.status != "right"


@pytest.mark.parametrize("what", CHEATING)
def test_the_reference_cannot_be_included(grade, what):
    verdict = grade(CHEATING[what])
    assert verdict.status == "does not compile"


@pytest.mark.parametrize("what", SLOW_TO_ANSWER)
def test_each_call_has_a_limit_of_time(hasty, tmp_path, what):
    source = tmp_path / "homework.c"
    source.write_text(contact_that(*SLOW_TO_ANSWER[what]))
    verdict = hasty.grade(source)
    assert parts(verdict)[CONTACT].status == "wrong"
    assert parts(verdict)[BOTH].status == "not run"
    assert "does not answer within 1 s" in (parts(verdict)[CONTACT].ended or "")


@pytest.mark.slow
def test_a_homework_has_a_limit_of_time(tmp_path):
    grader = Grader(tmp_path, limits=Limits(patience=60.0, total=4.0))
    source = tmp_path / "homework.c"
    source.write_text(contact_that("wait_for(0.5);", WAITS))
    ended = parts(grader.grade(source))[CONTACT].ended or ""
    assert "takes more than 4 s" in ended


HANDED_IN = {
    "the empty one": (PLAIN, []),
    "a program": (f"{PLAIN}int main(void) {{ return 0; }}\n", ["main"]),
    "a program that is left out": (f"{PLAIN}#ifdef TEST\nint main(void) {{ return 0; }}\n#endif\n", []),
    "no markers": (RIGHT["helpers, no markers, columns first"], ["#ifndef"]),
    "one marker": (PLAIN.replace("#ifndef NOUPDATE", "#if 1"), ["#ifndef"]),
    "both": (f"{PLAIN}int main(void) {{ return 0; }}\n".replace("NOUPDATE", "UPDATE"), ["main", "#ifndef"]),
}


@pytest.mark.parametrize("what", HANDED_IN)
def test_what_the_course_forbids_is_a_warning(grade, what):
    text, words = HANDED_IN[what]
    verdict = grade(text)
    assert verdict.status == "right"
    assert len(verdict.warnings) == len(words)
    assert all(word in warning for word, warning in zip(words, verdict.warnings, strict=True))
    assert verdict.text(False).count("\n  warning: ") == len(words)
    assert verdict.as_json()["warnings"] == list(verdict.warnings)
    assert verdict.as_row()["warnings"] == "; ".join(verdict.warnings)


def test_what_it_prints_is_no_verdict(grade):
    verdict = grade(contact_that('puts("\\033[2Jright"); return 0.0;'))
    assert verdict.status == "wrong"
    assert parts(verdict)[CONTACT].printed.startswith("\x1b[2Jright")
    assert "\x1b" not in verdict.text(False)


def test_numbers_written_to_the_channel_are_judged_like_answers(grade):
    forged = "for (i = 3; i < 32; i++) for (j = 0; j < 9; j++) write(i, zeros, sizeof zeros);"
    verdict = grade(contact_that(forged, "#include <unistd.h>\nstatic char zeros[64];\n"))
    assert parts(verdict)[CONTACT].status == "wrong"


UNKNOWN = {
    "float": (CONTACT, "double vn = vx[i] * nx + vy[i] * ny;", "float vn = vx[i] * nx + vy[i] * ny;", ""),
    "garbage where iterMax ends the step": (
        UPDATE,
        "        y[i] += vy[i] * dt;",
        "        y[i] += zeta > tol ? NAN : vy[i] * dt;",
        "y[0] is nan",
    ),
    "more than 28 grains": (CONTACT, "return zeta;", "return n > 28 ? 0 : zeta;", "zeta is 0"),
    "a single iterMax": (UPDATE, "iter <= iterMax", "(iterMax != 5 || iter <= 5)", "number of calls"),
    "a number": (UPDATE, "y[i] += vy[i] * dt;", "y[i] += vy[i] * dt * 0.9;", "y[0] is "),
    "a shift": (CONTACT, "double gap = rr - r[i] - r[j];", "double gap = rr - r[i] - r[j] - 1e-3;", ""),
    "a factor": (CONTACT, "vy[i] -= dv * ny;", "vy[i] -= 0.9 * dv * ny;", ""),
    "garbage where iterMax, which counts iteration 0, ends the step": (
        UPDATE,
        """iter <= iterMax) || iter == 1);""",
        """iter < iterMax) || iter == 1);\n    if (zeta > tol) x[0] = NAN;""",
        "x[0] is nan",
    ),
}
ONLY = {"iterMax": "only steps that iterMax ends", "28": "only scenes of 42 or more grains"}


@pytest.mark.parametrize("what", some({what: what for what in UNKNOWN}))
def test_a_mistake_without_a_name_gets_none(grade, what):
    function, right, instead, first = UNKNOWN[what]
    assert PLAIN.count(right) == 1
    part = parts(grade(PLAIN.replace(right, instead)))[function]
    assert names(part) == []
    assert ("float" in part.remark) == (what == "float")
    assert all(said in part.remark for word, said in ONLY.items() if word in what)
    assert first in (part.first or "")
    assert part.hint is not None


def test_functions_that_spoil_each_other(grade):
    text = PLAIN.replace("\n\n", "\n\nstatic double seen;\n", 1).replace(
        "double zeta = 0.0;", "double zeta = seen = 0.1;"
    )
    verdict = grade(
        text.replace("zeta = seen = 0.1;", "zeta = 0.0; seen = 0.1;").replace("fx * dt", "(fx + seen) * dt")
    )
    assert statuses(verdict) == ["right", "right", "wrong"]
    assert parts(verdict)[BOTH].remark.startswith("each function is right alone")


def test_one_function_that_is_missing_or_does_not_compile(grade):
    contact, update = PLAIN.split("#endif\n")[:2]
    alone = contact.replace("#ifndef NOCONTACTITERATE\n", "")
    assert statuses(grade(alone)) == ["missing", "right", "missing"]
    verdict = grade(f"{contact}#endif\n{update.replace('int i,', 'int i')}#endif\n")
    assert statuses(verdict) == ["does not compile", "right", "does not compile"]
    assert "homework.c:" in verdict.compiler
    assert "error" in verdict.compiler


def test_undefined_functions_are_named(grade):
    verdict = grade(contact_that("zeta = elsewhere(1.0);", "double elsewhere(double);\n"))
    assert statuses(verdict) == ["right", "missing", "not run"]
    assert "undefined symbol: elsewhere" in (parts(verdict)[CONTACT].ended or "")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(7, 12))
def test_two_mistakes_at_random_get_no_false_name(grader, seed):
    random = np.random.default_rng(seed)
    complete = 0
    for function, count in (("femGrainsContactIterate", 12), ("femGrainsUpdate", 6)):
        mistakes = [mistake for mistake in read_mistakes() if mistake.function == function]
        probes, expected = grader.probes[function], grader.expected[function]
        for _ in range(count):
            two = [mistakes[k] for k in random.choice(len(mistakes), 2, replace=False)]
            if set(two[0].terms) & set(two[1].terms):
                continue
            found = [own for probe in probes if (own := grader.model.answer(two, probe.call))]
            if len(found) < len(probes):  # it ends
                continue
            wrong = [
                k for k, each in enumerate(zip(probes, expected, found, strict=True)) if difference(*each)
            ]
            named, is_complete = grader.model.explain(function, probes, found, wrong)
            terms = {item for mistake in two for item in mistake.terms.items()}
            names = {str(mistake.name) for mistake in two}
            assert all(str(m.name) in names or set(m.terms.items()) <= terms for m in named)
            complete += is_complete
    assert complete > 9


def test_only_rounding_passes(grader):
    for function, probes in grader.probes.items():
        for probe, expected in list(zip(probes, grader.expected[function], strict=True))[::7]:
            for name, start in (("x", 0), ("vx", 2), ("dvBoundary", 6)):
                other = answer_with(expected, start * probe.call.n, 1e-7)
                assert difference(probe, expected, expected, eps=0.0) is None
                found = difference(probe, expected, other)
                assert found is not None
                assert found.quantity == f"{name}[0]"
                nearly = answer_with(expected, start * probe.call.n, np.spacing(1.0))
                assert difference(probe, expected, nearly) is None
                assert (difference(probe, expected, nearly, eps=0.0) is None) == np.array_equal(
                    nearly.state, expected.state
                )


@pytest.mark.parametrize("mistake", ["gravity missing", "tolerance ignored"])
def test_iteration_0_may_count_for_the_limit_beside_a_mistake(grade, mistake):
    text = wrong(WRONG[UPDATE, mistake])
    part = parts(grade(text.replace("iter <= iterMax", "iter < iterMax")))[UPDATE]
    assert (names(part), part.remark) == ([mistake], "")


def test_zeta_of_no_probe_is_the_tolerance(grader):
    """So that a right homework ends every step where the reference does, however it sums."""
    for probe, expected in zip(grader.probes[UPDATE], grader.expected[UPDATE], strict=True):
        for zeta in expected.record[1:, 2]:
            near = replace(expected, record=np.array([[1.0, probe.call.dt, probe.call.tolerance]]))
            at = replace(expected, record=np.array([[1.0, probe.call.dt, zeta]]))
            assert difference(probe, near, at) is not None, (probe.scene, probe.step)


def test_no_parameter_is_the_same_in_all_scenes(grader):
    calls = {probe.scene: probe.call for probes in grader.probes.values() for probe in probes}.values()
    for field in ("n", "dt", "radius_in", "radius_out", "gravity", "drag"):
        assert len({getattr(call, field) for call in calls}) >= 3, field
    assert {len(set(map(np.sign, call.gravity))) for call in calls} == {1, 2}
    assert min(call.radius_in for call in calls) == 0.0
    assert max(call.n for call in calls) > 40
    ended = [
        probe.call.max_iterations
        for probe, answer in zip(grader.probes[UPDATE], grader.expected[UPDATE], strict=True)
        if answer.calls > probe.call.max_iterations
    ]
    assert set(ended) == {3, 4, 5, 6, 7, 8}


def answer_with(answer, place, change):
    state = answer.state.copy()
    state[place] += change
    return replace(answer, state=state)


def test_all_that_is_said_is_said_in_french():
    folder = Path(written.__file__).parents[3] / "warpgrains" / "grade"
    french = tomllib.loads((folder / "french.toml").read_text())
    for english, translated in french.items():
        assert sorted(fields(english)) == sorted(fields(translated)), english
    for mistake in read_mistakes():
        for words in (mistake.name, mistake.hint.look):
            assert words.french != words, words


def fields(text):
    return [piece.split("}")[0] for piece in text.split("{")[1:]]
