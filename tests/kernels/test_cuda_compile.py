"""The kernels compile for a GPU, on a machine that has none."""

from pathlib import Path

import pytest
import warp as wp

from warpgrains.kernels.advance import kernel
from warpgrains.kernels.record import Kind
from warpgrains.kernels.step import KINDS, fused_step

HOPPER = 90
OF_EVERY_STAGE = [kind for kind in KINDS if kind.method != "accelerated" and all(kind[1:])]
"""The exact method has the stages of the accelerated one, and these are with all options."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", OF_EVERY_STAGE, ids=str)
def test_compiles_for_cuda(tmp_path: Path, kind: Kind) -> None:
    module = kernel(f"compiled_for_cuda_{kind}", fused_step(kind), on_gpu=True).module
    wp.compile_aot_module(module, arch=HOPPER, module_dir=tmp_path, use_ptx=True)
    assert list(tmp_path.glob("*.ptx"))
