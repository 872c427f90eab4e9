"""`warpgrains grade`: verdicts, exit codes, tables and pages of a folder, and the template."""

import json
import os
import shlex
import signal
import subprocess
import sys
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from time import sleep

import pytest
from command import exit_code, require_refusal
from homeworks import PLAIN, PLAIN_WRONG, contact_that
from pages import PAGES, blocks, commands_in_words

from warpgrains.base.files import read_table
from warpgrains.grade.diagnosis import read_mistakes
from warpgrains.grade.sandbox import CONTACT, UPDATE
from warpgrains.reference.reference import DEFINES, SOURCE
from warpgrains.view import page

EXCHANGED = PLAIN_WRONG["masses exchanged in the share of a pair"]


def homework(path, text=PLAIN):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_a_wrong_one_as_the_docs_show_it_and_in_french_with_its_page(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    path = homework(Path("mine/homework.c"), EXCHANGED)
    assert exit_code("grade", path, "--seed", 7) == 1
    printed = capfd.readouterr().out
    assert (
        f"{CONTACT}  right{'         wrong' * 3}         right{'         wrong' * 2}         not run\n"
        in printed
    )
    said = (
        "\n  mistake: masses exchanged in the share of a pair\n  course text: v_i -= dv n m_j / (m_i + m_j)"
    )
    assert said in printed
    assert f"```\n{printed}```\n" in PAGES["course"].read_text()
    assert exit_code("grade", path, "--lang", "fr", "--html", "site") == 1
    printed, mistake = capfd.readouterr().out, "masses échangées dans la part d'une paire"
    assert printed.startswith(f"{path}: faux\n")
    assert f"\n  erreur : {mistake}\n  texte du cours : v_i -= dv n m_j / (m_i + m_j)" in printed
    assert mistake.replace("'", "&#x27;") in Path("site/index.html").read_text()


def test_one_that_does_not_compile(tmp_path, capfd):
    path = homework(tmp_path / "homework.c", PLAIN.replace("double zeta", "doubel zeta"))
    assert exit_code("grade", path) == 2
    printed = capfd.readouterr().out
    assert printed.startswith(f"{path}: does not compile\n\n")
    assert "homework.c:19:5: error: unknown type name" in printed


def test_strict_lets_only_the_bits_of_the_reference_pass(tmp_path, capfd):
    header = (SOURCE.parent / "grains.h").read_text()
    places = "".join(f"#define {one[2:].replace('=', ' ')}\n" for one in DEFINES)
    text = f"#define NOCREATE\n{places}{header}" + SOURCE.read_text().replace('#include "grains.h"', "")
    assert exit_code("grade", homework(tmp_path / "homework.c", text), "--strict") == 0
    assert exit_code("grade", homework(tmp_path / "homework.c"), "--strict") == 1
    assert capfd.readouterr().out.count("it differs by rounding only") == 2


def test_a_right_one_where_the_compiler_fails_behind_the_fence(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("warpgrains.grade.compiler.toolchain_paths", list)
    path = homework(tmp_path / "homework.c")
    assert exit_code("grade", path, "--json") == 0
    printed = capfd.readouterr()
    assert "warning: this system has no Landlock for the compiler" in printed.err
    verdict = json.loads(printed.out)
    assert (verdict["file"], verdict["status"], verdict["compiler"]) == (str(path), "right", "")
    assert [part["name"] for part in verdict["parts"]] == [UPDATE, CONTACT, "both together"]
    assert all(set(part["scenes"].values()) == {"right"} for part in verdict["parts"])


LONG = f'#if 0\n#include "{"a" * 400}"\n#include "{"a" * 400}.h"\n#endif\n'
CLASS = {
    "ada.c": (EXCHANGED, "wrong", "vaut"),
    "bob/<b>.c": (EXCHANGED, "wrong", "vaut"),
    "dots.c": (f'#include ".."\n{PLAIN}', "does not compile", "dots.c:1:10: "),
    "eve.c": ("=1+1\n", "does not compile", "eve.c:1:1: error:"),
    "huge.c": (" " * (2**20 + 1), "cannot be read", "it has more than 1048576 bytes"),
    "long.c": (LONG + PLAIN, "right", ""),
    "lost.c": (Path("nowhere"), "cannot be read", "No such file or directory"),
    "name\udcff.c": ("=1+1\n", "does not compile", "name\\xff.c:1:1: error:"),
    "pipe.c": (None, "cannot be read", "is not a regular file"),
    "secret.c": (
        Path("/etc/passwd"),
        "cannot be read",
        "secret.c' is a link to a file outside of the folder",
    ),
    "shared.c": (Path("long.c"), "right", ""),
    "wrong.c": (
        f'{PLAIN}void f(void) {{ __asm__("nonsense"); }}\n',
        "does not compile",
        "Error: no such instruction",
    ),
    "zoe/\x1b[31mred.c": (f"{PLAIN}int \x1b[31m;\n", "does not compile", "error: "),
}
"""Files of a class: the text, or where a link leads; the verdict; and what is said of it first."""


def test_a_class_has_a_table_and_pages(tmp_path, capfd):
    folder, output, pages = tmp_path / "all", tmp_path / "grades.csv", tmp_path / "pages"
    for name, (text, _, _) in CLASS.items():
        if isinstance(text, str):
            homework(folder / name, text)
        elif text is None:
            os.mkfifo(folder / name)
        else:
            (folder / name).symlink_to(text)
    shown = [name.replace("\udcff", "\\xff").replace("\x1b", "\\x1b") for name in CLASS]
    arguments = ("grade", folder, "-o", output, "--html", pages)
    assert exit_code(*arguments) == 2
    counts = f"homeworks {len(CLASS)} right 2 wrong 2 not compiled 5 not read 4 with warnings 0"
    assert capfd.readouterr().out.split() == f"{counts} table {output} pages {pages}".split()
    rows = read_table(output)
    assert exit_code(*arguments, "--lang", "fr") == 2
    capfd.readouterr()
    assert [row["file"] for row in rows] == shown
    for row, (_, status, _) in zip(rows, CLASS.values(), strict=True):
        assert row["status"] == status, row
        assert "\x1b" not in "".join(row.values())
    for row, (_, _, first) in zip(read_table(output), CLASS.values(), strict=True):
        assert first in row["première différence"]
    assert read_table(output)[0]["erreurs"] == "masses échangées dans la part d'une paire"
    assert (rows[0][UPDATE], rows[0][CONTACT]) == ("right", "wrong")
    index = (pages / "index.html").read_text()
    assert "masses échangées dans la part d&#x27;une paire</td><td>2</td>" in index
    assert '<a href="000_ada.c.html">ada.c</a>, <a href="001_bob__b_.c.html">bob/&lt;b&gt;.c</a>' in index
    page = (pages / "001_bob__b_.c.html").read_text()
    assert "<b>" not in page
    assert "Le grain le plus léger bouge le plus" in page
    assert page.count('<circle cx="') == 2
    assert "attendu" in page
    left = [row for row in rows if row["status"] in ("does not compile", "cannot be read")]
    for name, (_, status, _) in CLASS.items():
        if status in ("right", "wrong"):
            (folder / name).unlink()
    assert exit_code(*arguments, "--json") == 2  # own files are replaced
    for verdict, row in zip(json.loads(capfd.readouterr().out), left, strict=True):
        assert verdict["file"] == f"{folder}/{row['file']}"
        assert verdict["status"] == row["status"]
        assert verdict["problem"] == (row["first"] if row["status"] == "cannot be read" else "")
    assert len(read_table(output)) == len(left)


RUNNING = {
    "a homework": contact_that(
        "", "__attribute__((constructor)) void stay(void) { for (;;) wait_for(1.0); }\n"
    ),
    "the compiler": "#define A x x x x\n"
    + "".join(f"#define {b} {a} {a} {a} {a}\n" for a, b in pairwise("ABCDEFGHIJKLMNOP"))
    + "P\n",
}
SIGNALS = {signal.SIGTERM: 143, signal.SIGKILL: -signal.SIGKILL, signal.SIGINT: 130}
"""Signals, and the exit code of a command that receives them."""


@pytest.mark.parametrize(
    ("what", "number"),
    [
        ("a homework", signal.SIGTERM),
        ("the compiler", signal.SIGTERM),
        ("a homework", signal.SIGKILL),
        *(pytest.param(what, signal.SIGINT, marks=pytest.mark.slow) for what in RUNNING),
    ],
)
def test_a_signal_leaves_nothing_behind(tmp_path, what, number):
    """Sent once something runs. Where the command is killed, temporary files stay, and no process."""
    work = tmp_path / "work"
    work.mkdir()
    for name in "abc":
        homework(tmp_path / "all" / f"{name}.c", RUNNING[what])
    command = subprocess.Popen(
        [sys.executable, "-m", "warpgrains", "grade", str(tmp_path / "all"), "--json"],
        env={**os.environ, "TMPDIR": str(work)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    try:
        name = "child" if what == "a homework" else "cc1"
        wait_until(lambda: list(work.glob("*/homework1")) and name in programs_in(work))
        command.send_signal(number)
        out, err = command.communicate(timeout=60)
    finally:
        command.kill()
        command.wait()
    assert (command.returncode, out) == (SIGNALS[number], b"")
    assert b"Traceback" not in err
    if number == signal.SIGKILL:
        wait_until(lambda: programs_in(work) == [])
    else:
        assert programs_in(work) == list(work.iterdir()) == []


def wait_until(holds):
    for _ in range(600):
        if holds():
            return
        sleep(0.1)
    pytest.fail("it does not happen within a minute")


def programs_in(folder):
    names = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if Path(os.readlink(process / "cwd")).is_relative_to(folder):
                names.append((process / "comm").read_text().strip())
    return names


def test_points_are_shares_of_the_scenes_that_are_right(tmp_path, capfd):
    """On the terminal, in the table and on the pages; in French, too, where nothing stays English."""
    folder = tmp_path / "class"
    files = [homework(folder / "right.c"), homework(folder / "wrong.c", EXCHANGED)]
    assert exit_code("grade", files[1], "--points", "8,16", "--seed", 7) == 1
    assert (
        "\npoints 12 of 24, femGrainsUpdate 8 of 8, femGrainsContactIterate 4 of 16\n"
        in capfd.readouterr().out
    )
    words = ["--points", "8,16", "-o", tmp_path / "t.csv", "--html", tmp_path / "site", "--lang", "fr"]
    for named in ([folder], files):
        assert exit_code("grade", *named, *words) == 1
        printed = capfd.readouterr().out
        assert printed.splitlines()[:3] == [f"{'devoirs':<17} 2", f"{'juste':<17} 1", f"{'faux':<17} 1"]
        right, wrong = read_table(tmp_path / "t.csv")
        assert (right["points"], wrong["points"]) == ("24", "12")
        assert (right["statut"], wrong["statut"], wrong[CONTACT]) == ("juste", "faux", "faux")
        assert not {"status", "mistakes", "file", "warnings", "first"} & set(right)
    assert "<th>points</th>" in (tmp_path / "site/index.html").read_text()
    assert exit_code("grade", files[1], "--points", "8") == 2
    require_refusal(capfd, "--points is '8': it must be points of each function, such as 10,20")


def test_an_endless_loop_is_named_for_what_it_is(tmp_path, capfd):
    """Although its iter is right."""
    text = PLAIN.replace("    do {\n", "    while (1) {\n").replace(
        "    } while ((zeta > tol && iter <= iterMax) || iter == 1);", "    }"
    )
    assert exit_code("grade", homework(tmp_path / "homework.c", text), "--json") == 1
    update, *_ = json.loads(capfd.readouterr().out)["parts"]
    assert update["mistakes"] == ["loop never ends"]


def test_jacobi_is_told_to_look_at_velocities():
    mistakes = {mistake.name: mistake.hint.look for mistake in read_mistakes()}
    (look,) = {look for name, look in mistakes.items() if name.startswith("Jacobi")}
    assert look.startswith("Print v_i before and after each pair")


def test_commands_of_the_course_page_that_open_a_page_do(tmp_path, monkeypatch):
    """Those in its sentences and tables, too."""
    monkeypatch.chdir(tmp_path)
    homework(tmp_path / "mine/homework.c")
    shown = [line for block in blocks("course") if block.language == "bash" for line in block.lines]
    named = [line for line in [*shown, *commands_in_words("course")] if line.startswith("warpgrains view")]
    played = []
    monkeypatch.setattr(page.Page, "run", lambda own, announce: played.append(own._player.name))
    for line in named:
        assert exit_code(*shlex.split(line)[1:]) == 0
    assert len(played) == len(named) > 3
    assert sum("mine/homework.c" in name for name in played) == 2


def test_the_template(tmp_path, capfd):
    folder = tmp_path / "mine"
    assert exit_code("grade", "--template", folder) == 0
    names = {"homework.c", "fem.h", "README.md", "LISEZMOI.md"}
    assert {Path(line).name for line in capfd.readouterr().out.split()} == names
    assert {path.name for path in folder.iterdir()} == names
    assert exit_code("grade", folder / "homework.c", "--json") == 1
    verdict = json.loads(capfd.readouterr().out)
    assert verdict["compiler"].count("warning") == verdict["compiler"].count("unused")
    assert [part["mistakes"] for part in verdict["parts"]] == [["not written"], ["not written"], []]
    homework(folder / "homework.c")
    assert exit_code("grade", "--template", folder) == 2
    require_refusal(capfd, "refusing to overwrite")
    assert (folder / "homework.c").read_text() == PLAIN
