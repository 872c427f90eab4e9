"""The records of many scenes of one kind, and the memory that they point to."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warpgrains import contacts, scales, solver
from warpgrains.kernels.record import SceneRecord
from warpgrains.kernels.variant import Variant
from warpgrains.memory import require_memory
from warpgrains.record_layout import Counts, Layout, fields, first_room, grid_width
from warpgrains.scene import Scene

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
        self._layout = Layout.of(self._n, self._room, variant)
        self._place(np.arange(len(scenes)), self._layout)
        self._write_parameters()

    def _place(self, which: Counts, layout: Layout) -> None:
        """Give scenes new blocks of memory, and write in their records where the arrays are."""
        blocks = [_block(size) for size in layout.size.tolist()]
        base = np.array([block.__array_interface__["data"][0] for block in blocks], np.uint64)
        for number, field in enumerate(fields()):
            arrays = field.of(self._host)
            arrays["data"][which] = base + layout.offset[number].astype(np.uint64)
            arrays["shape"][which, 0] = layout.length[number]
            arrays["strides"][which, 0] = field.bytes
            arrays["ndim"][which] = 1
        for k, block in zip(which, blocks, strict=True):
            self._blocks[k] = block

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
        ahead = self._variant.accelerated
        host["window"] = np.iinfo(np.int32).max if ahead else contacts.WINDOW
        host["merge"] = not ahead
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
        length, offset = self._layout.length[number, k], self._layout.offset[number, k].item()
        return np.ndarray((length, *field.shape), field.dtype, self._blocks[k], offset)

    def make_room(self, k: int, pairs: int) -> None:
        """Move scene k to where a list of so many pairs has room."""
        if pairs <= self._room[k]:
            return
        require_memory(0, pairs + pairs // 4, wp.get_device("cpu"))
        kept = {field.name: self.array(k, field.name) for field in fields()}
        self._room[k] = pairs + pairs // 4
        layout = Layout.of(self._n[[k]], self._room[[k]], self._variant)
        self._layout.length[:, k], self._layout.offset[:, k] = layout.length[:, 0], layout.offset[:, 0]
        self._place(np.array([k]), layout)
        for name, array in kept.items():
            self.array(k, name)[: len(array)] = array


def _block(size: int) -> np.ndarray:
    """Allocate zeros in lines of memory of their own: a line that two threads write to is slow for both."""
    memory = np.zeros((size // LINE + 2) * LINE, np.uint8)
    first = -memory.__array_interface__["data"][0] % LINE
    return memory[first : first + size]
