"""The records of many scenes of one kind, and the memory that they point to."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warpgrains.kernels.record import SceneRecord
from warpgrains.kernels.variant import Variant
from warpgrains.scene.scene import Scene
from warpgrains.solver import contact_list as contacts
from warpgrains.solver import step as solver
from warpgrains.solver import tuning as scales
from warpgrains.solver.memory import require_memory
from warpgrains.solver.record_layout import Counts, Layout, fields, first_room, grid_width

LINE = 128  # bytes that cores pass on together


class SceneRecords:
    """Records on the device, each with a block of memory for all its arrays.

    Parameters
    ----------
    scenes : sequence of Scene
    variant : Variant
        What the kernels of all of them are compiled for.

    Attributes
    ----------
    device : array of SceneRecord
    """

    def __init__(self, scenes: Sequence[Scene], variant: Variant):
        self._scenes, self._variant = scenes, variant
        self._number = {field.name: number for number, field in enumerate(fields())}
        self._n = np.array([scene.n for scene in scenes])
        self._room = first_room(self._n)
        self.device = wp.zeros(len(scenes), dtype=SceneRecord, device="cpu")
        self._host = self.device.numpy()
        self._blocks = [np.zeros(0, np.uint8)] * len(scenes)
        self._length: list[list[int]] = [[]] * len(scenes)
        self._offset: list[list[int]] = [[]] * len(scenes)
        self._place(np.arange(len(scenes)))
        self._write_parameters()

    def _place(self, which: Counts) -> None:
        """Give scenes new blocks of memory, and write in their records where the arrays are."""
        layout = Layout.of(self._n[which], self._room[which], self._variant)
        blocks = [_block(size) for size in layout.size.tolist()]
        base = np.array([block.__array_interface__["data"][0] for block in blocks], np.uint64)
        for number, field in enumerate(fields()):
            arrays = field.of(self._host)
            arrays["data"][which] = base + layout.offset[number].astype(np.uint64)
            arrays["shape"][which, 0] = layout.length[number]
            arrays["strides"][which, 0] = field.bytes
            arrays["ndim"][which] = 1
        places = zip(blocks, layout.length.T.tolist(), layout.offset.T.tolist(), strict=True)
        for k, place in zip(which, places, strict=True):
            self._blocks[k], self._length[k], self._offset[k] = place

    def _write_parameters(self) -> None:
        """Write what a scene's record holds beside arrays."""
        host, scenes = self._host, self._scenes
        for name in ("gravity", "drag", "dt", "radius_in", "radius_out"):
            host[name] = [getattr(scene, name) for scene in scenes]
        host["smallest"] = [scales.smallest_radius(scene) for scene in scenes]
        for name in ("room", "acceleration", "rounding"):
            host[name] = [getattr(scales, name)(scene) for scene in scenes]
        host["reserve"] = solver.RESERVE
        host["by_color"] = [scene.order == "color" for scene in scenes]
        host["window"] = [contacts.WINDOW[scene.order] for scene in scenes]
        host["merge"] = not self._variant.accelerated
        host["holds_back"] = [scene.on_unconverged == "raise" for scene in scenes]
        host["stop"]["on_residual"] = [scene.stops_on_residual for scene in scenes]
        for name in ("tolerance", "max_iterations"):
            host["stop"][name] = [getattr(scene, name) for scene in scenes]
        host["stop"]["calm"] = solver.CALM / host["dt"]
        host["grid"]["size"] = [scales.cell_size(scene) for scene in scenes]
        host["grid"]["width"] = grid_width(self._n)

    def array(self, k: int, name: str) -> np.ndarray:
        """Return an array of scene k, a view that is valid until its list grows."""
        number = self._number[name]
        field = fields()[number]
        shape = (self._length[k][number], *field.shape)
        return np.ndarray(shape, field.dtype, self._blocks[k], self._offset[k][number])

    def make_room(self, k: int, pairs: int) -> None:
        """Move scene k to where a list of so many pairs has room."""
        if pairs <= self._room[k]:
            return
        require_memory(0, pairs + pairs // 4, wp.get_device("cpu"))
        kept = {field.name: self.array(k, field.name) for field in fields()}
        self._room[k] = pairs + pairs // 4
        self._place(np.array([k]))
        for name, array in kept.items():
            self.array(k, name)[: len(array)] = array


def _block(size: int) -> np.ndarray:
    """Allocate zeros in lines of memory of their own: a line that two threads write to is slow for both."""
    memory = np.zeros((size // LINE + 2) * LINE, np.uint8)
    first = -memory.__array_interface__["data"][0] % LINE
    return memory[first : first + size]
