"""The benchmarks run, and write what their table reads. No time is asserted."""

import ast
import csv
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import time_and_overlap
import warp as wp
from bench.__main__ import BENCHES, Bench, main
from bench.features import FEATURES
from bench.mutations import mutants
from bench.rows import STAMP

ROOT = Path(__file__).parents[2]
KEPT_KERNELS = """
from contextlib import nullcontext
from tests.bench import step
step.TemporaryDirectory = lambda: nullcontext({!r})
"""
SMALL = ["--repeats", 1, "--largest", 20]
PARTS = (  # module, options, rows
    ("step", [*SMALL, "--only", "sweeps", "steps", "course"], 2 + 4 + 1),
    ("step", [*SMALL, "--only", "threads", "start"], 2 * 2 * 4 + 1),
    ("batch", ["--scenes", 2, "--repeats", 1], 5),
    ("features", SMALL, 3 * len(FEATURES)),
    ("gpu", [*SMALL, "--device", "cpu"], 2),
    ("exact", ["--only", "shipped", "--steps", 2], 12),
)


def command(module: str, *arguments: object, change: str = "") -> str:
    """Run a module of the benchmark, after a change by a line of Python, and return what it prints."""
    script = f"from tests.bench import {module}\n{change}\n{module}.main()"
    line = [sys.executable, "-c", script, *map(str, arguments)]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the benchmark binds processes to cores")
@pytest.mark.parametrize(("module", "options", "count"), PARTS)
def test_a_bench_writes_its_rows(module: str, options: list[object], count: int, tmp_path: Path) -> None:
    file = tmp_path / "rows.csv"
    wp.init()
    change = KEPT_KERNELS.format(os.path.dirname(wp.config.kernel_cache_dir)) if module == "step" else ""
    command(module, *options, "--cache", tmp_path, "-o", file, change=change)
    rows = list(csv.DictReader(file.open()))
    assert len(rows) == count
    assert all(row.get("unit") != "steps not there" or row["median"] == "0" for row in rows)


def test_one_command_writes_files_that_name_their_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setitem(BENCHES, "moving", Bench("step", "--only moving --largest 20", "", ""))
    main(["moving", "-o", str(tmp_path), "--repeats", "1"])
    rows = list(csv.DictReader((tmp_path / "moving.csv").open()))
    assert len(rows) == 4
    assert all(row[key] for row in rows for key in STAMP if key != "commit")  # a source distribution has none
    file = tmp_path / "peers.csv"
    file.write_text("kept")
    with pytest.raises(SystemExit, match="failed: peers"):  # no source of Box2D is in that folder
        main(["peers", "-o", str(tmp_path), "--box2d3", str(tmp_path)])
    assert file.read_text() == "kept"


def test_no_figure_is_of_code_before_the_last_version() -> None:
    versions = re.findall(r"^## (\d\S*)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    for name in BENCHES:
        rows = csv.DictReader((ROOT / f"tests/bench/results/{name}.csv").open())
        assert {row["version"] for row in rows} <= set(versions[:2]), name


def test_a_folder_without_box2d_is_refused(tmp_path: Path) -> None:
    line = [sys.executable, "-m", "tests.bench.peers", "--box2d3", str(tmp_path)]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True)
    told = f"--box2d3: {tmp_path} holds no source of Box2D 3.1 or newer (src/physics_world.c)"
    assert done.returncode == 2
    assert done.stderr.endswith(f"error: {told}\n")


def test_benchmark_of_peers(tmp_path: Path) -> None:
    file, picture = tmp_path / "peers.csv", tmp_path / "peers.png"
    command("peers", "--grains", 12, "--friction", 0.5, "--only", "warpgrains, accelerated", "-o", file)
    rows = list(csv.DictReader(file.open()))
    ours = {row["setting"]: float(row["overlap of pairs"]) for row in rows}
    assert len(ours) == 10
    assert 0.0 < ours["dt 0.01, to 0.0001 m/s"] < ours["dt 0.01, to 0.1 m/s"]
    time_and_overlap.main(["--csv", str(file), "-o", str(picture)])
    assert picture.stat().st_size > 10_000


def test_mutants_are_changes_of_the_kernels_as_they_are() -> None:
    for mutant in mutants():
        assert mutant.source.count(mutant.old) == 1, mutant
        assert mutant.old != mutant.new
        assert mutant.effect in ("result", "speed", "nothing")
        assert bool(mutant.reason) == (mutant.effect != "result")
        ast.parse(mutant.source.replace(mutant.old, mutant.new))


def test_a_mutant_is_detected(tmp_path: Path) -> None:
    file = tmp_path / "mutations.csv"
    test = "tests/kernels/test_verlet.py::test_sample"
    command("mutations", "--only", "verlet", "--most", 1, "--tests", test, "-o", file)
    as_it_is, mutant = csv.DictReader(file.open())
    assert as_it_is["detected by"] == "none"
    assert mutant["detected by"] == f"{test}[0.0-6.5]"
    assert (mutant["file"], mutant["effect"]) == ("verlet", "result")
