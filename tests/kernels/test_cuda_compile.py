"""The kernels compile for a GPU, on a machine that has none."""

from pathlib import Path

import pytest
import warp as wp

from warpgrains.kernels.gpu import leaves, stage_kernel
from warpgrains.kernels.stages import OPTIONS
from warpgrains.kernels.step import METHODS, step

HOPPER = 90


@pytest.mark.parametrize("method", METHODS)
def test_compiles_for_cuda(method: str, tmp_path: Path) -> None:
    """Every kernel that a GPU would launch."""
    module = wp.get_module(f"compiled_for_cuda_{method}")
    wp.set_module_options(OPTIONS, module)
    kernels = [stage_kernel(leaf, module) for leaf in leaves(step(method))]
    assert len(kernels) > 40
    wp.compile_aot_module(module, arch=HOPPER, module_dir=tmp_path, use_ptx=False)
    assert list(tmp_path.glob("*.cubin"))
