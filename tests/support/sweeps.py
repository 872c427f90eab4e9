"""Sweep files that several tests run, and readers of the output of sweeps."""

import csv
from pathlib import Path

from command import exit_code

from warpgrains.batch.loaded_scenes import LoadedScenes
from warpgrains.simulation.checkpoint import read_checkpoint
from warpgrains.sweep.execution import RunSettings
from warpgrains.sweep.group import Group
from warpgrains.sweep.sweep import Sweep
from warpgrains.sweep.sweep_folder import SweepFolder
from warpgrains.sweep.sweep_run import SweepRun

SMALL = """
scene = "annulus"
[set]
time.duration = 0.4
solver.max_iterations = 30
[axes]
physics.drag = [0.1, 100.0, 0.5]
grains.count = [5, 15]
"""
"""Sweep file of six runs of 40 steps, some not converged. Runs 2 and 3 fail because of invalid drags."""

LONG = """
scene = "annulus"
[set]
solver.order = "color"
[axes]
physics.drag = {range = [0.1, 0.9], count = 3}
grains.shift = {log_range = [1e-9, 1e-6], count = 4}
"""
"""Sweep file of twelve runs of 800 steps."""


def write(folder: Path, text: str = SMALL) -> Path:
    path = folder / "sweep.toml"
    path.write_text(text)
    return path


def batch(*arguments: object) -> int:
    return exit_code("batch", *arguments)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as lines:
        return list(csv.DictReader(lines))


def rows(folder: Path) -> list[dict[str, str]]:
    """Read the table of results in the output of a sweep."""
    return table(folder / "results.csv")


def results(folder: Path) -> bytes:
    """Return the bytes of the table of results."""
    return (folder / "results.csv").read_bytes()


def parts(folder: Path) -> list[list[dict[str, str]]]:
    """Read the shards of the table of results, one for each group of runs."""
    return [table(part) for part in sorted(folder.glob("parts/[0-9]*.csv"))]


def steps_kept(folder: Path) -> int:
    """Return the sum of the numbers of steps that all checkpoints of a sweep hold."""
    return sum(read_checkpoint(path).statistics.steps for path in folder.glob("runs/*/checkpoint.npz"))


def begin(folder: Path, text: str, out: Path | str = "out") -> tuple[SweepFolder, Sweep]:
    """Write the sweep file `text`, and in the output folder `out` all files that precede the first run."""
    folder.mkdir(exist_ok=True)
    sweep = Sweep.load(write(folder, text))
    output = SweepFolder(folder / out, sweep.axes, RunSettings())
    output.create_or_check(sweep, sweep.runs, False)
    output.write_common_files(sweep)
    return output, sweep


class Interrupted(KeyboardInterrupt):
    """Exception that simulates the end of a killed process."""


class Slices:
    """Patch of sweeps, so that they end early.

    Groups of runs with folders, or if `of_all` all groups, stop after 4 steps. After `left` groups,
    `Interrupted` is raised. `patch` is pytest's `monkeypatch`.
    """

    def __init__(self, patch, of_all=False):
        self.left, self.of_all, self.is_slice = 1_000, of_all, False
        advance, steps_due = Group.advance, SweepRun.steps_due

        def advance_or_die(group, seconds, on_progress):
            if self.left == 0:
                raise Interrupted
            self.left -= 1
            self.is_slice = self.of_all or any(one.folder is not None for one in group.members)
            advance(group, -1.0 if self.is_slice else seconds, on_progress)

        def four_steps(run):
            return min(4, steps_due.fget(run)) if self.is_slice else steps_due.fget(run)

        patch.setattr(Group, "advance", advance_or_die)
        patch.setattr(LoadedScenes, "cancel", lambda loaded: None)  # a slice always does its four steps
        patch.setattr(SweepRun, "steps_due", property(four_steps))
