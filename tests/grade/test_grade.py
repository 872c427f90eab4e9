"""Homeworks: right ones pass, each mistake is named, and hostile ones do no harm and are named."""

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile_homeworks import CHEATING, HOSTILE, SLOW_TO_ANSWER, SNOOPING, WAITS, contact_that
from right_homeworks import PLAIN, RIGHT
from wrong_homeworks import CONTACT, UPDATE, WRONG, wrong

from warpgrains.grade.compare import difference
from warpgrains.grade.grader import Grader
from warpgrains.grade.sandbox import Answer, Limits
from warpgrains.grade.verdict import BOTH, Part, Verdict

FAST = 4
"""Homeworks of a kind that every run of the tests grades; the others are slow."""
Grade = Callable[..., Verdict]


@pytest.fixture(scope="module")
def grader(tmp_path_factory: pytest.TempPathFactory) -> Grader:
    return Grader(tmp_path_factory.mktemp("grader"), limits=Limits(seconds=0.3))


@pytest.fixture(scope="module")
def hasty(tmp_path_factory: pytest.TempPathFactory) -> Grader:
    return Grader(tmp_path_factory.mktemp("hasty"), limits=Limits(patience=1.0))


@pytest.fixture
def grade(grader: Grader, tmp_path: Path) -> Grade:
    def graded(text: str) -> Verdict:
        source = tmp_path / "homework.c"
        source.write_bytes(text.encode("latin-1"))
        return grader.grade(source)

    return graded


def parts(verdict: Verdict) -> dict[str, Part]:
    return {part.name: part for part in verdict.parts}


def some(kinds: Iterable[Any]) -> list[Any]:
    """Mark all but the first few as slow."""
    every = [key if isinstance(key, tuple) else (key,) for key in kinds]
    return [pytest.param(*key, marks=[pytest.mark.slow] * (k >= FAST)) for k, key in enumerate(every)]


def names(part: Part) -> list[str]:
    return [mistake.name for mistake in part.mistakes]


def statuses(verdict: Verdict) -> list[str]:
    return [parts(verdict)[name].status for name in (UPDATE, CONTACT, BOTH)]


@pytest.mark.parametrize("style", some(RIGHT))
def test_right_ones_in_several_styles(grade: Grade, style: str) -> None:
    verdict = grade(RIGHT[style])
    assert verdict.status == "right", verdict.text(False)


STRICT = {
    "k < iterMax": "right",
    "k <= iterMax": "right",
    "k < iterMax - 1": "wrong",
    "k <= (iterMax == 5 ? 5 : 1e9)": "wrong",
    "(k < iterMax || (myGrains->x[0] = NAN, 0))": "wrong",
}


def test_strict_accepts_both_readings_of_iter_max_and_nothing_else(tmp_path: Path) -> None:
    strict = Grader(tmp_path, strict=True)
    source = tmp_path / "homework.c"
    for limit, status in STRICT.items():
        source.write_text(RIGHT["own arrays, other sums"].replace("k < iterMax", limit))
        assert parts(strict.grade(source))[UPDATE].status == status, limit


@pytest.mark.parametrize(("function", "mistake"), some(sorted(WRONG, key=itemgetter(1))))
def test_each_mistake_is_named(grade: Grade, function: str, mistake: str) -> None:
    verdict = grade(wrong(WRONG[function, mistake]))
    part = parts(verdict)
    assert names(part[function]) == [mistake], verdict.text(False)
    assert part[function].remark == ""
    assert part[function].first.startswith("scene ")
    assert statuses(verdict) == ["wrong" if name in (function, BOTH) else "right" for name in part]


@pytest.mark.slow
@pytest.mark.parametrize("first", range(36))
def test_no_two_mistakes_look_the_same(grader: Grader, first: int) -> None:
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


@pytest.mark.parametrize("what", some(HOSTILE))
def test_hostile_ones_do_no_harm_and_are_named(grade: Grade, what: str, tmp_path: Path) -> None:
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
def test_no_other_homework_can_be_read(grader: Grader, grade: Grade, what: str, tmp_path: Path) -> None:
    if any("Landlock" in missing for missing in grader.unprotected()):
        pytest.skip("this kernel cannot fence the compiler in")
    other = tmp_path / "ada.c"
    other.write_text('"secret of ada"\n')
    verdict = grade(PLAIN + SNOOPING[what].replace("PATH", str(other)))
    assert "secret" not in json.dumps(verdict.as_json())
    assert verdict.status != "right"


@pytest.mark.parametrize("what", CHEATING)
def test_the_reference_cannot_be_included(grade: Grade, what: str) -> None:
    verdict = grade(CHEATING[what])
    assert verdict.status == "does not compile"


@pytest.mark.parametrize("what", SLOW_TO_ANSWER)
def test_each_call_has_a_limit_of_time(hasty: Grader, tmp_path: Path, what: str) -> None:
    source = tmp_path / "homework.c"
    source.write_text(contact_that(*SLOW_TO_ANSWER[what]))
    verdict = hasty.grade(source)
    assert parts(verdict)[CONTACT].status == "wrong"
    assert parts(verdict)[BOTH].status == "not run"
    assert "does not answer within 1 s" in (parts(verdict)[CONTACT].ended or "")


