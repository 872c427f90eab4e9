"""The package as a stranger gets it: built, installed in a fresh environment, and run there."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from pages import PAGES, ROOT, program

import warpgrains
from warpgrains import Simulation
from warpgrains.base.errors import MissingExtraError, requiring

SHIPPED = (".py", ".toml", ".c", ".h", ".typed", "MODEL.md", "template/README.md", "LISEZMOI.md")
SCRIPT = """
import warpgrains as wg

simulation = wg.Simulation("annulus")
simulation.advance(100)
print(wg.__file__, simulation.position.tobytes().hex())
"""
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def kept(*folders):
    """Return the files of the checkout."""
    done = subprocess.run(["git", "ls-files", *folders], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_the_version_is_one():
    assert f"version = {{{warpgrains.__version__}}}" in PAGES["README"].read_text()
    assert f"version: {warpgrains.__version__}\n" in (ROOT / "scenes/docs/CITATION.cff").read_text()
    assert f"## {warpgrains.__version__}\n" in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.parametrize("extra", ["report", "data", "film", "exact", "view", "cluster"])
def test_a_missing_library_names_a_command_that_works(extra):
    """It names libraries, because no index has a package of extras."""
    with pytest.raises(MissingExtraError, match="it needs no_library: ") as missing, requiring("it", extra):
        import no_library  # noqa: F401
    command = str(missing.value).partition(": ")[2]
    assert shlex.split(command) == ["pip", "install", *PROJECT["project"]["optional-dependencies"][extra]]


TYPED = """
import warpgrains as wg
from warpgrains import analysis

simulation = wg.Simulation("annulus")
steps: int = simulation.run(steps=1).steps
series: analysis.Series = analysis.Series("stress")
text: str = simulation.steps  # wrong
scene = wg.Scene(position=[[0.0, 1.0]], radius=0.1, mass=1, gravity=[0.0, -1.0], radius_out=2.0)
shape: tuple[int, ...] = scene.position.shape
vertical: float = scene.gravity[1]
scene.replace(drag=0.1, velocity=[[0.0, 1.0]], walls=[]).drag = 0.5  # wrong
scene.replace(drga=0.1)  # wrong
simulation.change(gravity=(0, -1))
simulation.change(drag="much")  # wrong
wg.Simulation(scene, order="color", spin=None, ordr="color")  # wrong
wg.Scene(position=[[0.0, 1.0]], radius=0.1, mass=1, radius_out="wide")  # wrong
wg.Scene(position=[[0.0, 1.0]], radius=0.1, radius_out=2.0)  # wrong
wg.Scene(position=[[0.0, 1.0]], radius=0.1, mass=1, radius_out=2.0, drug=0.5)  # wrong
"""
CHECKERS = ["mypy", "--python-executable"], ["basedpyright", "--level", "error", "--pythonpath"]


def checked(checker, python, files, folder):
    """Check types as in a folder, with the packages that a Python has."""
    command = [sys.executable, "-m", *checker, python, *files]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


@pytest.fixture(scope="module")
def editable(tmp_path_factory):
    """An environment in which `pip install -e` has installed a copy of the checkout, as the README says."""
    folder = tmp_path_factory.mktemp("editable")
    for name in kept():
        (folder / "checkout" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / "checkout" / name)
    venv.create(folder / "fresh", with_pip=True)
    python = folder / "fresh/bin/python"
    command = [python, "-m", "pip", "install", "-q", "--no-deps", "-e", folder / "checkout"]
    subprocess.run(command, check=True)
    return python


@pytest.mark.slow
@pytest.mark.parametrize("checker", CHECKERS, ids=["mypy", "pyright"])
def test_type_checkers_find_an_editable_installation(editable, tmp_path, checker):
    """They know the types of what is taken and returned: the lines that end in "# wrong" are refused."""
    (tmp_path / "program.py").write_text(TYPED)
    done = checked(checker, editable, ["program.py"], tmp_path)
    assert done.returncode == 1
    errors = [line for line in done.stdout.splitlines() if "error:" in line]
    wrong = [k for k, line in enumerate(TYPED.splitlines(), 1) if line.endswith("# wrong")]
    assert [int(line.partition("program.py:")[2].partition(":")[0]) for line in errors] == wrong, done.stdout
    assert '"int"' in errors[0]


@pytest.mark.slow
@pytest.mark.parametrize("checker", CHECKERS, ids=["mypy", "pyright"])
def test_python_of_pages_is_typed(tmp_path, checker):
    for name in PAGES:
        (tmp_path / f"{name.replace('-', '_')}_page.py").write_text(program(name))
    done = checked(checker, sys.executable, tmp_path.iterdir(), ROOT)
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_editable_installation_finds_all_packages(editable, tmp_path):
    script = "import sys, importlib.util as u; assert all(u.find_spec(name) for name in sys.argv[1:])"
    packages = PROJECT["tool"]["setuptools"]["packages"]
    subprocess.run([editable, "-c", script, *packages], cwd=tmp_path, check=True)


EXPERIMENTAL = "WARNING `[tool.distutils]` in `pyproject.toml` is still *experimental*"
"""What setuptools says of the table by which type checkers find an editable installation."""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """An sdist, and the wheel that is made of it."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--outdir", str(folder), str(ROOT)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert "WARNING" not in (done.stdout + done.stderr).replace(EXPERIMENTAL, "")
    return folder


@pytest.mark.slow
def test_a_wheel_of_the_sdist_runs_in_a_fresh_environment(built, tmp_path):
    (sdist,), (wheel,) = built.glob("*.tar.gz"), built.glob("*.whl")
    shipped = {name for name in kept("warpgrains/", "kernels/", "scenes/") if name.endswith(SHIPPED)}
    expected = {name for name in shipped if not name.startswith(("scenes/docs/", "scenes/programs/"))}
    with tarfile.open(sdist) as archive:
        assert expected <= {name.partition("/")[2] for name in archive.getnames()}
    with zipfile.ZipFile(wheel) as archive:
        packed = {re.sub(r"^warpgrains/(?=kernels/|scenes/)", "", name) for name in archive.namelist()}
        assert expected == {name for name in packed if ".dist-info/" not in name}

    venv.create(tmp_path / "fresh", with_pip=True)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    how = {"cwd": tmp_path, "env": environment, "capture_output": True, "text": True}

    def run(program, *words):
        done = subprocess.run([tmp_path / "fresh/bin" / program, *words], **how)
        assert done.returncode == 0, done.stderr
        return done.stdout

    run("pip", "install", "-q", "--no-compile", str(wheel))
    assert run("warpgrains", "--version").split() == ["warpgrains", warpgrains.__version__]
    assert "annulus.usdc, 193 frames" in run("warpgrains", "run", "annulus", "-o", "annulus.usdc")
    assert "OK: " in run("warpgrains", "check", "annulus.usdc")
    assert run("warpgrains", "grade", "--template", "mine").split()[-1] == "mine/fem.h"
    home, position = run("python", "-c", SCRIPT).split()
    simulation = Simulation("annulus")
    simulation.advance(100)
    assert Path(home).is_relative_to(tmp_path)
    assert position == simulation.position.tobytes().hex()
