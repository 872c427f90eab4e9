"""What a sweep refuses to continue, and what another process does between two looks into its folder."""

import os
import re
import shutil
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from command import require_refusal
from sweeps import SMALL, batch, begin, results, write

from warpgrains.base.errors import OutputError
from warpgrains.sweep import sweep_folder
from warpgrains.sweep.execution import ExecutionOptions, RunSettings
from warpgrains.sweep.runner import finish_runs
from warpgrains.sweep.sweep_folder import SweepFolder


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
        ("done", ("[5, 15]", "[5, 14]"), "--resume", "out' holds a sweep with other scenes or axes: give"),
        (
            "done",
            ("= 30", "= 31"),
            "--resume",
            "annulus.toml' is of a sweep with another scene or [set]: choose",
        ),
        (
            "done",
            (),
            "--resume --measure stress --until rest",
            "out' holds a sweep without --measure and without --until: give",
        ),
        ("done", (), "--resume --usd", "out' holds a sweep without --fps: give"),
        ("recorded", (), "--resume --usd --fps 12", "out' holds a sweep with --fps 24.0: give"),
        ("recorded", (), "--resume", "out' holds a sweep with --fps 24.0: give"),
        (
            "done",
            ("physics.drag =", "contact.friction ="),
            "--resume",
            "out' holds a sweep with other scenes or axes: give",
        ),
    ],
)
def test_output_of_another_sweep(tmp_path, request, capfd, output, change, options, complaint):
    finished, out = request.getfixturevalue(output), tmp_path / "out"
    shutil.copytree(finished, out)
    if output == "kept":
        shutil.rmtree(out / "parts")
        (out / "results.csv").unlink()
    before = {path: path.read_bytes() for path in out.rglob("*.*")}
    capfd.readouterr()
    assert batch(write(tmp_path, SMALL.replace(*change or ("", ""))), "-o", out, *options.split()) == 2
    require_refusal(capfd, complaint)
    assert {path: path.read_bytes() for path in out.rglob("*.*")} == before


@pytest.mark.parametrize(
    ("found", "instead", "complaint"),
    [
        (".*", "", "settings.json' does not hold the settings of a sweep: restore"),
        (".*", '{"measure": []}', "settings.json' does not hold"),
        (".*", "7", "settings.json' does not hold"),
        (".*", "[" * 100_000, "settings.json' does not hold"),
        ("axes", "axis", "settings.json' does not hold"),
        ("null", "[2]", "holds a sweep with --until 2: give"),
    ],
)
def test_damaged_settings(tmp_path, capfd, done, found, instead, complaint):
    settings = tmp_path / "out" / "settings.json"
    shutil.copytree(done, settings.parent)
    settings.write_text(re.sub(found, instead, settings.read_text(), count=1))
    assert batch(write(tmp_path), "-o", settings.parent, "--resume") == 2
    require_refusal(capfd, complaint)


def test_results_without_settings(tmp_path, capfd, done):
    """Settings that are a pipe, then none next to any file of a sweep, then none at all."""
    out = tmp_path / "out"
    shutil.copytree(done, out)
    (out / "settings.json").unlink()
    os.mkfifo(out / "settings.json")
    capfd.readouterr()
    for name in ("settings.json", "results.csv", "scenes/annulus.toml", *out.glob("parts/[0-9]*.csv")):
        assert batch(write(tmp_path), "-o", out, "--resume") == 2
        is_piped = name == "settings.json"
        require_refusal(
            capfd, f"{name}' is not a regular file" if is_piped else f"overwrite '{out / name}': '"
        )
        (out / name).unlink()
    assert batch(write(tmp_path), "-o", out, "--resume") == 1
    assert results(out) == results(done)


