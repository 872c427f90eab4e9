"""`warpgrains batch`: every run as if done alone."""

import pickle
import shutil
import warnings
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from command import dying_in_writing, exit_code
from same_bits import contents
from sweeps import SMALL, Interrupted, batch, begin, parts, results, rows, table, write

from warpgrains import Scene, Simulation, analysis
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.sweep.execution import ExecutionOptions
from warpgrains.sweep.runner import finish_runs
from warpgrains.sweep.sweep import Sweep
from warpgrains.usd.recording import Recording

FROM_FILE = """
domain = {radius_in = 0.1, radius_out = 1.0}
time = {duration = 0.1}
physics = {drag = 0.1}
[grains]
file = "a.npz"
radius = 0.1
mass = 0.1
"""


def test_one_row_a_run_and_one_part_a_group(done):
    """Fifteen grains need more than 30 iterations in some steps, five never do."""
    found, (part,) = rows(done), parts(done)
    expected = {
        "run": ["0", "1", "2", "3", "4", "5"],
        "scene": ["annulus"] * 6,
        "physics.drag": ["0.1", "0.1", "100.0", "100.0", "0.5", "0.5"],
        "grains.count": ["5", "15"] * 3,
        "grains": ["5", "15", "", "", "5", "15"],
        "iterations_max": ["2", "30", "", "", "2", "30"],
    }
    assert {name: [row[name] for row in found] for name in expected} == expected
    assert [int(row["unconverged"] or 0) > 0 for row in found] == [False, True, False, False, False, True]
    assert all("in one step, drag 100.0 kg/s would reverse grain 0" in row["error"] for row in found[2:4])
    assert part == [row | time for row, time in zip(found, table(done / "timing.csv"), strict=True)]
    files = ["parts", "results.csv", "scenes", "settings.json", "timing.csv"]
    assert sorted(path.name for path in done.iterdir()) == files


def test_files_of_a_run(done, kept):
    assert results(kept) == results(done)
    names = {run.name: sorted(file.name for file in run.iterdir()) for run in (kept / "runs").iterdir()}
    assert names == {f"{k:05}": ["checkpoint.npz", "scene.toml"] for k in (0, 1, 4, 5)}
    common = Scene.load(kept / "scenes" / "annulus.toml", ["physics.drag=0.5", "grains.count=15"])
    own = Scene.load(kept / "runs" / "00005" / "scene.toml")
    assert contents(own.replace(name=common.name, text=common.text)) == contents(common)


UNTIL = "rest,speed=0.05,time=0.35"
TO_REST = """
scene = "annulus"
set.time.duration = 4.0
[axes]
physics.drag = [0.5, 2.0]
grains.count = [1, 5, 15]
"""
OPENINGS = """
scene = "hopper"
[set]
walls.0.to = ["-0.5 $opening", -0.1]
walls.1.to = ["0.5 $opening", -0.1]
grains.count = 40
time.duration = 0.6
[axes]
opening = [0.05, 0.8]
contact.friction = [0.2, 0.4]
"""
"""Short runs share scenes with the same grains: those of another opening are other ones."""
MEASURE = ("--measure", "energy,coordination,largest_force")
MEASURED = ["contact_power", "drag_power", "coordination_number", "rattlers", "largest_force"]
ALONE = {
    "measured": (SMALL, MEASURE, MEASURED),
    "followed": (SMALL, (*MEASURE, "--every", "9", "--usd", "--fps", "50"), MEASURED),
    "to rest": (TO_REST, ("--until", UNTIL), []),
    "openings": (OPENINGS, ("--measure", "energy"), ["drag_power"]),
}


def test_means_after_a_time_are_those_of_the_series(tmp_path):
    """With standard errors from ten blocks; a run with fewer rows has failed, and says so."""
    text = SMALL.replace("time.duration = 0.4\n", "").replace("[axes]", "[axes]\ntime.duration = [0.1, 0.4]")
    sweep, out = write(tmp_path, text), tmp_path / "out"
    assert batch(sweep, "-o", out, *MEASURE, "--every", 2, "--mean", "--after", 0.1)
    errors = []
    for number, row in enumerate(rows(out)):
        if row["error"]:
            errors.append(row["error"])
            continue
        series = table(out / "runs" / f"{number:05}" / "series.csv")
        for name in MEASURED:
            values = np.array([float(own[name]) for own in series if float(own["time"]) >= 0.1])
            means = [part.mean() for part in np.array_split(values, 10)]
            near = partial(pytest.approx, rel=1e-12, nan_ok=True)  # sums of 20 numbers, in another order
            assert float(row[f"{name}:mean"]) == near(values.mean())
            assert float(row[f"{name}:error"]) == near(np.std(means, ddof=1) / np.sqrt(10), abs=1e-12)
    assert sum("blocks is 10: only" in error for error in errors) == 4


