"""A full disk, or standard output that cannot be written: one line that names it, and no half of a file.

Half a file in the cache of compiled kernels, which others may have left there, is replaced.
"""

import os
import subprocess
import sys

import numpy as np
import pytest
import warp as wp
from command import exit_code, small_disk

from warpgrains import Scene, Simulation
from warpgrains.base import kernel_cache
from warpgrains.base.warp_start import start_warp
from warpgrains.pictures.film import encoding_of_frames

COMMAND = [sys.executable, "-m", "warpgrains"]
COMPILING = "compiling kernels for this kind of scene, the first time only ..."
SWEEP = """
scene = "annulus"
[set]
time.duration = 0.1
[axes]
physics.drag = {range = [0.1, 0.5], count = 20}
"""


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """Kernels are compiled while the disk has room for them."""
    Simulation(Scene.load("annulus")).compile()


@pytest.fixture
def complaint(tmp_path, monkeypatch, capfd):
    """Run a command that no disk has room for, and return its only line."""
    monkeypatch.chdir(tmp_path)

    def run(*words, most=2**30):
        with small_disk(most):
            assert exit_code(*words) == 1
        printed = capfd.readouterr()
        assert printed.out == ""
        said = printed.err.removeprefix(f"{COMPILING}\n")
        assert said.count("\n") == 1, printed.err
        return said.strip().removeprefix("warpgrains: error: ")

    return run


@pytest.mark.parametrize("options", [[], ["--folders"]], ids=["parts", "folders"])
def test_names_the_file_of_a_sweep(tmp_path, complaint, options):
    (tmp_path / "sweep.toml").write_text(SWEEP)
    said = complaint("batch", "sweep.toml", "-o", "out", *options, most=900)
    assert said.startswith(f"'{tmp_path / 'out'}/")
    assert said.endswith("' cannot be written: File too large")
    assert not list((tmp_path / "out").rglob(".draft*"))


@pytest.mark.parametrize(("words", "buffered"), [("scenes", "1"), ("batch sweep.toml -o out", "")])
def test_names_standard_output(tmp_path, words, buffered):
    (tmp_path / "sweep.toml").write_text(SWEEP)
    how = {"cwd": tmp_path, "env": {**os.environ, "PYTHONUNBUFFERED": buffered}, "text": True}
    with open("/dev/full", "w") as full:
        done = subprocess.run([*COMMAND, *words.split()], stdout=full, stderr=subprocess.PIPE, **how)
    assert done.returncode == 1
    assert done.stderr == "warpgrains: error: standard output cannot be written: No space left on device\n"
    if "batch" in words:
        assert len((tmp_path / "out" / "results.csv").read_text().splitlines()) == 21


def test_an_encoder_that_ends_early_is_no_broken_pipe(tmp_path):
    encoding = encoding_of_frames(tmp_path / "no" / "film.mp4", (2000, 3000, 3), 25.0)
    large = np.zeros((2000, 3000, 3), np.uint8)
    with pytest.raises(OSError, match="No such file or directory"):
        all(encoding.write(large) is None for _ in range(100))


def test_stopping_an_encoder_leaves_no_process(tmp_path):
    encoding = encoding_of_frames(tmp_path / "film.mp4", (20, 31, 3), 25.0)
    encoding.write(np.zeros((20, 31, 3), np.uint8))
    encoding.stop()
    assert encoding._process.returncode is not None


@pytest.fixture
def disk(tmp_path, request):
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={request.param}", "tmpfs", folder]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("only root can mount a small disk")
    yield folder
    subprocess.run(["umount", folder], check=True)


@pytest.mark.parametrize("disk", ["16k"], indirect=True)
def test_small_disk(disk, complaint):
    """The whole disk is full, not only a file: also the folders of temporary files are."""
    for name in ("run.mp4", "run.gif", "run.usdc"):
        words = ["run", "annulus", "--steps", "40", "-o", f"disk/{name}"]
        said = complaint(*words)
        assert said.startswith(f"'disk/{name}")
        assert said.endswith("No space left on device")
        assert not list(disk.iterdir())


@pytest.mark.parametrize("disk", ["120k"], indirect=True)
def test_an_export_that_does_not_fit_keeps_the_earlier_one(disk, tmp_path, complaint, capfd):
    Simulation("annulus").run(steps=40, record=tmp_path / "run.usdc", forces=True)
    assert exit_code("export", tmp_path / "run.usdc", "-o", disk / "run.pvd") == 0
    before = {path: path.read_bytes() for path in disk.rglob("*.*")}
    Simulation("polydisperse").run(steps=40, record=tmp_path / "run.usdc", forces=True)
    capfd.readouterr()
    for _ in range(2):
        said = complaint("export", "run.usdc", "-o", "disk/run.pvd")
        assert said.startswith("'disk/run")
        assert "cannot be written" in said
        assert {path: path.read_bytes() for path in disk.rglob("*.*")} == before


@pytest.fixture
def cache(tmp_path, monkeypatch):
    start_warp()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    return tmp_path


@wp.kernel(module="unique")
def double(numbers: wp.array(dtype=wp.float64)):
    numbers[0] = wp.float64(2.0) * numbers[0]


def test_damaged_kernels_are_replaced(cache):
    device = wp.get_device("cpu")
    kernel_cache.load(double.module, device, 1)
    (folder,) = cache.iterdir()
    files = {file.suffix: file for file in folder.iterdir()}
    for suffix, left in ((".o", 0.25), (".o", 0.0), (".meta", 0.01)):
        whole = files[suffix].read_bytes()
        files[suffix].write_bytes(whole[: int(left * len(whole))])
        double.module.unload()
        with pytest.warns(UserWarning, match=f"kernels in '{folder}' are damaged: compiling them again"):
            kernel_cache.load(double.module, device, 1)
        assert list(cache.iterdir()) == [folder]
        assert files[suffix].read_bytes() == whole
    numbers = np.array([2.0])
    wp.launch(double, dim=1, inputs=[wp.array(numbers, device="cpu", copy=False)], device="cpu", block_dim=1)
    assert numbers[0] == 4.0


@pytest.mark.parametrize("most", [10_000, 2_000_000])
def test_names_the_cache_of_kernels(most, cache, complaint):
    """Also where only the end of the object file would not fit, at which LLVM ends the process."""
    words = ["run", "annulus", "--steps", "1", "--set", "solver.method=accelerated"]
    said = complaint(*words, most=most)
    assert said.startswith(f"the cache of compiled kernels in '{cache}' cannot be written (")
    assert said.endswith("): set WARP_CACHE_PATH to a writable folder")
    assert not list(cache.iterdir())
