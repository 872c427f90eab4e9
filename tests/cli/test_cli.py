"""The command line: exit codes, one line for bad input, clean JSON, nothing half-written."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from command import exit_code
from pxr import Usd

from warpgrains import Simulation, SimulationError

GRAINS = """
domain = {radius_in = 0.5, radius_out = 1.0}
time = {dt = 0.01, duration = 0.1}
[grains]
position = [[0.7, 0.0], [0.0, 0.7]]
radius = 0.1
mass = 0.1
"""


def python(*arguments, **options):
    """Run Python in a process of its own, where it owns the standard streams."""
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, **options)


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
    printed = python("-c", script, check=True).stdout
    assert "--set SECTION.KEY=VALUE" in printed
    assert printed.endswith("set()\n")


@pytest.mark.parametrize("error", [SimulationError("step 3: grain 1 is lost"), OSError("disk full")])
def test_failed_run_says_why_and_leaves_nothing(scene, tmp_path, capfd, monkeypatch, error):
    def fail(self, *arguments):
        raise error

    monkeypatch.setattr(Simulation, "advance", fail)
    assert exit_code("run", scene, "-o", tmp_path / "out.usdc") == 1
    printed, complaint = capfd.readouterr()
    assert (printed, complaint.splitlines()[-1]) == ("", f"warpgrains: error: {error}")
    assert list(tmp_path.iterdir()) == [scene]


def test_summary_is_aligned_lines_or_all_there_is_on_stdout(scene, tmp_path, capfd):
    output = tmp_path / "out.usdc"
    command = ("run", scene, "-o", output, "--set", "grains.position=[[0.7, 0.0], [0.8, 0.0]]")
    assert exit_code(*command) == 0
    summary = {line[:17].strip(): line[18:] for line in capfd.readouterr().out.splitlines()}
    assert summary["scene"] == "mine, 2 grains"
    assert summary["steps"] == "10"
    assert summary["not converged"] == "0 steps"
    assert summary["overlaps at start"] == "1 between grains, 0 with a wall, up to 1.00e-01 m"
    assert summary["output"] == f"{output}, 3 frames, 24 a second"
    rows = "scene, steps, iterations, not converged, worst residual, worst overlap, overlaps at start"
    assert ", ".join(summary) == f"{rows}, time, output"
    assert exit_code(*command, "--json") == 0
    printed = capfd.readouterr().out
    assert printed.count("\n") == 1
    summary = json.loads(printed)
    found = [summary[name] for name in ("scene", "grains", "steps", "unconverged", "output")]
    assert found == ["mine", 2, 10, 0, str(output)]
    overlaps = summary["overlaps_at_start"]
    assert overlaps == {"pairs": 1, "walls": 0, "largest": pytest.approx(0.1, rel=4 * np.finfo(float).eps)}
    assert summary["iterations_max"] >= summary["iterations_mean"] > 0


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
        ("out.gif", 60, "fps 60 cannot be met: a file of this kind has at most 50"),
        ("out.usdc", 60, ""),
    ],
)
def test_a_rate_that_cannot_be_met_is_said(scene, tmp_path, capfd, name, fps, said):
    assert exit_code("run", scene, "-o", tmp_path / name, "--fps", fps) == 0
    assert capfd.readouterr().err == (said and f"warpgrains: warning: {said}\n")


@pytest.mark.parametrize(
    ("asked", "form"),
    [
        ("", "Points"),
        ("--draw-as points", "Points"),
        ("--draw-as discs", "PointInstancer"),
        ("--draw-as spheres --forces --color-by speed", "PointInstancer"),
    ],
)
def test_form_of_the_grains(scene, tmp_path, asked, form):
    assert exit_code("run", scene, "-o", tmp_path / "out.usda", *asked.split()) == 0
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert stage.GetPrimAtPath("/World/Grains").GetTypeName() == form
    assert bool(stage.GetPrimAtPath("/World/Forces")) == ("--forces" in asked)
    assert len(list(stage.Traverse())) == 12 + ("--forces" in asked)


def test_check_passes_a_recording_and_names_what_is_wrong(scene, tmp_path, capfd):
    output = tmp_path / "out.usda"
    assert exit_code("run", scene, "-o", output) == 0
    whole, whole_says = output.read_text(), f"{output}: OK: 3 frames, 2 grains\n"
    for ids, code, said in (("[0, 1]", 0, whole_says), ("[1, 1]", 1, "ids")):
        output.write_text(whole.replace("ids = [0, 1]", f"ids = {ids}"))
        capfd.readouterr()
        assert exit_code("check", output) == code
        assert said in capfd.readouterr().out


@pytest.mark.slow
def test_first_run_says_that_it_compiles_and_stdout_stays_clean(scene, tmp_path):
    environment = {**os.environ, "WARP_CACHE_PATH": str(tmp_path / "kernels")}
    command = ("-m", "warpgrains", "run", scene, "--json")
    first, second = (python(*command, env=environment, timeout=300) for _ in range(2))
    assert "compiling" in first.stderr
    assert "compiling" not in second.stderr
    assert json.loads(first.stdout)["steps"] == json.loads(second.stdout)["steps"] == 10


def test_what_a_library_prints_from_c_goes_to_stderr():
    script = (
        "import ctypes\nfrom warpgrains.base.console import stdout_to_stderr\n"
        "with stdout_to_stderr():\n"
        "    print('python'); ctypes.CDLL(None).printf(b'c\\n')\n"
        "print('result')"
    )
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    done = python("-c", script, env=buffered, check=True)
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
    done = python("-c", script, "run", scene, "-o", tmp_path / "out.usdc")
    assert (done.returncode, done.stderr) == (130, "warpgrains: error: interrupted\n")
