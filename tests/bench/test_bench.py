"""The benchmarks run, and write what their table reads. No time is asserted."""

import ast
import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp
from bench.features import FEATURES
from bench.mutations import mutants

ROOT = Path(__file__).parents[2]
KEPT_KERNELS = """
from contextlib import nullcontext
from tests.bench import step
step.TemporaryDirectory = lambda: nullcontext({!r})
"""
SMALL = ["--repeats", 1, "--largest", 20]
BENCHES = (  # module, options, rows
    ("step", [*SMALL, "--only", "sweeps", "steps", "course"], 2 + 4 + 1),
    ("step", [*SMALL, "--only", "threads", "busy", "start"], 3 * 3 + 3 * 4 + 1),
    ("step", [*SMALL, "--only", "moving"], 4),
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
@pytest.mark.parametrize(("module", "options", "count"), BENCHES)
def test_a_bench_writes_its_rows(module: str, options: list[object], count: int, tmp_path: Path) -> None:
    file = tmp_path / "rows.csv"
    wp.init()
    change = KEPT_KERNELS.format(os.path.dirname(wp.config.kernel_cache_dir)) if module == "step" else ""
    command(module, *options, "--cache", tmp_path, "-o", file, change=change)
    rows = list(csv.DictReader(file.open()))
    assert len(rows) == count
    assert all(row.get("unit") != "steps not there" or row["median"] == "0" for row in rows)
    if module != "features":
        table = command("rows", file).splitlines()
        assert len(table) == 2 + count
        assert len({text.count("|") for text in table}) == 1


@pytest.mark.parametrize("module", ["peers", "growth"])
def test_a_folder_without_box2d_is_refused(tmp_path: Path, module: str) -> None:
    file = tmp_path / "peers.csv"
    line = [sys.executable, "-m", f"tests.bench.{module}", "--box2d3", str(tmp_path), "-o", str(file)]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True)
    told = f"--box2d3: {tmp_path} holds no source of Box2D 3.1 or newer (src/physics_world.c)"
    assert done.returncode == 2
    assert done.stderr.endswith(f"error: {told}\n")
    assert not file.exists()


@pytest.mark.slow
def test_benchmark_of_peers(tmp_path: Path) -> None:
    file, picture = tmp_path / "peers.csv", tmp_path / "peers.png"
    command("peers", "--grains", 12, "-o", file, "--picture", picture)
    rows = list(csv.DictReader(file.open()))
    ours = {row["setting"]: float(row["overlap of pairs"]) for row in rows if row["program"] == "warpgrains"}
    assert len(ours) == 21
    assert 0.0 < ours["dt 0.01, to 0.0001 m/s"] < ours["dt 0.01, to 0.1 m/s"]
    assert picture.stat().st_size > 10_000


@pytest.mark.slow
def test_benchmark_of_growth(tmp_path: Path) -> None:
    file, picture = tmp_path / "growth.csv", tmp_path / "growth.png"
    arguments = ["--grains", 12, 20, "--cache", tmp_path, "-o", file, "--picture", picture]
    command("growth", *arguments, change="growth.SHORTEST = 0.0")
    rows = [row for row in csv.DictReader(file.open()) if row["program"] == "warpgrains"]
    assert [row["n"] for row in rows] == ["12", "20"]
    assert all(float(row["overlap of pairs"]) <= 1e-2 for row in rows)
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
