"""Sweeps that several tests carry out."""

import csv
from pathlib import Path

from warpgrains import Scene
from warpgrains.batch.loaded_scenes import LoadedScenes
from warpgrains.cli.main import main
from warpgrains.sweep.execution import RunSettings
from warpgrains.sweep.group import Group
from warpgrains.sweep.sweep import Sweep
from warpgrains.sweep.sweep_folder import SweepFolder

SMALL = """
scene = "annulus"
[set]
time.duration = 0.4
solver.max_iterations = 30
[axes]
physics.drag = [0.1, 100.0, 0.5]
grains.count = [5, 15]
"""
"""Six runs of 40 steps, some not converged; the third and the fourth have too much drag to be a scene."""

LONG = """
scene = "annulus"
[set]
solver.order = "color"
[axes]
physics.drag = {range = [0.1, 0.9], count = 3}
grains.shift = {log_range = [1e-9, 1e-6], count = 4}
"""
"""Twelve runs of 800 steps."""


def write(folder: Path, text: str = SMALL) -> Path:
    path = folder / "sweep.toml"
    path.write_text(text)
    return path


def batch(*arguments: object) -> int:
    try:
        return main(["batch", *map(str, arguments)])
    except SystemExit as exit:
        return int(exit.code or 0)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as lines:
        return list(csv.DictReader(lines))


def rows(folder: Path) -> list[dict[str, str]]:
    """Read the table of results in the output of a sweep."""
    return table(folder / "results.csv")


def parts(folder: Path) -> list[list[dict[str, str]]]:
    """Read the tables of groups of runs."""
    return [table(part) for part in sorted(folder.glob("parts/[0-9]*.csv"))]


def scene_of(folder: Path, row: dict[str, str]) -> Scene:
    """Load the scene of a row of the small sweep by hand."""
    overrides = [f"{key}={row[key]}" for key in ("physics.drag", "grains.count")]
    return Scene.load(folder / "scenes" / "annulus.toml", overrides)


def begin(folder: Path, text: str, out: Path | str = "out") -> tuple[SweepFolder, Sweep]:
    """Write a sweep file and the files of its output that come before the first run."""
    folder.mkdir(exist_ok=True)
    sweep = Sweep.load(write(folder, text))
    output = SweepFolder(folder / out, sweep.axes, RunSettings())
    output.create_or_check(sweep, sweep.runs, False)
    output.write_common_files(sweep)
    return output, sweep


def results(folder: Path) -> bytes:
    """Read the table of results as it lies on disk."""
    return (folder / "results.csv").read_bytes()


class Interrupted(KeyboardInterrupt):
    """What stands for a killed process."""


class Slices:
    """Groups of runs with folders end after four steps; the one after `left` more is interrupted."""

    def __init__(self, patch):
        self.left = 1_000
        advance, advance_runs = Group.advance, LoadedScenes.advance_runs

        def advance_or_die(group, seconds, on_progress):
            if self.left == 0:
                raise Interrupted
            self.left -= 1
            self.has_folders = any(one.folder is not None for one in group.members)
            advance(group, -1.0 if self.has_folders else seconds, on_progress)

        def advance_four(loaded, runs, steps, poll):
            if not self.has_folders:
                return advance_runs(loaded, runs, steps, poll)
            return advance_runs(loaded, runs, [min(4, step) for step in steps], lambda done: None)

        patch.setattr(Group, "advance", advance_or_die)
        patch.setattr(LoadedScenes, "advance_runs", advance_four)
