"""Outputs of every kind: a full disk is named, links to them stay, and one process at a time writes them."""

import os
import re
import shutil
from pathlib import Path

import pytest
from command import exit_code, require_refusal, small_disk
from recordings import make_frames, record

from warpgrains import Simulation
from warpgrains.cli.grade import write_template
from warpgrains.simulation.checkpoint import read_checkpoint

OUTPUTS = [
    *(f"run annulus --steps 4 -o run{end}" for end in (".usdc", ".usdz", ".mp4", ".gif", ".webp", ".png")),
    "run annulus --steps 4 --checkpoint run.npz",
    "run annulus --steps 40 --measure stress --every 1 --series run.csv",
    "plot done.usdc -o run.png",
    "plot done.usdc -o run.mp4",
]
LOCKED = [
    *((words, words.split()[-1]) for words in OUTPUTS),
    ("export done.usdc -o run.pvd", "run.pvd"),
    ("run --resume kept.npz --steps 40", "kept.npz"),
    ("run --resume kept.npz --steps 40", "kept.usdc"),
    ("report annulus -o .", "report.md"),
    ("grade homework.c --html .", "index.html"),
]


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A folder with a run, a recording, and a homework."""
    folder = tmp_path_factory.mktemp("begun")
    Simulation("annulus").run(20, record=folder / "kept.usdc", checkpoint=folder / "kept.npz")
    record(folder / "done.usdc", make_frames(2))
    write_template(folder)
    return folder


@pytest.fixture
def here(begun, tmp_path, monkeypatch):
    """Make a copy of it the present folder, in which `there` is another."""
    here = shutil.copytree(begun, tmp_path / "here")
    (here / "there").mkdir()
    monkeypatch.chdir(here)
    return here


def linked(name, target=None):
    """Make a link to a file in the other folder, which need not be there."""
    target = Path("there", target or name)
    Path(name).symlink_to(target)
    return Path(name), target


def contents_of(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix != ".lock")
    return {path: path.read_bytes() for path in files}


@pytest.mark.parametrize("words", OUTPUTS)
def test_full_disk(here, capfd, words):
    before = contents_of(here)
    with small_disk(500):
        assert exit_code(*words.split()) == 1
    printed = capfd.readouterr()
    assert printed.out == ""
    assert re.fullmatch(r"warpgrains: error: 'run\.\w+(\.frames)?' cannot be written: .*\n", printed.err)
    assert "Broken pipe" not in printed.err
    assert contents_of(here) == before


@pytest.mark.parametrize(("words", "name"), LOCKED)
def test_second_writer_is_refused(here, held_elsewhere, capfd, words, name):
    """And changes nothing, also where it writes through a link."""
    _, locked = linked(name) if words.endswith(name) else (None, Path(name))
    before = contents_of(here)
    held_elsewhere(locked)
    assert exit_code(*words.split()) == 2
    require_refusal(capfd, f"{name}' is being written by process")
    assert contents_of(here) == before


@pytest.mark.parametrize("words", OUTPUTS)
def test_link_stays(here, words):
    """Where it leads to nothing yet, and again."""
    before = contents_of(here)
    link, target = linked(words.split()[-1])
    for _ in range(2):
        assert exit_code(*words.split()) == 0
        assert link.is_symlink()
        assert target.stat().st_size > 0
        assert contents_of(here).keys() == before.keys() | {here / link, here / target}


class TestLinks:
    def test_without_an_ending_may_lead_to_a_recording(self, here):
        link, target = linked("latest", "run.usdc")
        assert exit_code("run", "annulus", "--steps", 4, "-o", link) == 0
        assert link.is_symlink()
        assert exit_code("check", target) == 0

    def test_run_goes_on(self, here):
        links, targets = zip(*(linked(f"run{suffix}") for suffix in (".npz", ".csv", ".usdc")), strict=True)
        options = ("--checkpoint", links[0], "--measure", "stress", "--series", links[1], "-o", links[2])
        assert exit_code("run", "annulus", "--steps", 40, *options) == 0
        assert exit_code("run", "--resume", links[0], "--steps", 60) == 0
        assert all(link.is_symlink() for link in links)
        assert read_checkpoint(targets[0]).state.steps == read_checkpoint(links[0]).state.steps == 60
        assert len(targets[1].read_text().splitlines()) == 1 + 7
        assert exit_code("check", targets[2]) == 0

    def test_elsewhere_of_the_same_name_says_nothing_about_a_checkpoint(self, here):
        """Its names are relative to its folder, and not to the present one."""
        os.chdir("there")
        os.symlink("../kept.usdc", "kept.usdc")
        assert exit_code("run", "--resume", "../kept.npz", "--steps", 40) == 0
        assert read_checkpoint(here / "kept.npz").state.steps == 40

    def test_saved_state(self, here):
        link, target = linked("state.npz")
        Simulation("annulus").save(link)
        assert link.is_symlink()
        assert Simulation.load(target).steps == Simulation.load(link).steps == 0


@pytest.mark.parametrize("name", ["-%d:\udcff.mp4", "-%d:\udcff.gif", "-%d:\udcff.webp", "-%:\udcff.png"])
def test_films_and_pictures_may_have_any_name(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    assert exit_code("run", "annulus", "--steps", 2, "-o", f"./{name}") == 0
    assert [path.name for path in tmp_path.iterdir()] == [name]
