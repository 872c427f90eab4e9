"""The command line: exit codes, one line for bad input, clean JSON, nothing half-written."""

import json
import os
import subprocess
import sys
from argparse import ArgumentParser
from dataclasses import dataclass

import numpy as np
import pytest
from command import exit_code

from warpgrains import Simulation, SimulationError
from warpgrains.cli import commands
from warpgrains.described import described, described_fields

GRAINS = """
domain = {radius_in = 0.5, radius_out = 1.0}
time = {dt = 0.01, duration = 0.1}
[grains]
position = [[0.7, 0.0], [0.0, 0.7]]
radius = 0.1
mass = 0.1
"""


def command(*arguments, **options):
    """Start the command in a process of its own, where it owns the standard streams."""
    return subprocess.Popen(
        [sys.executable, "-m", "warpgrains", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GRAINS)
    return path


def test_help_loads_nothing_heavy():
    script = (
        "import sys\nfrom warpgrains.cli.main import main\n"
        "try: main(['run', '--help'])\n"
        "except SystemExit: print({'warp', 'pxr', 'tqdm', 'numpy'} & sys.modules.keys())"
    )
    printed = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    ).stdout
    assert "--set SECTION.KEY=VALUE" in printed
    assert printed.endswith("set()\n")


@pytest.mark.parametrize("error", [SimulationError("step 3: grain 1 is lost"), OSError("disk full")])
def test_failed_run_says_why_and_leaves_nothing(scene, tmp_path, capfd, monkeypatch, error):
    def fail(self, *arguments):
        raise error

    monkeypatch.setattr(Simulation, "advance", fail)
    assert exit_code("run", scene, "-o", tmp_path / "out.usdc") == 1
    require_last_line(*capfd.readouterr(), f"warpgrains: error: {error}")
    assert list(tmp_path.iterdir()) == [scene]


def test_summary_is_aligned_lines(scene, tmp_path, capfd):
    output = tmp_path / "out.usdc"
    assert exit_code("run", scene, "-o", output, "--set", "grains.position=[[0.7, 0.0], [0.8, 0.0]]") == 0
    summary = {line[:17].strip(): line[18:] for line in capfd.readouterr().out.splitlines()}
    assert summary["scene"] == "mine, 2 grains"
    assert summary["steps"] == "10"
    assert summary["not converged"] == "0 steps"
    assert summary["overlaps at start"] == "1 between grains, 0 with a wall, up to 1.00e-01 m"
    assert summary["output"] == f"{output}, 3 frames, 24 a second"
    rows = "scene, steps, iterations, not converged, worst residual, worst overlap, overlaps at start"
    assert ", ".join(summary) == f"{rows}, time, output"


def test_option_without_a_default_has_the_type_of_its_field(monkeypatch):
    @dataclass
    class Options:
        limit: float | None = described("Largest speed.", default=None, needs=None, metavar="V")

    monkeypatch.setattr(commands, "RunOptions", Options)
    monkeypatch.setattr(commands, "OPTIONS", described_fields(Options))
    monkeypatch.setattr(commands, "FLAGS", {"limit": "--limit"})
    parser = ArgumentParser()
    commands.Command("", "", "", list(commands._outputs())).add_options(parser)
    assert parser.parse_args(["--limit", "0.5"]).limit == 0.5


@pytest.mark.parametrize(
    ("arguments", "steps"),
    [([], 10), (["--steps", "3"], 3), (["--duration", "0.2"], 20), (["--set", "time.dt=0.05"], 2)],
)
def test_length_of_a_run(scene, capfd, arguments, steps):
    assert exit_code("run", scene, "--json", *arguments) == 0
    assert json.loads(capfd.readouterr().out)["steps"] == steps


@pytest.mark.parametrize(
    ("name", "fps", "said"),
    [
        ("out.usdc", 200, "fps 200 cannot be met: with one frame every step of 0.01 s there are 100"),
        ("out.gif", 60, "fps 60 cannot be met: a file of this kind has at most 50"),
        ("out.usdc", 60, ""),
        ("out.usdc", None, ""),
    ],
)
def test_a_rate_that_cannot_be_met_is_said(scene, tmp_path, capfd, name, fps, said):
    asked = [] if fps is None else ["--fps", fps]
    assert exit_code("run", scene, "-o", tmp_path / name, *asked) == 0
    assert capfd.readouterr().err == (said and f"warpgrains: warning: {said}\n")