def test_settings_that_another_process_has_just_written(tmp_path, done, meanwhile):
    """Who finds its scenes finds its settings, too."""
    out = tmp_path / "out"
    meanwhile(
        Path,
        "exists",
        lambda: shutil.copytree(done, out, dirs_exist_ok=True),
        when=lambda path: path.parent == out,
    )
    assert batch(write(tmp_path), "-o", out, "--resume") == 1
    assert results(out) == results(done)


@pytest.mark.parametrize(
    ("changes", "options", "complaint"),
    [
        (("= 30", "= 31"), (), "annulus.toml' is of a sweep with another scene or [set]: choose another -o"),
        ((), ("--measure", "rattlers"), "holds a sweep with --measure rattlers: give"),
    ],
)
def test_another_sweep_that_begins_at_once(tmp_path, meanwhile, capfd, changes, options, complaint):
    """The files of the first that writes them are those of the sweep, though both find no folder."""
    (tmp_path / "other").mkdir()
    out, other = tmp_path / "out", write(tmp_path / "other", SMALL.replace(*changes or ("", "")))

    def begin_other():
        assert batch(other, "-o", out, *options) == 1
        capfd.readouterr()

    meanwhile(SweepFolder, "write_common_files", begin_other, before=True)
    assert batch(write(tmp_path), "-o", out) == 2
    require_refusal(capfd, complaint)
    assert batch(other, "-o", tmp_path / "alone", *options) == 1
    assert results(out) == results(tmp_path / "alone")


def test_sweeps_that_go_on_in_different_ways_are_refused(tmp_path):
    """They have the runs of a shorter one, so that only the results of the others differ."""
    text = 'scene = "annulus"\n[set]\ntime.duration = 0.1\n[axes]\nphysics.drag = [0.1'
    texts = [f"{text}{more}]" for more in ("", ", 0.2", ", 0.3")]
    _, first, second = (begin(tmp_path / str(k), text, tmp_path / "out") for k, text in enumerate(texts))
    assert finish_runs(first[0], first[1].runs, ExecutionOptions(), lambda _: None) == {}
    with pytest.raises(OutputError, match=r"run 1 in .* belongs to another sweep"):
        finish_runs(second[0], second[1].runs, ExecutionOptions(), lambda _: None)
    with pytest.raises(OutputError, match=r"run 1 in .* belongs to another sweep"):
        SweepFolder(tmp_path / "out", second[1].axes, RunSettings()).write_tables(second[1])


@pytest.mark.parametrize("before", [True, False])
def test_damaged_part_that_another_process_renames(tmp_path, done, meanwhile, before):
    """Just before it is read, or after."""
    out = tmp_path / "out"
    shutil.copytree(done, out)
    (part,) = out.glob("parts/[0-9]*.csv")
    part.write_bytes(b"1")
    (out / "results.csv").unlink()
    rename = partial(part.rename, part.with_name(f"{part.name}.damaged"))
    meanwhile(Path, "read_bytes", rename, before, when=part.__eq__)
    assert batch(write(tmp_path), "-o", out, "--resume") == 1
    assert results(out) == results(done)


def test_late_results_are_not_lost(tmp_path, done, meanwhile):
    """Runs that finish while the tables are written: who writes last has them all."""
    out = tmp_path / "out"
    shutil.copytree(done, out)
    (shard,) = out.glob("parts/[0-9]*.csv")
    late = shard.rename(tmp_path / "late.csv")
    meanwhile(sweep_folder, "write_atomically", partial(late.rename, shard))
    assert batch(write(tmp_path), "-o", out, "--resume", "--index", 0, "--count", 6) == 0
    assert results(out) == results(done)


def test_warp_is_not_started_if_no_run_is_left(tmp_path, done):
    script = (
        "import sys\n"
        "from warpgrains.cli.main import main\n"
        "assert main(sys.argv[1:]) == 0\n"
        "assert 'warp' not in sys.modules\n"
    )
    arguments = ["batch", write(tmp_path), "-o", done, "--resume", "--index", "0", "--count", "6"]
    subprocess.run([sys.executable, "-c", script, *arguments], check=True, timeout=60)
