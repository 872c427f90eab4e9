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
COLUMNS = "name,n,order,threads,median,unit,compared with,its median,ratio,ratio is,target,repeats"
QUICK = [
    "sweeps",
    "steps",
    "course",
    "solo",
    "compiling",
    "lists",
    "threads",
    "busy",
    "costs",
    "segments",
    "memory",
    "accelerated",
]


KEPT_KERNELS = """
from contextlib import nullcontext
from tests.bench import solo
solo.TemporaryDirectory = lambda: nullcontext({!r})
"""


def command(module: str, *arguments: object, change: str = "") -> str:
    """Run a module of the benchmark, after a change by a line of Python, and return what it prints."""
    script = f"from tests.bench import {module}\n{change}\n{module}.main()"
    line = [sys.executable, "-c", script, *map(str, arguments)]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the benchmark reads /proc")
@pytest.mark.parametrize(
    ("parts", "count"),
    [
        (QUICK, 44),
        pytest.param(["moving"], 10, marks=pytest.mark.slow),
    ],
)
def test_benchmark_of_a_step(parts: list[str], count: int, tmp_path: Path) -> None:
    file = tmp_path / "step.csv"
    options = ["--largest", 20, "--repeats", 1, "--cache", tmp_path, "--only", *parts, "-o", file]
    wp.init()
    command("step", *options, change=KEPT_KERNELS.format(os.path.dirname(wp.config.kernel_cache_dir)))
    head, *rows = file.read_text().splitlines()
    assert head == COLUMNS
    assert len(rows) == count
    table = command("table", file).splitlines()
    assert len(table) == 2 + len(rows)
    assert len({text.count("|") for text in table}) == 1


def test_benchmark_of_a_cluster(tmp_path: Path) -> None:
    file = tmp_path / "cluster.csv"
    command("cluster", "--runs", 3, "--duration", 0.02, "--repeats", 1, "-o", file)
    head, only = file.read_text().splitlines()
    assert head == COLUMNS
    assert only.endswith("<= 1.15,1")


def test_benchmark_of_a_batch(tmp_path: Path) -> None:
    file = tmp_path / "batch.csv"
    command("batch", "--scenes", 2, "--repeats", 1, "-o", file)
    head, *rows = file.read_text().splitlines()
    assert head == COLUMNS
    assert len(rows) == 5
    assert len(command("table", file).splitlines()) == 2 + len(rows)


def test_benchmark_of_settling(tmp_path: Path) -> None:
    file = tmp_path / "settling.csv"
    command("settling", "--steps", 2, "--every", 1, "-o", file)
    head, *rows = file.read_text().splitlines()
    assert head == COLUMNS
    assert len(rows) == 6


def test_benchmark_of_features(tmp_path: Path) -> None:
    file = tmp_path / "features.csv"
    command("features", "--largest", 20, "--repeats", 1, "--cache", tmp_path, "-o", file)
    head, *rows = file.read_text().splitlines()
    assert head == "scene,feature,with_us,without_us,ratio_min,ratio_median,ratio_max"
    assert len(rows) == 3 * len(FEATURES)


def test_benchmark_of_walls(tmp_path: Path) -> None:
    file = tmp_path / "walls.csv"
    command("walls", "--starts", 1, "--steps", 3, "-o", file)
    head, *rows = file.read_text().splitlines()
    assert head == "radii,method,scheme,tangent,round,ratio,ratio_min,ratio_max,same,same_median"
    assert len(rows) == 2 * 2 * 2


def test_benchmark_of_the_exact_method(tmp_path: Path) -> None:
    file = tmp_path / "exact.csv"
    command("exact", "--only", "shipped", "--steps", 2, "-o", file)
    head, *rows = file.read_text().splitlines()
    assert head == COLUMNS
    assert all(row.endswith("<= 0,1") for row in rows)


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
