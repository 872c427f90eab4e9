"""What README and docs show is true: blocks run in order and print what they say; what is named is there."""

import os
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest
from command import exit_code
from pages import PAGES, ROOT, Block, blocks, commands_in_words, program, sentences
from sphinx.cmd.build import main as sphinx

from warpgrains import Scene
from warpgrains.cli import main as command_line
from warpgrains.scene.fields import FIELDS, SceneChanges
from warpgrains.scene.layouts import LAYOUTS
from warpgrains.sweep.sweep import Sweep

TIMES = re.compile(r"^time +\d.*$", re.M)  # the line of a summary that tells how long it took
BY_A_SHELL = re.compile(r"[|<>$&;]|^(?!warpgrains\b)")
MOST_WORDS = 40  # of a sentence
WITH_CODE = [name for name in PAGES if any(block.is_run for block in blocks(name))]
WITH_SLOW_CODE = [name for name in WITH_CODE if any(block.is_slow for block in blocks(name))]


def run(block: Block, names: dict):
    if block.language == "python":
        exec(compile(block.text, "a block", "exec"), names)
    elif block.language == "toml":
        path = Path(re.match(r"# (\S+\.toml)\n", block.text)[1])
        path.write_text(block.text)
        (Sweep if "axes" in tomllib.loads(block.text) else Scene).load(path)
    else:
        codes = [ended(line) for line in block.lines]
        assert codes == [0] * (len(codes) - 1) + [block.exit_code]


def ended(line: str) -> int:
    """Return the exit code of a line; a plain command is done in this process, which spares its start."""
    if not BY_A_SHELL.search(line):
        return exit_code(*shlex.split(line)[1:])
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(["bash", "-c", line], env={**os.environ, "PATH": path}).returncode


@pytest.fixture
def layouts():
    """Remove the layouts that a page adds."""
    kept = dict(LAYOUTS)
    yield
    LAYOUTS.clear()
    LAYOUTS.update(kept)


@pytest.mark.usefixtures("layouts")
@pytest.mark.parametrize(
    ("name", "slow"),
    [
        *(pytest.param(name, False, id=name) for name in WITH_CODE),
        *(pytest.param(name, True, id=f"{name}-slow", marks=pytest.mark.slow) for name in WITH_SLOW_CODE),
    ],
)
def test_blocks_run(name, slow, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    Path("scenes").symlink_to(ROOT / "scenes")
    names, printed = {"__name__": name}, None
    for block in blocks(name):
        if not block.is_run or (block.is_slow and not slow):
            printed = None
        elif block.language != "text":
            capfd.readouterr()
            run(block, names)
            printed = capfd.readouterr().out
        elif printed is not None:
            assert TIMES.sub("time", printed) == TIMES.sub("time", block.text)


@pytest.mark.slow
def test_docs_build_without_a_warning(tmp_path, capfd):
    """Every link, reference and docstring of them."""
    code = sphinx(["-W", "--keep-going", "-q", "-b", "html", str(ROOT / "scenes/docs"), str(tmp_path)])
    assert code == 0, capfd.readouterr().err


@pytest.mark.parametrize("name", PAGES)
def test_commands_are_parsed(name):
    shown = [line for block in blocks(name) if block.language == "bash" for line in block.lines]
    for line in [*commands_in_words(name), *shown]:
        words = shlex.split(line.replace("$SLURM_ARRAY_TASK_ID", "7"))
        if words[0] == "sbatch":
            words = shlex.split(words[-1])
        if words[0] == "warpgrains" and len(words) > 1:
            assert command_line._parser().parse_args(words[1:]).command is not None


@pytest.mark.parametrize("name", PAGES)
def test_what_is_named_is_there(name):
    text = PAGES[name].read_text()
    for module in re.findall(r"python -m ((?:warpgrains|tests)[\w.]*)", text):
        assert find_spec(module) or find_spec(f"{module}.__main__"), module
    programs = re.findall(r"python (scenes/[\w./-]*)", text)
    for path in [*programs, *re.findall(r"`((?:tests|kernels|warpgrains|scenes)/[\w./-]*)`", text)]:
        assert (ROOT / path).exists(), path
    for link in re.findall(r"\]\((?!https?:)([^)#]+)", text):
        assert (PAGES[name].parent / link).exists(), link


@pytest.mark.parametrize("name", PAGES)
def test_no_sentence_is_long(name):
    assert [one for one in sentences(name) if len(one.split()) > MOST_WORDS] == []


def test_tables_are_those_of_the_code_and_of_the_benches():
    """`python scenes/docs/tables.py` writes them into the pages."""
    assert SceneChanges.__annotations__.keys() == FIELDS.keys()
    tables = runpy.run_path(str(ROOT / "scenes/docs/tables.py"))
    written = "".join(path.read_text() for path in PAGES.values())
    assert all(f"<!-- table: {name} -->" in written for name in tables["TABLES"])
    for path in PAGES.values():
        assert tables["with_tables"](path.read_text()) == path.read_text(), path


@pytest.mark.parametrize(
    ("name", "section"), [("benchmarks", "# Benchmarks"), ("README", "## Speed against error")]
)
def test_figures_of_speed_are_in_the_tables_of_benches(name, section):
    text = PAGES[name].read_text()
    begin = text.index(section)
    shown = text[begin:] if section.startswith("# ") else text[begin : text.index("\n## ", begin)]
    assert "<!-- table: " in shown
    rest = re.sub(r"<!-- table: .*?<!-- end of table -->", "", shown, flags=re.S)
    assert not re.search(r"^\||\d ?(?:ns|us|ms|MB|x)\b|\d times\b", rest.replace("10 ms", ""), re.M)


def test_the_developers_tour_names_what_there_is():
    """Every name in it that looks like code is a word of the source, or of its own examples."""
    places = [*ROOT.glob("warpgrains/**/*.py"), *ROOT.glob("kernels/**/*.py"), *ROOT.glob("scenes/*.toml")]
    source = "".join(path.read_text() for path in places) + program("developer")
    words = set(re.findall(r"\w+", source))
    named = re.findall(r"`([A-Za-z_][\w.]*)(?:\(\))?`", PAGES["developer"].read_text())
    named = [name for name in named if not (ROOT / name).exists()]
    assert len(named) > 50
    for name in named:
        assert {*name.split(".")} <= words, name
