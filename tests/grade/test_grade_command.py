"""`warpgrains grade`: verdicts, exit codes, tables of a folder, and the template."""

import json
from pathlib import Path

import pytest
from command import exit_code, require_refusal
from pages import PAGES
from right_homeworks import PLAIN
from wrong_homeworks import CONTACT, UPDATE, WRONG, wrong

from warpgrains.files import read_table
from warpgrains.reference.reference import SOURCE

Capture = pytest.CaptureFixture[str]


def homework(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_a_right_one(tmp_path: Path, capfd: Capture) -> None:
    path = homework(tmp_path / "homework.c", PLAIN)
    assert exit_code("grade", path, "--json") == 0
    verdict = json.loads(capfd.readouterr().out)
    assert (verdict["file"], verdict["status"], verdict["compiler"]) == (str(path), "right", "")
    assert [part["name"] for part in verdict["parts"]] == [UPDATE, CONTACT, "both together"]
    assert all(set(part["scenes"].values()) == {"right"} for part in verdict["parts"])


def test_a_wrong_one_as_the_docs_show_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    path = homework(Path("mine/homework.c"), wrong(WRONG[CONTACT, "masses swapped"]))
    assert exit_code("grade", path) == 1
    printed = capfd.readouterr().out
    assert f"{CONTACT}  right         wrong         wrong         right         wrong\n" in printed
    assert "\n  mistake: masses swapped (grain i takes m_j / (m_i + m_j)" in printed
    assert f"```\n{printed}```\n" in PAGES["course"].read_text()


def test_one_that_does_not_compile(tmp_path: Path, capfd: Capture) -> None:
    path = homework(tmp_path / "homework.c", PLAIN.replace("double zeta", "doubel zeta"))
    assert exit_code("grade", path) == 2
    printed = capfd.readouterr().out
    assert printed.startswith(f"{path}: does not compile\n\n")
    assert "homework.c:19:5: error: unknown type name" in printed


def test_strict_lets_only_the_bits_of_the_reference_pass(tmp_path: Path, capfd: Capture) -> None:
    text = (
        SOURCE.read_text()
        .replace("#include", "#define NOCREATE\n#include")
        .replace("grains.h", f"{SOURCE.parent}/grains.h")
    )
    assert exit_code("grade", homework(tmp_path / "homework.c", text), "--strict") == 0
    assert exit_code("grade", homework(tmp_path / "homework.c", PLAIN), "--strict") == 1
    assert capfd.readouterr().out.count("it differs by rounding only") == 2


def test_a_folder(tmp_path: Path, capfd: Capture) -> None:
    folder, output = tmp_path / "all", tmp_path / "grades.csv"
    homework(folder / "ada" / "homework.c", PLAIN)
    homework(folder / "bob" / "homework.c", wrong(WRONG[UPDATE, "drag missing"]))
    homework(folder / "eve.c", "=1+1\n")
    assert exit_code("grade", folder, "-o", output) == 2
    assert (
        capfd.readouterr().out.split() == f"homeworks 3 right 1 wrong 1 not compiled 1 table {output}".split()
    )
    rows = {row["file"]: row for row in read_table(output)}
    assert [row["status"] for row in rows.values()] == ["right", "wrong", "does not compile"]
    assert rows["bob/homework.c"]["mistakes"] == "drag missing"
    assert rows["bob/homework.c"][CONTACT] == "right"
    assert rows["eve.c"]["first"].startswith("homework.c:1:1: error:")
    (folder / "bob" / "homework.c").unlink()
    assert exit_code("grade", folder, "-o", output, "--json") == 2
    assert [verdict["status"] for verdict in json.loads(capfd.readouterr().out)] == [
        "right",
        "does not compile",
    ]
    assert len(read_table(output)) == 2


def test_the_template(tmp_path: Path, capfd: Capture) -> None:
    folder = tmp_path / "mine"
    assert exit_code("grade", "--template", folder) == 0
    names = {"homework.c", "fem.h", "README.md", "LISEZMOI.md"}
    assert {Path(line).name for line in capfd.readouterr().out.split()} == names
    assert {path.name for path in folder.iterdir()} == names
    assert exit_code("grade", folder / "homework.c", "--json") == 1
    verdict = json.loads(capfd.readouterr().out)
    assert verdict["compiler"].count("warning") == verdict["compiler"].count("unused")
    assert [part["mistakes"] for part in verdict["parts"]] == [["not written"], ["not written"], []]
    homework(folder / "homework.c", PLAIN)
    assert exit_code("grade", "--template", folder) == 2
    require_refusal(capfd, "is there: it is left as it is")
    assert (folder / "homework.c").read_text() == PLAIN


REFUSED = {
    "nothing": ([], "HOMEWORK is missing"),
    "no file": (["none.c"], "'none.c' cannot be read"),
    "an empty folder": (["."], "holds no homework"),
    "a table of one": (["homework.c", "-o", "grades.csv"], "-o needs a folder"),
    "a folder without a table": (["all"], "needs -o TABLE.csv, or --json"),
    "another ending": (["all", "-o", "grades.txt"], "must end in .csv"),
    "a foreign table": (["all", "-o", "mine.csv"], "no table of grades"),
    "a template of one": (["homework.c", "--template"], "--template goes alone"),
    "no homework": (["huge.c"], "it has more than 1048576 bytes"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_input_is_one_line(
    case: str, tmp_path: Path, capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments, complaint = REFUSED[case]
    monkeypatch.chdir(tmp_path)
    if case != "an empty folder":
        homework(tmp_path / "all" / "homework.c", PLAIN)
        homework(tmp_path / "huge.c", " " * (2**20 + 1))
        (tmp_path / "mine.csv").write_text("a,b\n1,2\n")
    assert exit_code("grade", *arguments) == 2
    require_refusal(capfd, complaint)
    assert not (tmp_path / "grades.csv").exists()
