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


@pytest.mark.parametrize(
    ("options", "until"), [(("--measure", "energy,stress"), 14), (MEANS, 12), (MEANS, 15)]
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
    assert [row["step"] for row in rows(whole)] == [*range(5 if options is MEANS else 0, 23, 5)]
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


def test_profiles_over_a_run_are_those_by_hand():
    """Below a lid that sinks, slices move. Means of what only grains have are weighted by their area."""
    scene = boxed("rough lid", top={"pressure": 30.0, "mass": 1.0, "roughness": BUMPS}, **ROUGH)
    found = analysis.ProfileSeries("height", every=5, bins=6)
    Simulation(scene).run(steps=60, observer=found)
    by_hand, simulation = [], Simulation(scene)
    for _ in range(12):
        simulation.run(steps=5)
        by_hand.append(analysis.height_profile(simulation, bins=6))
    assert found.time[1:] == [5 * k * scene.dt for k in range(1, 13)]
    for profile, own in zip(found.profiles[1:], by_hand, strict=True):
        assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(profile, own, strict=True))
    mean, error = found.average(after=5 * scene.dt, blocks=3)
    weight = np.array([own.packing_fraction for own in by_hand])
    assert len({own.edges[-1] for own in by_hand}) == 12
    few = np.array([own.edges for own in by_hand]).reshape(3, 4, 7).mean(axis=1)
    assert error.edges == pytest.approx(few.std(axis=0, ddof=1) / np.sqrt(3), rel=1e-12, abs=EPS)
    for name in ("velocity", "spin", "temperature"):
        values = np.nan_to_num([getattr(own, name) for own in by_hand])
        share = weight if values.ndim == 2 else weight[..., np.newaxis]
        expected = (share * values).sum(axis=0) / share.sum(axis=0)
        assert getattr(mean, name) == pytest.approx(expected, rel=1e-12, abs=1e-12, nan_ok=True), name
    stress = np.mean([own.stress for own in by_hand], axis=0)
    assert mean.stress == pytest.approx(stress, rel=1e-12, abs=1e-12 * np.abs(stress).max())
    dataset = found.to_xarray()
    assert dataset["high"].values[-1, -1] == by_hand[-1].edges[-1]
    assert dataset["stress"].dims == ("time", "slice", "component", "other")