@pytest.mark.parametrize(("text", "options", "measured"), ALONE.values(), ids=ALONE)
def test_every_row_and_series_is_that_of_the_run_alone(tmp_path, capfd, text, options, measured):
    sweep, out, until = write(tmp_path, text), tmp_path / "out", UNTIL if "--until" in options else None
    assert batch(sweep, "-o", out, *options) == (text is SMALL)
    printed, found = capfd.readouterr().out, rows(out)
    for run, row in zip(Sweep.load(sweep).runs, found, strict=True):
        if row["error"]:
            continue
        (tmp_path / "scene.toml").write_text(run.text("grains"))
        simulation = Simulation(Scene.load(tmp_path / "scene.toml"))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that rest was not met
            summary = simulation.run(until=until)
        expected = {
            "grains": simulation.scene.n,
            "steps": summary.steps,
            "time": simulation.time,
            "iterations_mean": summary.iterations_mean,
            "iterations_max": summary.iterations_max,
            "unconverged": summary.unconverged,
            "worst_overlap": summary.overlap,
            **({} if until is None else {"met": summary.met}),
            **analysis.quantities(simulation, ["pile", *measured]),
        }
        for name, value in expected.items():
            assert repr(float(row[name])) == repr(float(value)), name
    if until is not None:
        assert 0 < (unmet := [row["met"] for row in found].count("0")) < len(found)
        assert f"not at rest       {unmet} runs\n" in printed
    assert len(list(out.glob("runs/*"))) == (4 if "--every" in options else 0)
    for folder in out.glob("runs/*"):
        series, recording = tmp_path / "alone.csv", tmp_path / "alone.usdc"
        others = ("--series", series, "-o", recording)
        given = [option for option in options if option != "--usd"]
        assert exit_code("run", folder / "scene.toml", *given, *others) == 0
        assert [row["step"] for row in table(series)] == ["0", "9", "18", "27", "36"]
        assert (folder / "series.csv").read_bytes() == series.read_bytes()
        frames = [Recording(path).position for path in (recording, folder / "recording.usdc")]
        assert len(frames[0]) == 21
        assert np.array_equal(*frames)


SHORT = 'scene = "annulus"\n[set]\ntime.duration = 0.1\n[axes]\n'
UNRECORDABLE = """
domain = {radius_out = 2.0}
grains = {position = [[0.1, 0.5]], radius = 0.1, mass = 0.1}
time = {dt = 1e-40, duration = 4e-39}
solver.tolerance = 1e30
"""
"""Its velocity may exceed float32 after some frames; a checkpoint must not count the missing one."""
FAILING = {
    "not finite": (f"{SHORT}grains.velocity = [[0.0, 0.0], [1e308, 0.0]]", (), "step 1, from t = 0.0 s: "),
    "not converged": (
        'scene = "annulus"\nset.solver.max_iterations = 3\naxes.solver.on_unconverged = ["report", "raise"]',
        ("--folders",),
        "step 20, from t = 0.19 s: not converged",
    ),
    "not recorded": (
        'scene = "fast.toml"\n[axes]\nphysics.gravity = [[0.0, 0.0], [0.0, -2e77]]\n',
        ("--usd", "--fps", "5e38"),
        "the velocity of a grain is ",
    ),
    "no such rest": (
        f"{SHORT}physics.gravity = [[0.0, -9.81], [0.0, 0.0]]",
        ("--until", "rest"),
        "until=rest needs time, and speed or energy, in a scene without gravity",
    ),
    "not measured": (
        f"{SHORT}contact.rolling_friction = [0.0, 0.1]".replace("[axes]", "contact.friction = 0.3\n[axes]"),
        (*MEASURE, "--every", "9"),
        "contact_power: the energy balance of a step cannot be computed with rolling_friction",
    ),
}


@pytest.mark.parametrize(("text", "options", "error"), FAILING.values(), ids=FAILING)
def test_run_that_fails_leaves_the_others(tmp_path, capfd, text, options, error):
    sweep, out = write(tmp_path, text), tmp_path / "out"
    (tmp_path / "fast.toml").write_text(UNRECORDABLE)
    assert batch(sweep, "-o", out, *options) == 1
    assert f"first run 1: {error}" in capfd.readouterr().out
    (good, bad), before = rows(out), results(out)
    assert good["error"] == ""
    assert int(good["steps"]) >= 10
    assert bad["error"].startswith(error)
    assert batch(sweep, "-o", out, *options, "--resume") == 1
    assert results(out) == before
    recordings = sorted(path.parent.name for path in out.rglob("recording.usdc*"))
    assert recordings == (["00000", "00001"] if "--usd" in options else [])
    for publication in range(4, 9) if "--usd" in options else ():
        shutil.rmtree(out)
        with suppress(Interrupted), dying_in_writing(Interrupted, publication, before=True):
            batch(sweep, "-o", out, *options)
        assert batch(sweep, "-o", out, *options, "--resume") == 1
        assert results(out) == before
    if "--folders" in options:
        last = read_checkpoint(out / "runs" / "00001" / "checkpoint.npz")  # its last good state
        assert last.statistics.steps == last.state.steps == 19
        assert last.statistics.seconds > 0.0
        assert table(out / "timing.csv")[1]["seconds"] == f"{last.statistics.seconds:.3f}"
    else:
        assert (out / "runs" / "00001").exists() == ("--usd" in options)


