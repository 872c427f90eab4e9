"""`warpgrains grade`: verdicts, exit codes, tables of a folder, and the template."""

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from time import sleep

import pytest
from command import exit_code, require_refusal
from hostile_homeworks import WAITS, contact_that
from pages import PAGES
from right_homeworks import PLAIN
from wrong_homeworks import CONTACT, UPDATE, WRONG, wrong

from warpgrains.files import read_table
from warpgrains.reference.reference import SOURCE


def homework(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_a_right_one(tmp_path, capfd):
    path = homework(tmp_path / "homework.c", PLAIN)
    assert exit_code("grade", path, "--json") == 0
    verdict = json.loads(capfd.readouterr().out)
    assert (verdict["file"], verdict["status"], verdict["compiler"]) == (str(path), "right", "")
    assert [part["name"] for part in verdict["parts"]] == [UPDATE, CONTACT, "both together"]
    assert all(set(part["scenes"].values()) == {"right"} for part in verdict["parts"])


def test_a_wrong_one_as_the_docs_show_it(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    path = homework(Path("mine/homework.c"), wrong(WRONG[CONTACT, "masses exchanged in the share of a pair"]))
    assert exit_code("grade", path) == 1
    printed = capfd.readouterr().out
    assert f"{CONTACT}  right{'         wrong' * 3}         right         wrong         wrong\n" in printed
    assert (
        "\n  mistake: masses exchanged in the share of a pair\n  course text: v_i -= dv n m_j / (m_i + m_j)"
        in printed
    )
    assert f"```\n{printed}```\n" in PAGES["course"].read_text()


def test_one_that_does_not_compile(tmp_path, capfd):
    path = homework(tmp_path / "homework.c", PLAIN.replace("double zeta", "doubel zeta"))
    assert exit_code("grade", path) == 2
    printed = capfd.readouterr().out
    assert printed.startswith(f"{path}: does not compile\n\n")
    assert "homework.c:19:5: error: unknown type name" in printed


def test_strict_lets_only_the_bits_of_the_reference_pass(tmp_path, capfd):
    header = (SOURCE.parent / "grains.h").read_text()
    text = f"#define NOCREATE\n{header}" + SOURCE.read_text().replace('#include "grains.h"', "")
    assert exit_code("grade", homework(tmp_path / "homework.c", text), "--strict") == 0
    assert exit_code("grade", homework(tmp_path / "homework.c", PLAIN), "--strict") == 1
    assert capfd.readouterr().out.count("it differs by rounding only") == 2


def test_a_folder(tmp_path, capfd):
    folder, output = tmp_path / "all", tmp_path / "grades.csv"
    homework(folder / "ada" / "homework.c", PLAIN)
    homework(folder / "bob" / "homework.c", wrong(WRONG[UPDATE, "drag missing"]))
    homework(folder / "eve.c", "=1+1\n")
    assert exit_code("grade", folder, "-o", output) == 2
    counts = "homeworks 3 right 1 wrong 1 not compiled 1 not read 0 with warnings 0"
    assert capfd.readouterr().out.split() == f"{counts} table {output}".split()
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


def test_pages_of_a_class(tmp_path, capfd):
    folder, output, pages = tmp_path / "all", tmp_path / "grades.csv", tmp_path / "pages"
    text = wrong(WRONG[CONTACT, "masses exchanged in the share of a pair"])
    for name in ("ada.c", "bob/<b>.c"):
        homework(folder / name, text)
    homework(folder / "eve.c", PLAIN.replace("double zeta", "doubel zeta", 1))
    arguments = (folder, "-o", output, "--html", pages, "--lang", "fr")
    for _ in range(2):  # own pages are replaced
        assert exit_code("grade", *arguments) == 2
    assert f"pages             {pages}\n" in capfd.readouterr().out
    rows = read_table(output)
    assert [row["status"] for row in rows] == ["wrong", "wrong", "does not compile"]
    assert rows[0]["mistakes"] == "masses échangées dans la part d'une paire"
    assert "vaut" in rows[0]["first"]
    assert "error: unknown type name" in rows[2]["first"]
    index = (pages / "index.html").read_text()
    assert "masses échangées dans la part d&#x27;une paire</td><td>2</td>" in index
    assert '<a href="000_ada.c.html">ada.c</a>, <a href="001_bob__b_.c.html">bob/&lt;b&gt;.c</a>' in index
    page = (pages / "001_bob__b_.c.html").read_text()
    assert "<b>" not in page
    assert "Le grain le plus léger bouge le plus" in page
    assert page.count('<circle cx="') == 2
    assert "attendu" in page


def test_one_in_french_with_its_page(tmp_path, capfd):
    path = homework(tmp_path / "homework.c", wrong(WRONG[UPDATE, "gravity missing"]))
    assert exit_code("grade", path, "--lang", "fr", "--html", tmp_path / "site") == 1
    printed = capfd.readouterr().out
    assert printed.startswith(f"{path}: faux\n")
    assert "\n  erreur : gravité oubliée\n  texte du cours : m_i dv_i/dt = m_i g - gamma v_i\n" in printed
    assert "gravité oubliée" in (tmp_path / "site" / "index.html").read_text()


def test_a_bad_file_is_a_row(tmp_path, capfd):
    folder, output = tmp_path / "all", tmp_path / "grades.csv"
    homework(folder / "ada.c", PLAIN)
    homework(folder / "dots.c", f'#include ".."\n{PLAIN}')
    homework(folder / "long.c", f'#if 0\n#include "{"a" * 400}"\n#include "{"a" * 400}.h"\n#endif\n{PLAIN}')
    homework(folder / "huge.c", " " * (2**20 + 1))
    homework(folder / "\x1b[31mred.c", f"{PLAIN}int \x1b[31m;\n")
    homework(folder / "wrong.c", f'{PLAIN}void f(void) {{ __asm__("nonsense"); }}\n')
    os.mkfifo(folder / "pipe.c")
    (folder / "lost.c").symlink_to("nowhere")
    (folder / "secret.c").symlink_to("/etc/passwd")
    (folder / "shared.c").symlink_to(folder / "ada.c")
    with open(os.fsencode(folder) + b"/name\xff.c", "w") as file:
        file.write(PLAIN)
    expected = {
        "\\x1b[31mred.c": ("does not compile", "error: "),
        "ada.c": ("right", ""),
        "dots.c": ("does not compile", "homework.c:1:10: "),
        "huge.c": ("cannot be read", "it has more than 1048576 bytes"),
        "long.c": ("right", ""),
        "lost.c": ("cannot be read", "No such file or directory"),
        "name\\xff.c": ("right", ""),
        "pipe.c": ("cannot be read", "is not a regular file"),
        "secret.c": ("cannot be read", "secret.c' is a link to a file outside of the folder"),
        "shared.c": ("right", ""),
        "wrong.c": ("does not compile", "Error: no such instruction"),
    }
    assert exit_code("grade", folder, "-o", output, "--json") == 2
    verdicts = json.loads(capfd.readouterr().out)
    rows = read_table(output)
    assert [verdict["file"] for verdict in verdicts] == [f"{folder}/{name}" for name in expected]
    assert [row["file"] for row in rows] == list(expected)
    for row, verdict, (status, first) in zip(rows, verdicts, expected.values(), strict=True):
        assert row["status"] == verdict["status"] == status, row
        assert first in row["first"]
        assert "\x1b" not in "".join(row.values())
        assert verdict["problem"] == (row["first"] if status == "cannot be read" else "")
    for source in folder.glob("*.c"):
        if source.name not in ("lost.c", "huge.c", "pipe.c", "secret.c"):
            source.unlink()
    assert exit_code("grade", folder, "-o", output) == 2
    assert "not read          4\n" in capfd.readouterr().out


def test_a_compiler_that_fails_behind_the_fence_is_used_without(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("warpgrains.grade.compiler.toolchain_paths", list)
    assert exit_code("grade", homework(tmp_path / "homework.c", PLAIN)) == 0
    assert "warning: this system has no Landlock for the compiler" in capfd.readouterr().err


RUNNING = {
    "a homework": contact_that(
        "", f"{WAITS}__attribute__((constructor)) void stay(void) {{ for (;;) wait_for(1.0); }}\n"
    ),
    "the compiler": "#define A x x x x\n"
    + "".join(f"#define {b} {a} {a} {a} {a}\n" for a, b in pairwise("ABCDEFGHIJKLMNOP"))
    + "P\n",
}


@pytest.mark.parametrize("what", RUNNING)
@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)])
def test_a_signal_leaves_nothing_behind(tmp_path, what, number):
    code, out, err = signalled(tmp_path, what, number)
    assert code == (143 if number == signal.SIGTERM else 130)
    assert out == b""
    assert b"Traceback" not in err
    assert programs_in(tmp_path / "work") == []
    assert list((tmp_path / "work").iterdir()) == []


def test_a_homework_ends_with_a_killed_command(tmp_path):
    assert signalled(tmp_path, "a homework", signal.SIGKILL)[0] == -signal.SIGKILL
    wait_until(lambda: programs_in(tmp_path / "work") == [])


def signalled(folder, what, number):
    """Send a signal to a command that grades, once something runs, and return its exit code and output."""
    work = folder / "work"
    work.mkdir()
    for name in "abc":
        homework(folder / "all" / f"{name}.c", RUNNING[what])
    command = subprocess.Popen(
        [sys.executable, "-m", "warpgrains", "grade", str(folder / "all"), "--json"],
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
    return command.returncode, out, err


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
    homework(folder / "homework.c", PLAIN)
    assert exit_code("grade", "--template", folder) == 2
    require_refusal(capfd, "refusing to overwrite")
    assert (folder / "homework.c").read_text() == PLAIN