@pytest.mark.slow
def test_a_homework_has_a_limit_of_time(tmp_path: Path) -> None:
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
def test_what_the_course_forbids_is_a_warning(grade: Grade, what: str) -> None:
    text, words = HANDED_IN[what]
    verdict = grade(text)
    assert verdict.status == "right"
    assert len(verdict.warnings) == len(words)
    assert all(word in warning for word, warning in zip(words, verdict.warnings, strict=True))
    assert verdict.text(False).count("\n  warning: ") == len(words)
    assert verdict.as_json()["warnings"] == list(verdict.warnings)
    assert verdict.as_row()["warnings"] == "; ".join(verdict.warnings)


def test_what_it_prints_is_no_verdict(grade: Grade) -> None:
    verdict = grade(contact_that('puts("\\033[2Jright"); return 0.0;'))
    assert verdict.status == "wrong"
    assert parts(verdict)[CONTACT].printed.startswith("\x1b[2Jright")
    assert "\x1b" not in verdict.text(False)


def test_numbers_written_to_the_channel_are_judged_like_answers(grade: Grade) -> None:
    forged = "for (i = 3; i < 32; i++) for (j = 0; j < 9; j++) write(i, zeros, sizeof zeros);"
    verdict = grade(contact_that(forged, "#include <unistd.h>\nstatic char zeros[64];\n"))
    assert parts(verdict)[CONTACT].status == "wrong"


def test_two_mistakes_are_both_named(grade: Grade) -> None:
    two = ["iteration 0 does nothing", "zeta without absolute value"]
    changes = (change for name in two for change in WRONG[CONTACT, name])
    verdict = grade(wrong((*changes, *WRONG[UPDATE, "positions moved twice"])))
    assert names(parts(verdict)[CONTACT]) == two
    assert names(parts(verdict)[UPDATE]) == ["positions moved twice"]
    assert {part.remark for part in verdict.parts} == {""}


UNKNOWN = {
    "float": (CONTACT, "double vn = vx[i] * nx + vy[i] * ny;", "float vn = vx[i] * nx + vy[i] * ny;", ""),
    "more than 28 grains": (CONTACT, "return zeta;", "return n > 28 ? 0 : zeta;", "zeta is 0"),
    "garbage where iterMax ends the step": (
        UPDATE,
        "        y[i] += vy[i] * dt;",
        "        y[i] += zeta > tol ? NAN : vy[i] * dt;",
        "y[0] is nan",
    ),
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


@pytest.mark.parametrize("what", some(UNKNOWN))
def test_a_mistake_without_a_name_gets_none(grade: Grade, what: str) -> None:
    function, right, instead, first = UNKNOWN[what]
    assert PLAIN.count(right) == 1
    part = parts(grade(PLAIN.replace(right, instead)))[function]
    assert names(part) == []
    assert ("float" in part.remark) == (what == "float")
    assert all(said in part.remark for word, said in ONLY.items() if word in what)
    assert first in (part.first or "")
    assert part.hint is not None


def test_functions_that_spoil_each_other(grade: Grade) -> None:
    text = PLAIN.replace("\n\n", "\n\nstatic double seen;\n", 1).replace(
        "double zeta = 0.0;", "double zeta = seen = 0.1;"
    )
    verdict = grade(
        text.replace("zeta = seen = 0.1;", "zeta = 0.0; seen = 0.1;").replace("fx * dt", "(fx + seen) * dt")
    )
    assert statuses(verdict) == ["right", "right", "wrong"]
    assert parts(verdict)[BOTH].remark.startswith("each function is right alone")


def test_one_function_that_is_missing_or_does_not_compile(grade: Grade) -> None:
    contact, update = PLAIN.split("#endif\n")[:2]
    alone = contact.replace("#ifndef NOCONTACTITERATE\n", "")
    assert statuses(grade(alone)) == ["missing", "right", "missing"]
    verdict = grade(f"{contact}#endif\n{update.replace('int i,', 'int i')}#endif\n")
    assert statuses(verdict) == ["does not compile", "right", "does not compile"]
    assert "homework.c:" in verdict.compiler
    assert "error" in verdict.compiler


def test_undefined_functions_are_named(grade: Grade) -> None:
    verdict = grade(contact_that("zeta = elsewhere(1.0);", "double elsewhere(double);\n"))
    assert statuses(verdict) == ["right", "missing", "not run"]
    assert "undefined symbol: elsewhere" in (parts(verdict)[CONTACT].ended or "")


def test_only_rounding_passes(grader: Grader) -> None:
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


@pytest.mark.parametrize(
    "mistake", ["gravity missing", "tolerance ignored", "positions moved before the contacts"]
)
def test_iteration_0_may_count_for_the_limit_beside_a_mistake(grade: Grade, mistake: str) -> None:
    text = wrong(WRONG[UPDATE, mistake])
    part = parts(grade(text.replace("iter <= iterMax", "iter < iterMax")))[UPDATE]
    assert (names(part), part.remark) == ([mistake], "")


def test_zeta_of_no_probe_is_the_tolerance(grader: Grader) -> None:
    """So that a right homework ends every step where the reference does, however it sums."""
    for probe, expected in zip(grader.probes[UPDATE], grader.expected[UPDATE], strict=True):
        for zeta in expected.record[1:, 2]:
            near = replace(expected, record=np.array([[1.0, probe.call.dt, probe.call.tolerance]]))
            at = replace(expected, record=np.array([[1.0, probe.call.dt, zeta]]))
            assert difference(probe, near, at) is not None, (probe.scene, probe.step)


def test_no_parameter_is_the_same_in_all_scenes(grader: Grader) -> None:
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


def answer_with(answer: Answer, place: int, change: float) -> Answer:
    state = answer.state.copy()
    state[place] += change
    return replace(answer, state=state)