def test_cells_may_hold_all_grains(tmp_path):
    """More than the 131,072 characters that Python's csv reads by itself."""
    x, y = np.divmod(np.arange(3600), 60)
    places = (np.stack([x, y], axis=1) / 50.0 - 0.59 + 1e-9 / 3.0).tolist()
    assert len(str(places)) > 140_000
    fixed = "[set]\ntime.duration = 0.01\ngrains.radius = 0.005\n"
    text = f'scene = "scene.toml"\n{fixed}[axes]\ngrains.position = [{places}]\n'
    (tmp_path / "scene.toml").write_text("domain.radius_out = 1.0\ngrains.mass = 0.1\n")
    assert batch(write(tmp_path, text), "-o", tmp_path / "out") == 0
    assert [(row["error"], row["grains"]) for row in rows(tmp_path / "out")] == [("", "3600")]


def test_summary(tmp_path, capfd):
    """Without a picture where all runs fail."""
    plot = ("--plot", "x=physics.drag,y=steps")
    for drag, failed, code in (("0.1, 0.5", "0", 0), ("100.0", "2, first run 0: ", 1)):
        sweep, out = write(tmp_path, SMALL.replace("0.1, 100.0, 0.5", drag)), tmp_path / drag
        assert batch(sweep, "-o", out, *(plot if code else ())) == code
        summary = {line[:17].strip(): line[18:] for line in capfd.readouterr().out.splitlines()}
        names = ["runs", "failed", "not finished", "not converged", "time", "results"]
        assert list(summary) == names + ["picture"] * code
        assert summary["runs"] == f"{len(rows(out))}, 0 of them finished before"
        assert summary["failed"].startswith(failed)
        assert summary["not finished"] == "0"
    assert summary["picture"] == "none: no run has succeeded"


def test_grains_from_a_file(tmp_path, monkeypatch, capfd):
    """Each run reads a copy that the folder of the sweep holds, wherever that is moved, also in a worker."""
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(FROM_FILE)
    for name, position in {"a": [[0.5, 0.0]], "b": [[0.0, 0.5], [0.5, 0.0]]}.items():
        np.savez(f"{name}.npz", position=np.array(position))
    text, out = 'scene = "scene.toml"\n[axes]\ngrains.file = ["a.npz", "b.npz"]', tmp_path / "out"
    folder, sweep = begin(Path(), text, tmp_path / "there")
    of_worker = pickle.dumps((folder, sweep.runs))
    assert batch("sweep.toml", "-o", out, "--folders", "--index", 0, "--count", 2) == 0
    copies = {path: path.read_bytes() for path in (out / "grains").iterdir()}
    damaged = min(copies)
    damaged.write_bytes(b"another")
    assert batch("sweep.toml", "-o", out, "--folders", "--resume") == 2
    assert f"{damaged.name}' is damaged: delete it to have it copied" in capfd.readouterr().err
    damaged.unlink()
    assert batch("sweep.toml", "-o", out, "--folders", "--resume") == 0
    assert {path: path.read_bytes() for path in (out / "grains").iterdir()} == copies
    assert [(row["grains.file"], row["grains"]) for row in rows(out)] == [("a.npz", "1"), ("b.npz", "2")]
    out.rename("moved")
    for path in Path().glob("*.npz"):
        path.unlink()
    monkeypatch.chdir("/")
    assert Scene.load(tmp_path / "moved" / "runs" / "00001" / "scene.toml").n == 2
    assert finish_runs(*pickle.loads(of_worker), ExecutionOptions(), lambda _: None) == {}
    folder.write_tables(sweep)
    assert results(tmp_path / "there") == results(tmp_path / "moved")


def test_results_next_to_scenes_are_no_scenes(tmp_path):
    """A folder of scenes may be its own output."""
    for name in "ab":
        (tmp_path / f"{name}.toml").write_text(Scene.load("annulus", ["time.duration=0.1"]).text)
    for again in ([], ["--resume"]):
        assert batch(tmp_path, "-o", tmp_path, *again) == 0
        assert [row["scene"] for row in rows(tmp_path)] == ["a", "b"]


def test_longer_sweep_goes_on(tmp_path, done):
    """Values at the end of the first axis are runs that follow those that are there."""
    shutil.copytree(done, tmp_path / "out")
    longer = write(tmp_path, SMALL.replace("0.5]", "0.5, 0.6]"))
    assert batch(longer, "-o", tmp_path / "out", "--resume") == 1
    assert results(tmp_path / "out").startswith(results(done))
    assert len(rows(tmp_path / "out")) == 8
