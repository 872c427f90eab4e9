"""The kernels compile for a GPU, on a machine that has none."""

from pathlib import Path

import warp as wp
from launched import every_stage

HOPPER = 90


def test_compiles_for_cuda(tmp_path: Path) -> None:
    """Every kernel that a GPU would launch, by any method."""
    module, kernels = every_stage("compiled_for_cuda")
    assert len(kernels) > 50
    assert len({kernel.key for kernel in kernels}) == len(kernels)
    wp.compile_aot_module(module, arch=HOPPER, module_dir=tmp_path, use_ptx=True)
    assert list(tmp_path.glob("*.ptx"))
