"""The kernels compile for a GPU, on a machine that has none."""

from dataclasses import fields
from pathlib import Path

import pytest
import warp as wp

from warpgrains.kernels import carry, detect, iterate, iteration, measure, motion, order, reach, watch
from warpgrains.kernels.variant import Variant

HOPPER = 90


@pytest.mark.parametrize("everything", [False, True], ids=["simplest scene", "all features"])
def test_compiles_for_cuda(everything: bool, tmp_path: Path) -> None:
    variant = Variant(*[everything] * len(fields(Variant)))
    for stage in (carry, detect, iterate, iteration, measure, motion, order, reach, watch):
        stage.kernels(variant)
    wp.compile_aot_module(variant.module, arch=HOPPER, module_dir=tmp_path, use_ptx=False)
    assert list(tmp_path.glob("*.cubin"))
