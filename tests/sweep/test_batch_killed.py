"""`warpgrains batch` killed by kill -9, then --resume: the same table as without."""

import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from sweeps import LONG, batch, results, table, write
from trimmed import trimmed

from warpgrains.simulation.checkpoint import read_checkpoint

DRIVER = """
import sys
from warpgrains.cli.main import main
from warpgrains.sweep import runner, short
short.SHORT, short.WIDTH, runner.FIRST_WIDTH = 0.1, 4, 4
runner.WIDTH, runner.SLICE = 4, 0.02
runner.BETWEEN_CHECKPOINTS = 0.5 if "--usd" in sys.argv else 0.05
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    assert batch(write(folder, LONG), "-o", folder / "out") == 0
    return folder / "out"


class TestKilled:
    """kill -9 in the middle, then --resume: the same table as without."""

    def kill_and_resume(self, folder, undisturbed, options, moments):
        sweep, out = write(folder, LONG), folder / "out"
        process = self.start(sweep, "-o", out, *options)
        for steps in moments:
            while process.poll() is None and self.steps_kept(out) < steps:
                time.sleep(0.02)
            process.send_signal(signal.SIGKILL)
            process.wait(timeout=60)
            process = self.start(sweep, "-o", out, "--resume", *options)
        assert process.wait(timeout=120) == 0
        assert results(out) == results(undisturbed)
        assert len(table(out / "timing.csv")) == 12
        for series in out.glob("runs/*/series.csv"):
            assert [int(row["step"]) for row in table(series)] == list(range(0, 801, 100))

    def start(self, *arguments):
        command = [sys.executable, "-c", DRIVER, "batch", *map(str, arguments)]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL)

    def steps_kept(self, out: Path) -> int:
        kept = (out / "runs").glob("*/checkpoint.npz")
        return sum(read_checkpoint(path).statistics.steps for path in kept)

    def test_resumed(self, tmp_path, undisturbed):
        self.kill_and_resume(tmp_path, undisturbed, [], [1_000, 5_000])

    @pytest.mark.slow
    def test_resumed_from_many_moments(self, tmp_path, undisturbed):
        rng = np.random.default_rng(5)
        for number in range(2):
            folder = tmp_path / str(number)
            folder.mkdir()
            moments = sorted(rng.integers(1, 12 * 800, size=rng.integers(1, 4)).tolist())
            options = (["--measure", "packing", "--every", "100"], ["--usd"])[number]
            self.kill_and_resume(folder, undisturbed, options, moments)
            shutil.rmtree(folder)


MANY = """
scene = "annulus"
[set]
time.duration = 0.05
[axes]
physics.drag = {range = [0.1, 0.9], count = 600}
"""
MANY_DRIVER = """
import sys
from warpgrains.cli.main import main
from warpgrains.sweep import runner, short
short.WIDTH, runner.FIRST_WIDTH = 32, 32
sys.exit(main(sys.argv[1:]))
"""


class TestKilledShortRuns:
    """kill -9 while parts are written: no run that is in one is done again."""

    def killed(self, folder, moments):
        sweep, out = write(folder, MANY), folder / "out"
        assert batch(sweep, "-o", folder / "undisturbed") == 0
        command = [sys.executable, "-c", MANY_DRIVER, "batch", str(sweep), "-o", str(out), "--resume"]
        for parts in moments:
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            while process.poll() is None and len(list(out.glob("parts/[0-9]*.csv"))) < parts:
                time.sleep(0.001)
            time.sleep(0.002 * (parts % 5))
            process.kill()
            process.wait(timeout=60)
        assert subprocess.run(command, stdout=subprocess.DEVNULL, timeout=120).returncode == 0
        assert results(out) == results(folder / "undisturbed")
        runs = [row["run"] for part in out.glob("parts/[0-9]*.csv") for row in table(part)]
        assert sorted(map(int, runs)) == list(range(600))

    def test_resumed(self, tmp_path):
        self.killed(tmp_path, [3])

    @pytest.mark.slow
    def test_resumed_from_twenty_moments(self, tmp_path):
        self.killed(tmp_path, range(1, 1 + trimmed(20)))