@pytest.mark.parametrize(
    ("asked", "form"),
    [
        ("", "Points"),
        ("--as points", "Points"),
        ("--as-points", "Points"),
        ("--as discs", "PointInstancer"),
        ("--as-spheres", "PointInstancer"),
        ("--as spheres --forces --color-by speed", "PointInstancer"),
    ],
)
def test_form_of_the_grains(scene, tmp_path, asked, form):
    from pxr import Usd

    assert exit_code("run", scene, "-o", tmp_path / "out.usda", *asked.split()) == 0
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert stage.GetPrimAtPath("/World/Grains").GetTypeName() == form
    assert bool(stage.GetPrimAtPath("/World/Forces")) == ("--forces" in asked)
    assert len(list(stage.Traverse())) == 12 + ("--forces" in asked)


def test_json_is_all_there_is_on_stdout(tmp_path, capfd):
    output = tmp_path / "annulus.usdc"
    assert exit_code("run", "annulus", "-o", output, "--json", "--steps", "50") == 0
    printed = capfd.readouterr().out
    assert printed.count("\n") == 1
    summary = json.loads(printed)
    found = (summary["scene"], summary["grains"], summary["steps"], summary["unconverged"])
    assert found == ("annulus", 15, 50, 0)
    assert summary["output"] == str(output)
    assert summary["overlaps_at_start"] == {"pairs": 0, "walls": 0, "largest": 0.0}
    assert summary["iterations_max"] >= summary["iterations_mean"] > 0


@pytest.mark.slow
def test_first_run_says_that_it_compiles_and_stdout_stays_clean(scene, tmp_path):
    environment = {**os.environ, "WARP_CACHE_PATH": str(tmp_path / "kernels")}
    first, second = (
        command("run", scene, "--json", env=environment).communicate(timeout=300) for _ in range(2)
    )
    assert "compiling" in first[1]
    assert "compiling" not in second[1]
    assert json.loads(first[0])["steps"] == json.loads(second[0])["steps"] == 10


def test_what_a_library_prints_from_c_goes_to_stderr():
    script = (
        "import ctypes\nfrom warpgrains.console import stdout_to_stderr\n"
        "with stdout_to_stderr():\n"
        "    print('python'); ctypes.CDLL(None).printf(b'c\\n')\n"
        "print('result')"
    )
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        [sys.executable, "-c", script], env=buffered, capture_output=True, text=True, check=True
    )
    assert done.stdout == "result\n"
    assert set(done.stderr.split()) == {"python", "c"}


def test_an_interrupt_while_usd_is_loaded_ends_the_command(scene, tmp_path):
    """USD makes a remark of it, and goes on."""
    script = (
        "import os, signal, sys\n"
        "class Interrupting:\n"
        "    def find_spec(name, *_):\n"
        "        if name == 'pxr.Pcp': os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupting)\n"
        "from warpgrains.cli.main import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    arguments = [sys.executable, "-c", script, "run", scene, "-o", tmp_path / "out.usdc"]
    done = subprocess.run(arguments, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "warpgrains: error: interrupted\n")


def test_check_passes_a_recording_and_names_what_is_wrong(scene, tmp_path, capfd):
    from pxr import Sdf

    output = tmp_path / "out.usdc"
    assert exit_code("run", scene, "-o", output) == 0
    capfd.readouterr()
    assert exit_code("check", output) == 0
    assert capfd.readouterr().out == f"{output}: OK: 3 frames, 2 grains\n"
    layer = Sdf.Layer.FindOrOpen(str(output))
    layer.GetPrimAtPath("/World/Grains").properties["ids"].default = np.array([1, 1])
    layer.Save()
    assert exit_code("check", output) == 1
    assert "ids" in capfd.readouterr().out


def require_last_line(printed, complaint, expected):
    assert printed == ""
    assert complaint.splitlines()[-1] == expected
