"""Compiled kernels in Warp's cache: damaged files are replaced, and a full disk is named."""

import numpy as np
import pytest
import warp as wp
from command import exit_code, small_disk

from warpgrains import Scene, Simulation, kernel_cache
from warpgrains.warp_start import start_warp

DAMAGES = {
    "object file cut short": (2, ".o", lambda whole: whole[: len(whole) // 4]),
    "object file empty": (3, ".o", lambda _: b""),
    "metadata cut short": (4, ".meta", lambda whole: whole[:1]),
}
"""A number that makes the kernel a new one, the file, and what becomes of it."""


@pytest.fixture
def cache(tmp_path, monkeypatch):
    start_warp()
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    return tmp_path


def new_kernel(factor):
    @wp.kernel(module="unique")
    def scale(numbers: wp.array(dtype=wp.float64)):
        numbers[0] = wp.float64(wp.static(factor)) * numbers[0]

    return scale


@pytest.mark.parametrize(("factor", "suffix", "damage"), DAMAGES.values(), ids=DAMAGES)
def test_damaged_files_are_replaced(factor, suffix, damage, cache):
    kernel, device = new_kernel(factor), wp.get_device("cpu")
    kernel_cache.load(kernel.module, device, 1)
    (folder,) = cache.iterdir()
    (file,) = (file for file in folder.iterdir() if file.suffix == suffix)
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    kernel.module.unload()
    with pytest.warns(
        UserWarning, match=f"the compiled kernels in '{folder}' are damaged: compiling them again"
    ):
        kernel_cache.load(kernel.module, device, 1)
    assert list(cache.iterdir()) == [folder]
    assert file.read_bytes() == whole
    numbers = np.array([2.0])
    wp.launch(kernel, dim=1, inputs=[wp.array(numbers, device="cpu", copy=False)], device="cpu", block_dim=1)
    assert numbers[0] == 2.0 * factor


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
