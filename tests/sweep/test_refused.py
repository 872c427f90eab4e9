"""What a sweep refuses: axes, sweep files, command lines, and outputs of other sweeps. Each is one line."""

import os
import shutil
import signal
import sys
from pathlib import Path

import pytest
from command import require_refusal
from sweeps import SMALL, batch, results, write


def test_slurm_leaves_interrupts_as_they_are(tmp_path, monkeypatch):
    """dask_jobqueue sets a handler where it is imported: Ctrl-C would then end in exit code 0."""
    for name in [name for name in sys.modules if name.startswith("dask_jobqueue")]:
        monkeypatch.delitem(sys.modules, name)
    before = signal.getsignal(signal.SIGINT)
    assert batch(write(tmp_path), "-o", tmp_path / "out", "--slurm", "1") == 2
    assert "dask_jobqueue.runner" in sys.modules
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize(
    ("output", "change", "options", "complaint"),
    [
        ("done", (), "", "use --resume to continue the sweep"),
        ("kept", (), "", "use --resume to continue the sweep"),
        ("done", ("[5, 15]", "[5, 14]"), "--resume", "settings.json' is of a sweep with other runs: choose"),
        ("done", ("= 30", "= 31"), "--resume", "annulus.toml' is of a sweep with another scene: choose"),
        ("done", (), "--resume --measure stress --until rest", "with --measure none and --until none: "),
        ("done", ("physics.drag =", "contact.friction ="), "--resume", "of a sweep with other runs: choose"),
    ],
)
def test_output_of_another_sweep(tmp_path, request, capfd, output, change, options, complaint):
    finished = request.getfixturevalue(output)
    capfd.readouterr()
    shutil.copytree(finished, tmp_path / "out")
    sweep = write(tmp_path, SMALL.replace(*change) if change else SMALL)
    assert batch(sweep, "-o", tmp_path / "out", *options.split()) == 2
    require_refusal(capfd, complaint)
    assert results(tmp_path / "out") == results(finished)


def keep_only(folder, name):
    """Delete the other files and folders."""
    (folder / name).rename(folder.with_name(name))
    shutil.rmtree(folder)
    folder.mkdir()
    folder.with_name(name).rename(folder / name)


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda file: file.write_text(""), "settings.json' does not hold the settings of a sweep: restore"),
        (lambda file: file.write_text('{"measure": []}'), "settings.json' does not hold"),
        (lambda file: file.write_text("[]"), "settings.json' does not hold"),
        (
            lambda file: file.write_text(file.read_text().replace("axes", "axis")),
            "does not hold the settings",
        ),
        (lambda file: file.write_text("[" * 100_000), "settings.json' does not hold"),
        (lambda file: file.write_bytes(b"\xff"), "settings.json' does not hold"),
        (lambda file: file.write_text(file.read_text().replace("null", "[2]", 1)), "with --until 2: choose"),
        (lambda file: file.unlink(), "results.csv': '"),
        (lambda file: (file.unlink(), file.with_name("results.csv").unlink()), "scenes/annulus.toml': '"),
        (lambda file: keep_only(file.parent, "parts"), ".csv': '"),
        (lambda file: (file.unlink(), os.mkfifo(file)), "settings.json' is not a regular file"),
    ],
)
def test_output_with_damaged_settings(tmp_path, capfd, done, damage, complaint):
    out = tmp_path / "out"
    shutil.copytree(done, out)
    damage(out / "settings.json")
    capfd.readouterr()
    assert batch(write(tmp_path), "-o", out, "--resume") == 2
    require_refusal(capfd, complaint)
    (out / "settings.json").unlink(missing_ok=True)
    shutil.copy(done / "settings.json", out)
    assert batch(write(tmp_path), "-o", out, "--resume") == 1
    assert results(out) == results(done)


def test_common_files_are_written_though_no_run_is_left(tmp_path, kept):
    """A later resumption compares them."""
    out = tmp_path / "out"
    shutil.copytree(kept, out)
    keep_only(out, "runs")
    for _ in range(2):
        assert batch(write(tmp_path), "-o", out, "--resume") == 1
        assert results(out) == results(kept)
    for name in ("settings.json", "scenes/annulus.toml"):
        assert (out / name).read_bytes() == (kept / name).read_bytes()


def test_folders_of_other_files_are_no_results(tmp_path, done):
    for name in ("scenes/mine.toml", "parts/mine.csv"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).touch()
    assert batch(write(tmp_path), "-o", tmp_path) == 1
    assert results(tmp_path) == results(done)


def test_settings_that_another_process_has_just_written(tmp_path, done, monkeypatch):
    """Between two looks into the folder: who finds its scenes finds its settings, too."""
    out, exists, looks = tmp_path / "out", Path.exists, []

    def exists_just_before(path):
        found = exists(path)
        if path.parent == out and not looks:
            looks.append(path)
            shutil.copytree(done, out, dirs_exist_ok=True)
        return found

    monkeypatch.setattr(Path, "exists", exists_just_before)
    assert batch(write(tmp_path), "-o", out, "--resume") == 1
    assert results(out) == results(done)
