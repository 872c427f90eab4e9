"""Compiled kernels in Warp's cache: damaged files are replaced, and a full disk is named."""

import numpy as np
import pytest
import warp as wp
from command import exit_code, small_disk

from warpgrains import Scene, Simulation, kernel_cache
from warpgrains.warp_start import start_warp


@pytest.fixture
def cache(tmp_path, monkeypatch):
    start_warp()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    return tmp_path


@wp.kernel(module="unique")
def double(numbers: wp.array(dtype=wp.float64)):
    numbers[0] = wp.float64(2.0) * numbers[0]


def test_damaged_files_are_replaced(cache):
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
def test_a_full_disk_is_named(most, cache, capfd):
    """Also where only the end of the object file would not fit, at which LLVM ends the process."""
    Simulation(Scene.load("annulus"))
    with small_disk(most):
        assert exit_code("run", "annulus", "--steps", "1", "--set", "solver.method=accelerated") == 1
    said = capfd.readouterr().err.splitlines()[-1]
    assert said.startswith(
        f"warpgrains: error: the cache of compiled kernels in '{cache}' cannot be written ("
    )
    assert said.endswith("): set WARP_CACHE_PATH to a writable folder")
    assert not list(cache.iterdir())
