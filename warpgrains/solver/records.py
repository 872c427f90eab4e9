"""The records of scenes of one method, and the memory that they point to."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from warpgrains.kernels.record import SceneRecord
from warpgrains.kernels.types import VerletNumbers
from warpgrains.scene.scene import Scene
from warpgrains.solver import tuning
from warpgrains.solver.buffers import Block, Counts, Layout, Sizes, bytes_needed, fields, grid_width
from warpgrains.solver.memory import require_memory


class SceneRecords:
    """Records on a device, each with a block of memory for all its arrays.

    Parameters
    ----------
    scenes : sequence of Scene
        All of one method.
    team : int
        Threads that share a scene.
    device : wp.Device

    Attributes
    ----------
    device : array of SceneRecord
    host : ndarray
        The same as the host sees them.
    """

    def __init__(self, scenes: Sequence[Scene], team: int, device: wp.Device):
        self._scenes, self._device = scenes, device
        self.sizes = Sizes.first(scenes, team, device)
        require_memory(int(bytes_needed(self.sizes).sum()), int(self.sizes.grains.sum()), device)
        self._number = {field.name: number for number, field in enumerate(fields())}
        self.device = wp.zeros(len(scenes), dtype=SceneRecord, device=device)
        self.host = self.device.numpy()
        self._blocks: list[Block | None] = [None] * len(scenes)
        self._length: list[list[int]] = [[]] * len(scenes)
        self._offset: list[list[int]] = [[]] * len(scenes)
        self._place(np.arange(len(scenes)), self.sizes)
        self._write_parameters()

    def _place(self, which: Counts, sizes: Sizes) -> None:
        """Give scenes new blocks of memory, and write in their records where the arrays are."""
        layout = Layout.of(sizes)
        blocks = [Block(size, self._device) for size in layout.size.tolist()]
        base = np.array([block.pointer for block in blocks], np.uint64)
        for number, field in enumerate(fields()):
            arrays = field.of(self.host)
            arrays["data"][which] = base + layout.offset[number].astype(np.uint64)
            arrays["shape"][which, 0] = layout.length[number]
            arrays["strides"][which, 0] = field.bytes
            arrays["ndim"][which] = 1
        places = zip(blocks, layout.length.T.tolist(), layout.offset.T.tolist(), strict=True)
        for k, place in zip(which.tolist(), places, strict=True):
            self._blocks[k], self._length[k], self._offset[k] = place

    def _write_parameters(self) -> None:
        """Write what a scene's record holds beside arrays."""
        host, scenes, sizes = self.host, self._scenes, self.sizes
        for name in ("gravity", "drag", "dt"):
            host[name] = [getattr(scene, name) for scene in scenes]
        for name in ("radius_in", "radius_out"):
            host["walls"][name] = [getattr(scene, name) for scene in scenes]
        host["walls"]["round"] = [scene.wall == "round" for scene in scenes]
        host["scheme"]["leapfrog"] = [scene.scheme == "leapfrog" for scene in scenes]
        for name in ("smallest_radius", "room", "acceleration", "rounding", "tile", "monitor_threshold"):
            host["tuning"][name] = [getattr(tuning, name)(scene) for scene in scenes]
        host["tuning"]["reserve"] = tuning.RESERVE
        host["stopping"]["patience"] = [tuning.patience(scene) for scene in scenes]
        host["stopping"]["on_residual"] = [scene.stops_on_residual for scene in scenes]
        host["stopping"]["raise_on_unconverged"] = [scene.on_unconverged == "raise" for scene in scenes]
        for name in ("tolerance", "max_iterations"):
            host["stopping"][name] = [getattr(scene, name) for scene in scenes]
        host["grid"]["size"] = [tuning.cell_size(scene) for scene in scenes]
        host["grid"]["width"] = grid_width(sizes.grains)
        host["by_color"] = [scene.order == "color" for scene in scenes]
        host["merge"] = self._device.is_cpu and not sizes.accelerated
        host["has_strips"] = sizes.has_strips

    def array(self, k: int, name: str) -> np.ndarray[Any, Any]:
        """Return an array of scene k, a view that is valid until its list grows."""
        number = self._number[name]
        field = fields()[number]
        shape = (self._length[k][number], *field.shape)
        return np.ndarray(shape, field.dtype, self._block(k).host, self._offset[k][number])

    def _block(self, k: int) -> Block:
        block = self._blocks[k]
        assert block is not None
        return block

    def verlet_numbers(self, k: int) -> np.ndarray[Any, Any]:
        """Return a view of `VerletNumbers` of scene k, which are all floats."""
        dtype = self.host.dtype
        offset = dtype.fields["verlet"][1] + dtype["verlet"].fields["numbers"][1]
        count = VerletNumbers.numpy_dtype()["itemsize"] // 8
        return np.ndarray(count, np.float64, self.host.data, k * dtype.itemsize + offset)

    def make_room(self, k: int, pairs: int) -> None:
        """Move scene k to where a list of so many pairs has room.

        Raises
        ------
        SimulationError
            There is not so much memory.
        """
        if pairs <= self.sizes.pairs[k]:
            return
        grown = self.sizes.pairs.copy()
        grown[k] = pairs + pairs // 4
        sizes = replace(self.sizes, pairs=grown)
        require_memory(int(bytes_needed(sizes.of(k))[0]), self._scenes[k].n, self._device)
        kept = {field.name: self.array(k, field.name) for field in fields()}
        self.sizes = sizes
        self._place(np.array([k]), sizes.of(k))
        for name, array in kept.items():
            self.array(k, name)[: len(array)] = array
        self.push(k)

    def pull(self, k: int) -> None:
        """Let the host see what the device has written of scene k."""
        if not self._device.is_cpu:
            self.host[:] = self.device.numpy()
            self._block(k).pull()

    def push(self, k: int) -> None:
        """Let the device see what the host has written of scene k."""
        if not self._device.is_cpu:
            self.device.assign(self.host)
            self._block(k).push()
