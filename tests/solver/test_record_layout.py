"""A batch's records have the arrays that a simulation has, and no two of them overlap."""

import numpy as np
import pytest
import warp as wp

from warpgrains.kernels.variant import Variant
from warpgrains.solver import grains
from warpgrains.solver.record_layout import ALIGNMENT, Layout, fields

PAIRS = 11
SIZES = np.array([1, 2, 7, 60])


def variant(everything: bool) -> Variant:
    return Variant(*[everything] * 6)


@pytest.mark.parametrize("everything", [False, True])
def test_lengths_are_those_of_a_simulation(everything: bool) -> None:
    device, kind = wp.get_device("cpu"), variant(everything)
    layout = Layout.of(SIZES, np.full_like(SIZES, PAIRS), kind)
    for k, n in enumerate(SIZES.tolist()):
        structs = {
            "watch": grains.allocate_watch(n, device),
            "progress": grains.allocate_progress(1, device),
            "momentum": grains.allocate_momentum(n, kind, device),
        }
        for field, length in zip(fields(), layout.length[:, k], strict=True):
            if field.path[0] in structs and not field.name.startswith("momentum.pair"):
                assert length == getattr(structs[field.path[0]], field.path[1]).shape[0], field.name


@pytest.mark.parametrize("everything", [False, True])
def test_arrays_do_not_overlap(everything: bool) -> None:
    layout = Layout.of(SIZES, np.full_like(SIZES, PAIRS), variant(everything))
    item = np.array([field.bytes for field in fields()])[:, None]
    end = layout.offset + item * layout.length
    assert (layout.offset % ALIGNMENT == 0).all()
    assert (end[:-1] <= layout.offset[1:]).all()
    assert (end[-1] <= layout.size).all()
