"""Series: rows against quantities taken by hand, means against all steps, the same bytes after resuming."""

import numpy as np
import pytest
from command import exit_code, require_refusal
from moments import EPS
from sweeps import table
from walled_scenes import BUMPS, ROUGH, boxed

from warpgrains import Scene, Simulation, analysis


def rows(path):
    return [{name: float(cell) for name, cell in row.items()} for row in table(path)]


def test_rows_are_what_is_measured_by_hand(tmp_path):
    """Over two runs, which it does not change."""
    path, simulation = tmp_path / "run.csv", Simulation(Scene.load("annulus"))
    with analysis.Series("energy,coordination,stress", every=7, path=path) as series:
        for _ in range(2):
            simulation.run(steps=25, observer=series)
    other = Simulation(Scene.load("annulus"))
    for row in rows(path):
        other.run(steps=int(row["step"]) - other.steps) if row["step"] else None
        assert row["time"] == other.time
        assert {name: row[name] for name in series.names} == analysis.quantities(other, series.names)
    assert [row["step"] for row in series.rows] == [0, 7, 14, 21, 28, 35, 42, 49]
    assert rows(path) == series.rows
    other.step()
    assert np.array_equal(other.position, simulation.position)


def test_means_are_those_of_all_steps():
    simulation = Simulation(Scene.load("annulus"))
    every_step, means = analysis.Series("pile,energy", 1), analysis.Series("pile,energy", 20, mean=True)
    simulation.run(steps=35, observer=means)
    simulation.run(steps=30, observer=means)
    Simulation(Scene.load("annulus")).run(steps=65, observer=every_step)
    assert [row["step"] for row in means.rows] == [20, 40, 60]
    for row in means.rows:
        of_interval = every_step.rows[row["step"] - 19 : row["step"] + 1]
        for name in means.names:
            samples = np.array([one[name] for one in of_interval])
            # each of 20 updates rounds once
            assert row[name] == pytest.approx(samples.mean(), abs=20 * EPS * np.abs(samples).max())
    assert len(means.means) == len(means.names)  # of steps 61 to 65


MEANS = ("--measure", "stress,packing", "--mean", "--region", "y = [-2.0, 1.0]")

LID = boxed("rough lid", top={"pressure": 30.0, "mass": 1.0, "roughness": BUMPS}, **ROUGH)
SLICES = ("--measure", "height_profile:7,radial_profile:2:spin:1", "--mean")


@pytest.mark.parametrize(
    ("options", "until"), [(("--measure", "energy,stress"), 14), (MEANS, 12), (MEANS, 15), (SLICES, 12)]
)
def test_a_resumed_run_ends_with_the_same_bytes(tmp_path, capfd, options, until):
    whole, parts, kept = (tmp_path / name for name in ("whole.csv", "parts.csv", "kept.npz"))
    run = ("run", "annulus", *options, "--every", 5)
    assert exit_code(*run, "--steps", 23, "--series", whole) == 0
    assert exit_code(*run, "--steps", until, "--series", parts, "--checkpoint", kept) == 0
    # rows beyond the checkpoint, as a killed run leaves them
    last = parts.read_text().splitlines()[-1].partition(",")[2]
    parts.write_text(parts.read_text() + f"20,{last}\n")
    assert exit_code("run", "--resume", kept, "--steps", 23) == 0
    assert parts.read_bytes() == whole.read_bytes()
    assert [row["step"] for row in rows(whole)] == [*range(5 if "--mean" in options else 0, 23, 5)]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept.npz", "parts.csv", "whole.csv"]
    capfd.readouterr()
    parts.unlink()
    assert exit_code("run", "--resume", kept, "--steps", 50) == 2
    require_refusal(capfd, "lacks rows before step")


def test_a_sweep_with_means(tmp_path):
    sweep = tmp_path / "sweep.toml"
    sweep.write_text('scene = "annulus"\n[set]\ntime.duration = 0.5\n[axes]\nphysics.drag = [0.1, 0.2]\n')
    options = ("--measure", "pile", "--every", 25, "--mean")
    assert exit_code("batch", sweep, "-o", tmp_path / "out", *options) == 0
    series = analysis.Series("pile", 25, mean=True)
    Simulation(Scene.load("annulus", "physics.drag=0.2")).run(steps=50, observer=series)
    assert rows(tmp_path / "out" / "runs" / "00001" / "series.csv") == series.rows


@pytest.mark.parametrize("scene", [LID, Scene.load("annulus")], ids=["lid", "annulus"])
def test_profiles_over_a_run_are_those_by_hand(scene):
    """Below a lid that sinks, slices move. Means of what only grains have are weighted by their area."""
    series, means = (analysis.Series("height_profile:6", every, mean=every > 5) for every in (5, 60))
    for observer in (series, means):
        Simulation(scene).run(steps=60, observer=observer)
    by_hand, simulation, of_steps = [], Simulation(scene), []
    for step in range(1, 61):
        simulation.step()
        of_steps.append(analysis.height_profile(simulation, bins=6))
        by_hand += of_steps[-1:] if step % 5 == 0 else []
    assert [row["time"] for row in series.rows[1:]] == [5 * k * scene.dt for k in range(1, 13)]
    own, error = {}, {}
    average = series.average(after=5 * scene.dt, blocks=3)
    for name, (mean, of_mean) in average.items():
        own.setdefault(name.split(":")[2], []).append(mean)
        error.setdefault(name.split(":")[2], []).append(of_mean)
    assert len({one.edges[-1] for one in by_hand}) == (12 if scene is LID else 1)
    few = np.array([one.edges[1:] for one in by_hand]).reshape(3, 4, 6).mean(axis=1)
    assert error["high"] == pytest.approx(few.std(axis=0, ddof=1) / np.sqrt(3), rel=1e-12, abs=EPS)
    of_run = {name: [means.rows[0][f"height_profile:6:{name}:{k}"] for k in range(6)] for name in own}
    for found, profiles in ((own, by_hand), (of_run, of_steps)):
        share = np.array([one.packing_fraction for one in profiles])
        assert (
            scene is LID or np.isin([True, False], share.min(axis=0) == 0.0).all()
        )  # some are empty at times
        for name, field, at in (
            ("velocity_left", "velocity", (slice(None), 1)),
            ("spin", "spin", slice(None)),
            ("temperature", "temperature", slice(None)),
        ):
            values = np.nan_to_num([getattr(one, field)[at] for one in profiles])
            expected = (share * values).sum(axis=0) / share.sum(axis=0)
            assert found[name] == pytest.approx(expected, rel=1e-11, abs=1e-12, nan_ok=True), name
        stress = np.mean([one.stress for one in profiles], axis=0)
        assert found["stress_along_left"] == pytest.approx(
            stress[:, 0, 1], rel=1e-11, abs=1e-12 * np.abs(stress).max()
        )
    assert (
        analysis.quantities(simulation, "height_profile:6:high:5")["height_profile:6:high:5"]
        == series.rows[-1]["height_profile:6:high:5"]
    )
