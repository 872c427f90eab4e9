"""The benchmarks run, and write what their table reads. No time is asserted."""

import ast
import csv
import os
import re
import sys
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path

import pytest
import time_and_overlap
import warp as wp

from tests.bench import batch, mutations, piles, step
from tests.bench.__main__ import BENCHES, Bench, main
from tests.bench.features import FEATURES
from tests.bench.rows import STAMP

ROOT = Path(__file__).parents[2]
SMALL = ["--repeats", 1, "--largest", 20]
PARTS = (  # module, options, rows
    ("step", [*SMALL, "--only", "sweeps", "steps", "course"], 2 + 4 + 1),
    ("step", [*SMALL, "--only", "threads", "start"], 2 * 2 * 4 + 1),
    ("batch", ["--scenes", 2, "--repeats", 1], 5),
    ("features", SMALL, 3 * len(FEATURES)),
    ("gpu", [*SMALL, "--device", "cpu"], 2),
    ("exact", ["--only", "shipped", "--steps", 2], 12),
)


def rows_of(module, file, *options):
    """Run a module of the benchmark, and return its rows."""
    import_module(f"tests.bench.{module}").main([*map(str, options), "-o", str(file)])
    with file.open() as lines:
        return list(csv.DictReader(lines))


@pytest.mark.parametrize(("module", "options", "count"), PARTS)
def test_a_bench_writes_its_rows(module, options, count, tmp_path, monkeypatch):
    kernels = os.path.dirname(wp.config.kernel_cache_dir)
    monkeypatch.setattr(step, "LOOP", "pass")  # no core is kept busy
    if "threads" in options:
        monkeypatch.setattr(piles, "ITERATIONS", 3)
        monkeypatch.setitem(step.PLAIN, "max_iterations", 3)
    monkeypatch.setattr(batch, "PILE_STEPS", 2)
    monkeypatch.setattr(step, "TemporaryDirectory", lambda: nullcontext(kernels))  # compiled already
    rows = rows_of(module, tmp_path / "rows.csv", *options, "--cache", tmp_path)
    assert len(rows) == count
    assert all(row.get("unit") != "steps not there" or row["median"] == "0" for row in rows)


def test_one_command_writes_files_that_name_their_code(tmp_path, monkeypatch):
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


def test_no_figure_is_of_code_before_the_last_version():
    versions = re.findall(r"^## (\d\S*)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    for name in BENCHES:
        rows = csv.DictReader((ROOT / f"tests/bench/results/{name}.csv").open())
        assert {row["version"] for row in rows} <= set(versions[:2]), name


def test_a_folder_without_box2d_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        rows_of("peers", tmp_path / "peers.csv", "--box2d3", tmp_path)
    told = f"--box2d3: {tmp_path} holds no source of Box2D 3.1 or newer (src/physics_world.c)"
    assert capsys.readouterr().err.endswith(f"error: {told}\n")


def test_benchmark_of_peers(tmp_path):
    file, picture = tmp_path / "peers.csv", tmp_path / "peers.png"
    chosen = "--grains", 12, "--friction", 0.5, "--only", "warpgrains, accelerated"
    ours = {row["setting"]: float(row["overlap of pairs"]) for row in rows_of("peers", file, *chosen)}
    assert len(ours) == 10
    assert 0.0 < ours["dt 0.01, to 0.0001 m/s"] < ours["dt 0.01, to 0.1 m/s"]
    time_and_overlap.main(["--csv", str(file), "-o", str(picture)])
    assert picture.stat().st_size > 10_000


def test_mutants_are_changes_of_the_kernels_as_they_are():
    for mutant in mutations.mutants():
        assert mutant.source.count(mutant.old) == 1, mutant
        assert mutant.old != mutant.new
        assert mutant.effect in ("result", "speed", "nothing")
        assert bool(mutant.reason) == (mutant.effect != "result")
        ast.parse(mutant.source.replace(mutant.old, mutant.new))


@pytest.mark.slow
def test_a_mutant_is_detected(tmp_path, monkeypatch):
    file, test = tmp_path / "mutations.csv", "tests/kernels/test_verlet.py::test_sample"
    options = ["--only", "verlet", "--most", "1", "--tests", test, "-o", str(file)]
    monkeypatch.setattr(sys, "argv", ["mutations", *options])
    with pytest.raises(SystemExit, match="0"):
        mutations.main()
    as_it_is, mutant = csv.DictReader(file.open())
    assert as_it_is["detected by"] == "none"
    assert mutant["detected by"] == test
    assert (mutant["file"], mutant["effect"]) == ("verlet", "result")
