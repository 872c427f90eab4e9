"""Input from hostile or unlucky hands is one line, or the right result, and writes nothing elsewhere."""

import csv
import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command import exit_code, require_refusal
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import batch

from warpgrains import Scene
from warpgrains.base.files import csv_line, read_table
from warpgrains.scene.toml import toml_value

SCENE = """
domain = {radius_in = 0.1, radius_out = 1.0}
time = {duration = 0.02}
[grains]
file = "FILE"
radius = 0.1
mass = 0.1
"""
COMMAND = [sys.executable, "-m", "warpgrains"]


def test_message_with_bytes_that_are_no_text(capfd):
    assert exit_code("recover", "\udcff") == 2
    require_refusal(capfd, "'\\xff' does not exist")


def cpu_seconds(pid):
    """Return the CPU time that a process has used [s]."""
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


class TestStreams:
    def test_closed(self, tmp_path):
        script = "import os, sys\nfor n in range(3): os.close(n)\nos.execv(sys.argv[1], sys.argv[1:])"
        output = tmp_path / "run.usdc"
        command = [sys.executable, "-c", script, *COMMAND, "run", "annulus", "--steps", "2", "-o", output]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert output.exists()
        assert "Traceback" not in done.stderr

    def test_nobody_reads(self):
        command = subprocess.Popen([*COMMAND, "scenes"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        command.stdout.close()
        assert command.stderr.read() == b""
        assert command.wait(timeout=60) == 1

    def test_interrupted_at_any_moment(self):
        """After the 0.1 s of CPU time in which Python starts, on a busy machine as well."""
        for moment in (0.15, 0.4, 0.8):
            command = subprocess.Popen(
                [*COMMAND, "run", "pile", "--duration", "1000"], stderr=subprocess.PIPE, text=True
            )
            while cpu_seconds(command.pid) < moment:
                time.sleep(0.005)
            command.send_signal(signal.SIGINT)
            _, complaint = command.communicate(timeout=60)
            assert command.returncode in (130, -signal.SIGINT)
            assert complaint in ("", "warpgrains: error: interrupted\n")


def test_home_that_cannot_be_written():
    environment = {name: value for name, value in os.environ.items() if name != "WARP_CACHE_PATH"}
    done = subprocess.run(
        [*COMMAND, "run", "annulus"], env=environment | {"HOME": "/proc/1"}, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "set WARP_CACHE_PATH to a writable folder" in done.stderr


class TestNames:
    def test_of_scenes_and_files_of_a_sweep(self, tmp_path):
        """They go into scene files, tables and messages, and nowhere beyond."""
        names = [
            "\U0001f980",
            "line\n[physics]\ndrag = 9.0\n#",
            "=cmd()+1",
            "-1",
            'x"\\\x7f\t\u2028',
            "\U0010ffff\ue000",
        ]
        folder, short, out = tmp_path / "scenes", tmp_path / "short", tmp_path / "out"
        folder.mkdir()
        for name in names:
            assert toml_value(name).isascii()
            np.savez(folder / f"{name}.npz", position=np.array([[0.5, 0.0]]))
            text = SCENE.replace('"FILE"', toml_value(f"{name}.npz"))
            (folder / f"{name}.toml").write_text(text)
        assert batch(folder, "-o", short) == 0
        assert batch(folder, "-o", short, "--resume") == 0
        assert batch(folder, "-o", out, "--folders") == 0
        assert batch(folder, "-o", out, "--resume") == 0
        assert read_table(short / "results.csv") == read_table(out / "results.csv")
        found = [row["scene"] for row in read_table(out / "results.csv")]
        assert sorted(found) == sorted(names)
        for run, name in enumerate(found):
            assert Scene.load(short / "scenes" / f"{name}.toml").n == 1
            assert Scene.load(out / "runs" / f"{run:05}" / "scene.toml").drag == 0.0

    @settings(max_examples=100, deadline=None)
    @given(st.lists(st.text("-+=@'\",\n\r\t a9.eE_é１:/"), min_size=1))
    def test_lines_are_those_of_csv(self, cells):
        assert [*csv.reader(io.StringIO(csv_line(cells).decode(), newline=""))] == [cells]

    @pytest.mark.parametrize("name", ["../secret.csv", "{}/secret.csv", "link.csv"])
    def test_files_from_elsewhere_are_not_copied(self, tmp_path, name, capfd):
        (tmp_path / "secret.csv").write_text("x,y\n0.5,0.0\n")
        folder = tmp_path / "scenes"
        folder.mkdir()
        (folder / "link.csv").symlink_to(tmp_path / "secret.csv")
        (folder / "scene.toml").write_text(SCENE.replace("FILE", name.format(tmp_path)))
        assert batch(folder, "-o", tmp_path / "out") == 2
        require_refusal(capfd, "it must be in the folder of its scene")
        assert not list(tmp_path.rglob("*-*.csv"))
