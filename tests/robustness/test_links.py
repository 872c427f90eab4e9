"""Outputs that are symbolic links: what they lead to is replaced, and locked, and the links stay."""

import os

import pytest
from command import exit_code, require_refusal

from warpgrains import Simulation
from warpgrains.simulation.checkpoint import read_checkpoint


@pytest.fixture
def linked(tmp_path, monkeypatch):
    """Make a link in one folder to a file in another, which need not be there."""
    monkeypatch.chdir(tmp_path)
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()

    def link(name, target=None):
        path = here / name
        path.symlink_to(os.path.relpath(there / (target or name), here))
        return path, there / (target or name)

    return link


@pytest.mark.parametrize("name", ["run.usdc", "run.usda", "run.usdz", "run.mp4", "run.gif", "run.png"])
def test_output_of_a_run(linked, name, tmp_path):
    """Where there is nothing yet, and again."""
    link, target = linked(name)
    for _ in range(2):
        assert exit_code("run", "annulus", "--steps", 4, "-o", link) == 0
        assert link.is_symlink()
        assert target.stat().st_size > 0
        assert [path.name for path in tmp_path.rglob("*") if path.is_file() and path != link] == [name]


def test_name_without_an_ending_may_lead_to_a_recording(linked):
    link, target = linked("latest", "run.usdc")
    assert exit_code("run", "annulus", "--steps", 4, "-o", link) == 0
    assert link.is_symlink()
    assert exit_code("check", target) == 0


def test_checkpoint_and_series(linked):
    kept, target = linked("run.npz")
    series, rows = linked("run.csv")
    recording, recorded = linked("run.usdc")
    options = ("--checkpoint", kept, "--measure", "stress", "--series", series, "-o", recording)
    assert exit_code("run", "annulus", "--steps", 40, *options) == 0
    assert exit_code("run", "--resume", kept, "--steps", 60) == 0
    assert all(link.is_symlink() for link in (kept, series, recording))
    assert read_checkpoint(target).state.steps == read_checkpoint(kept).state.steps == 60
    assert len(rows.read_text().splitlines()) == 1 + 7
    assert exit_code("check", recorded) == 0


def test_a_link_elsewhere_of_the_same_name_says_nothing_about_a_checkpoint(linked):
    """Its names are relative to its folder, and not to the present one."""
    _, recorded = linked("run.usdc")
    kept = recorded.with_name("run.npz")
    assert exit_code("run", "annulus", "--steps", 40, "-o", recorded, "--checkpoint", kept) == 0
    os.symlink(recorded, "run.usdc")
    assert exit_code("run", "--resume", kept, "--steps", 60) == 0
    assert read_checkpoint(kept).state.steps == 60


def test_saved_state(linked):
    link, target = linked("state.npz")
    Simulation("annulus").save(link)
    assert link.is_symlink()
    assert Simulation.load(target).steps == Simulation.load(link).steps == 0


def test_what_is_no_recording_is_not_replaced_through_a_link(linked, capfd):
    link, target = linked("run.usdc")
    target.write_text("notes")
    assert exit_code("run", "annulus", "--steps", 1, "-o", link) == 2
    require_refusal(capfd, "not a recording of warpgrains")
    assert target.read_text() == "notes"


def test_a_link_and_its_target_have_one_lock(linked, held_elsewhere, capfd):
    link, target = linked("run.usdc")
    held_elsewhere(target)
    assert exit_code("run", "annulus", "--steps", 1, "-o", link) == 2
    require_refusal(capfd, "is being written by")


def test_pictures_of_recordings(linked, tmp_path):
    assert exit_code("run", "annulus", "--steps", 40, "-o", tmp_path / "run.usdc") == 0
    link, target = linked("run.png")
    assert exit_code("plot", tmp_path / "run.usdc", "-o", link, "--no-curves") == 0
    assert link.is_symlink()
    assert target.read_bytes().startswith(b"\x89PNG")
