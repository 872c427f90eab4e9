"""Tests that the benchmarks run and write the rows that the tables of pages need. No time is asserted."""

import ast
import csv
import os
import re
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import pytest
import time_and_overlap
import warp as wp

from tests.bench import mutations, peers, step
from tests.bench.__main__ import BENCHES, main, options_of, parse
from tests.bench.features import FEATURES, MEASUREMENTS
from tests.bench.rows import STAMP, publish

ROOT = Path(__file__).parents[2]
SMALL = "--repeats 1 --grains 20 --steps 2"
ROWS = {
    "step": ("", 2 + 2 + 1 + 1),
    "threads": ("", 2 * 2 * 4),
    "batch": ("--scenes 2", 5),
    "features": ("", 3 * len(FEATURES)),
    "measuring": ("", len(MEASUREMENTS)),
    "gpu": ("--scenes 1 --device cpu", 2),
    "exact": ("--grains 60", 2 + 13 + 9 * 3),
    "shear": ("--grains 100 --steps 40 --programs warpgrains", 3),
}


def read(file):
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))


def rows_of(name, folder, *options):
    """Run a bench in this process, and return its rows."""
    given = parse([name, "-o", str(folder), "--cache", str(folder), *options])
    publish(BENCHES[name].functions, options_of(BENCHES[name], given), folder / f"{name}.csv")
    return read(folder / f"{name}.csv")


@pytest.mark.parametrize("name", ROWS)
def test_a_bench_writes_its_rows(name, tmp_path, monkeypatch):
    kernels = os.path.dirname(wp.config.kernel_cache_dir)
    monkeypatch.setattr(step, "LOOP", "pass")  # no core is kept busy
    monkeypatch.setattr(step, "TemporaryDirectory", lambda: nullcontext(kernels))  # compiled already
    options, count = ROWS[name]
    rows = rows_of(name, tmp_path, *f"{SMALL} {options}".split())
    assert len(rows) == count
    assert {row["median"] for row in rows if row.get("target") == "<= 0"} <= {"0"}


def test_one_command_writes_files_that_name_their_code(tmp_path):
    file = tmp_path / "gpu.csv"
    file.write_text("kept")
    with pytest.raises(SystemExit, match="failed: gpu"):
        main(f"moving gpu -o {tmp_path} {SMALL} --device cuda:99".split())
    assert file.read_text() == "kept"
    rows = read(tmp_path / "moving.csv")
    assert len(rows) == 4
    assert all(row[key] for row in rows for key in STAMP if key != "commit")  # a source distribution has none


def test_no_figure_is_of_code_before_the_last_version():
    versions = re.findall(r"^## (\d\S*)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    for name in BENCHES:
        rows = read(ROOT / f"tests/bench/results/{name}.csv")
        assert {row["version"] for row in rows} <= set(versions[:2]), name


def test_a_folder_without_box2d_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(f"peers -o {tmp_path} --box2d3 {tmp_path}".split())
    told = f"--box2d3: {tmp_path} holds no source of Box2D 3.1 or newer (src/physics_world.c)"
    assert capsys.readouterr().err.endswith(f"error: {told}\n")


def test_a_program_that_is_none_is_refused(tmp_path):
    with pytest.raises(SystemExit, match="no program is named 'Box3D': there are warpgrains, accelerated; "):
        rows_of("peers", tmp_path, "--programs", "Box3D")


def test_benchmark_of_peers(tmp_path, monkeypatch):
    monkeypatch.setattr(peers, "FRICTIONS", [0.5])
    monkeypatch.setattr(peers, "PASSES", 1)
    chosen = "--grains", "12", "--programs", "warpgrains, accelerated"
    rows = rows_of("peers", tmp_path, *chosen)
    ours = {row["setting"]: float(row["overlap of pairs"]) for row in rows}
    assert len(ours) == 10
    assert 0.0 < ours["dt 0.01, to 0.0001 m/s"] < ours["dt 0.01, to 0.1 m/s"]
    picture = tmp_path / "peers.png"
    time_and_overlap.main(["--csv", str(tmp_path / "peers.csv"), "-o", str(picture)])
    assert picture.stat().st_size > 10_000


def test_mutants_are_changes_of_the_kernels_as_they_are():
    for mutant in mutations.mutants():
        assert mutant.source.count(mutant.old) == 1, mutant
        assert mutant.old != mutant.new
        assert mutant.effect in ("result", "speed", "nothing")
        assert bool(mutant.reason) == (mutant.effect != "result")
        ast.parse(mutant.changed)
        assert all((ROOT / mutations.test_file(name)).exists() for name in mutations.DECIDING[mutant.file])


@pytest.mark.slow
def test_a_mutant_is_detected(tmp_path, monkeypatch):
    file, test = tmp_path / "mutations.csv", "tests/kernels/test_verlet.py::test_stage"
    monkeypatch.setattr(mutations, "test_file", lambda name: test)
    monkeypatch.setattr(mutations, "mutants", partial(list, mutations.mutants()[:1]))
    with pytest.raises(SystemExit, match="0"):
        mutations.main(["--only", "verlet", "-o", str(file)])
    as_it_is, mutant = read(file)
    assert as_it_is["detected by"] == "none"
    assert mutant["detected by"].startswith(test)
    assert (mutant["file"], mutant["effect"]) == ("verlet", "result")
