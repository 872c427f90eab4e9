"""The package as a stranger gets it: built, installed in a fresh environment, and run there."""

import os
import re
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import numpy as np
import pytest
from pages import PAGES, ROOT

import warpgrains
from warpgrains import Scene, Simulation

SHIPPED = (".py", ".toml", ".c", ".h", ".typed", "MODEL.md", "template/README.md", "LISEZMOI.md")
SCRIPT = """
import sys
import numpy as np
import warpgrains as wg

simulation = wg.Simulation(wg.Scene.load("annulus"))
simulation.advance(100)
np.savez(sys.argv[1], position=simulation.position, home=wg.__file__, version=wg.__version__)
"""


def test_the_version_is_one():
    assert f"version = {{{warpgrains.__version__}}}" in PAGES["README"].read_text()
    assert f"version: {warpgrains.__version__}\n" in (ROOT / "scenes/docs/CITATION.cff").read_text()
    assert f"## {warpgrains.__version__}\n" in (ROOT / "CHANGELOG.md").read_text()


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """An sdist, and the wheel that is made of it."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--outdir", str(folder), str(ROOT)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert "WARNING" not in done.stdout + done.stderr
    return folder


@pytest.mark.slow
def test_a_wheel_of_the_sdist_runs_in_a_fresh_environment(built, tmp_path):
    (sdist,), (wheel,) = built.glob("*.tar.gz"), built.glob("*.whl")
    ours = ("warpgrains/", "kernels/", "scenes/")
    kept = subprocess.run(["git", "ls-files", *ours], cwd=ROOT, capture_output=True, text=True, check=True)
    expected = {name for name in kept.stdout.split() if name.endswith(SHIPPED) and "/docs/" not in name}
    with tarfile.open(sdist) as archive:
        assert expected <= {name.partition("/")[2] for name in archive.getnames()}
    with zipfile.ZipFile(wheel) as archive:
        packed = {re.sub(r"^warpgrains/(?=kernels/|scenes/)", "", name) for name in archive.namelist()}
        assert expected == {name for name in packed if ".dist-info/" not in name}

    venv.create(tmp_path / "fresh", with_pip=True)
    programs = tmp_path / "fresh/bin"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def run(*words):
        done = subprocess.run(
            [programs / words[0], *words[1:]], cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    run("pip", "install", "-q", "--no-compile", str(wheel))
    assert run("warpgrains", "--version").split() == ["warpgrains", warpgrains.__version__]
    assert "annulus.usdc, 193 frames" in run("warpgrains", "run", "annulus", "-o", "annulus.usdc")
    assert "nothing is wrong" in run("warpgrains", "check", "annulus.usdc")
    assert run("warpgrains", "grade", "--template", "mine").split()[-1] == "mine/fem.h"
    run("python", "-c", SCRIPT, "end.npz")
    end = np.load(tmp_path / "end.npz")
    simulation = Simulation(Scene.load("annulus"))
    simulation.advance(100)
    assert np.array_equal(end["position"], simulation.position)
    assert Path(str(end["home"])).is_relative_to(tmp_path)
    assert end["version"] == warpgrains.__version__
