"""The arrays of scenes do not overlap, and what a scene is said to take covers them."""

import numpy as np
import pytest
import warp as wp
from stages import grains_apart

from warpgrains.kernels.record import SceneRecord
from warpgrains.solver.buffers import ALIGNMENT, BlockLayout, array_fields, bytes_needed
from warpgrains.solver.records import SceneRecords
from warpgrains.solver.sizes import Sizes

CONTACTS = 11
GRAINS = np.array([1, 2, 7, 60])


@pytest.fixture(
    params=[(0, 0, 1), (1, 0, 1), (0, 0, 3), (1, 0, 3), (0, 1, 3)],
    ids=["plain", "ahead", "plain team", "ahead team", "friction, restitution, rolling"],
)
def sizes(request):
    accelerated, friction, team = request.param
    kinds = [(1, 3, 2, 1), (0, 2, 0, 0), (0, 1, 0, 1), (0, 0, 1, 0), (1, 0, 0, 1), (0, 1, 0, 1), (0, 5, 0, 0)]
    return Sizes(
        GRAINS,
        np.full_like(GRAINS, CONTACTS),
        *map(np.array, kinds),
        accelerated,
        *[friction] * 3,
        team,
        team,
    )


def test_arrays_do_not_overlap(sizes):
    layout = BlockLayout.of(sizes)
    item = np.array([field.bytes for field in array_fields()])[:, None]
    end = layout.offset + item * layout.length
    assert (layout.offset % ALIGNMENT == 0).all()
    assert (end[:-1] <= layout.offset[1:]).all()
    assert (end[-1] <= layout.size).all()
    assert (bytes_needed(sizes) == layout.size + SceneRecord.numpy_dtype()["itemsize"]).all()


def test_every_scene_has_a_history_of_its_own():
    scenes, device = [grains_apart(3)] * 2, wp.get_device("cpu")
    records = SceneRecords(scenes, Sizes.first(scenes, 1, device), device)
    records.keep_history(1, 7)
    assert [len(records.array(k, "history.zeta")) for k in (0, 1)] == [0, 7]
    records.keep_history(0, 7)
    assert [len(records.array(k, "history.zeta")) for k in (0, 1)] == [7, 7]
