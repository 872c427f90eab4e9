"""Homeworks written from the course text alone: right ones pass, and the mistakes of wrong ones are named."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import written

from warpgrains.grade.compare import difference
from warpgrains.grade.diagnosis import read_mistakes
from warpgrains.grade.grader import Grader
from warpgrains.grade.verdict import Verdict

FAST = 2  # of each kind, that every run of the tests grades; the others are slow
WRONG = written.wrong()


@pytest.fixture(scope="module")
def grader(tmp_path_factory: pytest.TempPathFactory) -> Grader:
    return Grader(tmp_path_factory.mktemp("grader"))


def graded(grader: Grader, folder: Path, text: str) -> Verdict:
    source = folder / "homework.c"
    source.write_text(text)
    return grader.grade(source)


def numbered(count: int) -> list[object]:
    return [pytest.param(k, marks=[] if k % (count // FAST) == 0 else pytest.mark.slow) for k in range(count)]


@pytest.mark.parametrize("number", numbered(len(written.RIGHT)))
def test_a_right_one_passes(grader: Grader, tmp_path: Path, number: int) -> None:
    verdict = graded(grader, tmp_path, written.source(*written.RIGHT[number]))
    assert verdict.status == "right", verdict.text(False)


@pytest.mark.parametrize("number", numbered(len(WRONG)))
def test_a_wrong_one_is_named(grader: Grader, tmp_path: Path, number: int) -> None:
    names, text = WRONG[number]
    verdict = graded(grader, tmp_path, text)
    assert verdict.status == "wrong"
    told = [str(mistake.name) for part in verdict.parts for mistake in part.mistakes]
    assert told == names, verdict.text(False)
    assert {part.remark for part in verdict.reported_parts()} == {""}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(7, 12))
def test_two_mistakes_at_random_get_no_false_name(grader: Grader, seed: int) -> None:
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


def test_all_that_is_said_is_said_in_french() -> None:
    folder = Path(written.__file__).parents[3] / "warpgrains" / "grade"
    french = tomllib.loads((folder / "french.toml").read_text())
    for english, translated in french.items():
        assert sorted(fields(english)) == sorted(fields(translated)), english
    for mistake in read_mistakes():
        for words in (mistake.name, mistake.hint.look):
            assert words.french != words, words


def fields(text: str) -> list[str]:
    return [piece.split("}")[0] for piece in text.split("{")[1:]]
