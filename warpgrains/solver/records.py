"""The records of scenes of one kind, and the memory blocks of their arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.base.errors import SimulationError
from warpgrains.kernels.access import CHECKED
from warpgrains.kernels.record import SceneRecord
from warpgrains.kernels.search.neighbors import MOST_CONTACTS
from warpgrains.kernels.sweeps.stopping import StopOn
from warpgrains.kernels.types import MotionOf
from warpgrains.scene.state import first_state
from warpgrains.solver import tuning
from warpgrains.solver.buffers import (
    Block,
    BlockLayout,
    array_fields,
    bytes_needed,
    copied_memory,
    records_in,
)
from warpgrains.solver.loading import load_state
from warpgrains.solver.memory import require_memory
from warpgrains.solver.sizes import Sizes, grid_width

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene


class SceneRecords:
    """Records of scenes of one kind on a device, each with one memory block for all its arrays.

    Attributes
    ----------
    device : array of SceneRecord
        The records of all scenes in memory of the device.
    host : ndarray
        The same records in host memory.
    scenes : list of Scene
    loaded_steps : ndarray
        Number of steps at which the last state was loaded, shape (scenes,).
    last_scenes : list
        `State.last_scene` of every scene since it was loaded or changed: the scene of the last step before
        that, if its parameters differed; otherwise None.
    populations : list of dict
        Numbers of birth, and of exchanged grains, of every scene: fields `OF_POPULATION` of its state.
    """

    def __init__(self, scenes: Sequence[Scene], sizes: Sizes, device: wp.Device):
        self.scenes, self._device = list(scenes), device
        self.loaded_steps = np.zeros(len(scenes), np.int64)
        self.last_scenes: list[Scene | None] = [None] * len(scenes)
        self.populations: list[dict[str, Any]] = [{}] * len(scenes)
        self.sizes = sizes
        require_memory(bytes_needed(self.sizes), int(self.sizes.grains.sum()), device)
        self._number = {field.name: number for number, field in enumerate(array_fields())}
        if device.is_cpu:
            own = self.device = wp.zeros(len(scenes), dtype=SceneRecord, device=device)
        else:
            own, self.device = self._copies = copied_memory(len(scenes), SceneRecord, device)
        self.host = records_in(own)
        self._blocks: list[Any] = [None] * len(scenes)
        self._memory: NDArray[np.uint8] | None = None
        self._length = np.zeros((len(array_fields()), len(scenes)), np.int64)
        self._offset = self._length.copy()
        self._place(np.arange(len(scenes)), self.sizes)
        if device.is_cpu:
            self._memory = self._blocks[0].host.base
        self._write_grains()
        self.write_parameters()
        for k in np.flatnonzero(sizes.driven).tolist():
            load_state(self, k, first_state(scenes[k]))

    def _place(self, which: IndexArray, sizes: Sizes) -> None:
        """Allocate memory blocks for scenes, and write the addresses of their arrays to the records."""
        layout = BlockLayout.of(sizes)
        blocks = Block.several(layout.size, self._device)
        base = np.array([block.pointer for block in blocks], np.uint64)
        for number, field in enumerate(array_fields()):
            arrays = field.of(self.host)
            arrays["data"][which] = base + layout.offset[number].astype(np.uint64)
            arrays["shape"][which, 0] = layout.length[number]
            arrays["strides"][which, 0] = field.bytes
            arrays["ndim"][which] = 1
            if CHECKED:
                arrays["grad"][which] = self._violations()[which]
        self._length[:, which], self._offset[:, which] = layout.length, layout.offset
        for k, block in zip(which.tolist(), blocks, strict=True):
            self._blocks[k] = block

    def _violations(self) -> NDArray[np.uint64]:
        """Return the address of the `Violation` of each scene, shape (scenes,)."""
        offset = np.dtype(SceneRecord.numpy_dtype()).fields["violation"][1]
        records = np.arange(len(self.scenes), dtype=np.uint64) * np.uint64(self.host.itemsize)
        return records + np.uint64(self.device.ptr + offset)

    def violation(self, k: int) -> str | None:
        """Return a message on an index of scene k outside its array, or None if checked mode found none."""
        found = self.host["violation"][k]
        if not found["found"]:
            return None
        names = [
            field.name
            for number, field in enumerate(array_fields())
            if field.of(self.host)["data"][k] == found["array"] and self._length[number, k] == found["length"]
        ]
        return f"index {found['index']} of {' or '.join(names)}, which has length {found['length']}, was used"

    def has_stepped(self, k: int) -> bool:
        """Return True if scene k has taken a step since its state was loaded."""
        return bool(self.host["steps"][k] != self.loaded_steps[k])

    def write_parameters(self, which: slice = slice(None)) -> None:
        """Write all parameters and the walls of the scenes in the range `which` to their records."""
        host, scenes, sizes = self.host[which], self.scenes[which], self.sizes
        host["start_time"] = [scene.time for scene in scenes]
        numbers = "drag spin_drag friction rolling_friction restitution restitution_speed dt"
        for name in numbers.split():
            host[name] = [getattr(scene, name) for scene in scenes]
        host["first_bounce"] = [scene.has_restitution and not scene.bounces_at_start for scene in scenes]
        self.set_gravity([scene.gravity for scene in scenes], which)
        host["gravity_start"] = host["gravity"]
        host["gravity_rate"] = [scene.gravity_rate for scene in scenes]
        annulus, bodies = host["walls"]["annulus"], [scene.bodies for scene in scenes]
        annulus["radius_in"], annulus["radius_out"] = np.array([own.circles for own in bodies]).T
        annulus["angular_velocity_out"] = [own.outer.rotation if own.outer else 0.0 for own in bodies]
        annulus["round"] = [own.is_round for own in bodies]
        host["walls"]["period"] = [scene.period.lengths for scene in scenes]
        host["leapfrog"] = [scene.scheme == "leapfrog" for scene in scenes]
        for name in ("room", "rounding", "monitor_threshold", "nearest"):
            host["tuning"][name] = [getattr(tuning, name)(scene) for scene in scenes]
        host["tuning"]["smallest_radius"] = [scene.smallest_radius for scene in scenes]
        host["tuning"]["reserve"] = tuning.RESERVE
        host["stopping"]["patience"] = [tuning.patience(scene) for scene in scenes]
        host["stopping"]["on"] = [StopOn[scene.stops_on.upper()] for scene in scenes]
        host["stopping"]["raise_on_unconverged"] = [scene.on_unconverged == "raise" for scene in scenes]
        for name in ("tolerance", "max_iterations"):
            host["stopping"][name] = [getattr(scene, name) for scene in scenes]
        host["grid"]["inverse_size"] = [1.0 / tuning.cell_size(scene) for scene in scenes]
        host["grid"]["width"] = grid_width(sizes.grains[which])
        host["by_color"] = [scene.order == "color" for scene in scenes]
        host["merge"] = self._device.is_cpu and not sizes.accelerated and sizes.team == 1
        for k, scene in zip(range(len(self.scenes))[which], scenes, strict=True):
            self._write_walls(k, scene)

    def _write_walls(self, k: int, scene: Scene) -> None:
        bodies, sizes = scene.bodies, self.sizes
        if sizes.walls[k] > 1:
            self.array(k, "walls.shape")[:] = [wall.shape for wall in bodies.inside]
        if sizes.joined[k]:
            joined = [one for own in bodies.joints for one in own]
            self.array(k, "walls.joint")[:] = [(other, comes_first) for other, comes_first, _ in joined]
            self.array(k, "walls.joint_way")[:] = [way for *_, way in joined]
            self.array(k, "walls.joint_start")[:] = np.cumsum([0, *map(len, bodies.joints)])
        if sizes.imaged[k]:
            self.array(k, "walls.image")[:] = bodies.image_ways
        if sizes.mobile[k]:
            # where a tangent at a joint is touched (8c), up to two radii beyond the wall, it turns faster
            beyond = 2.0 * float(scene.radius.max()) * sizes.joined[k]
            names = [own.name.lower() for own in MotionOf]
            self.array(k, "walls.motion")[:] = [
                [
                    (wall.motion_numbers | {"speed": wall.speed + beyond * abs(wall.angular_velocity)})[name]
                    for name in names
                ]
                for wall in bodies.inside
            ]
        if sizes.driven[k]:
            self.array(k, "walls.drive")[:] = [np.hstack(drive) for drive in bodies.drives]
            inverse = np.array([drive.inverse_mass for drive in bodies.drives])
            mass = self.array(k, "grains.contact_mass")[scene.n :]
            mass[:] = np.divide(1.0, inverse, np.zeros(len(inverse)), where=inverse > 0.0)
        if sizes.friction:
            self.array(k, "walls.surface")[:] = bodies.surfaces
        if sizes.restitution:
            self.array(k, "walls.restitution")[:] = bodies.restitutions
        if sizes.rolling:
            self.array(k, "walls.rolling")[:] = bodies.rolling

    def set_gravity(self, gravity: ArrayLike, which: slice = slice(None)) -> None:
        """Write the gravity of the scenes in the range `which` [m/s2], shape (scenes, 2)."""
        self.host["gravity"][which] = gravity
        self.host["tuning"]["acceleration"][which] = np.hypot(*self.host["gravity"][which].T)

    def _write_grains(self) -> None:
        """Write the initial grains of all scenes to zeroed memory, and mark that no scene has a list."""
        names = ["radius", "mass", "contact_mass", "position", "velocity"]
        for name in names + (["rim_mass", "spin"] if self.sizes.friction else []):
            self._write(f"grains.{name}", [getattr(scene, name) for scene in self.scenes])
        self._write("grains.last_position", [scene.position for scene in self.scenes])
        self._write("verlet.skin", [np.full(len(scene.position), tuning.NO_SKIN) for scene in self.scenes])
        self.host["verlet"]["base_skin"] = [tuning.first_skin(scene) for scene in self.scenes]
        self.host["control"]["unordered"] = 1

    def _write(self, name: str, values: Sequence[FloatArray]) -> None:
        """Write values[k], for every scene k, to the first rows of its array `name`: those of the grains."""
        whole = self.together(name)
        if whole is not None and whole[0].shape == values[0].shape:
            whole[:] = np.concatenate(values).reshape(whole.shape)
            return
        for k, own in enumerate(values):
            self.array(k, name)[: len(own)] = own

    def array(self, k: int, name: str) -> np.ndarray[Any, Any]:
        """Return an array of scene k by its dotted name, as a view that is valid until its list grows."""
        number = self._number[name]
        field = array_fields()[number]
        shape = (self._length[number, k].item(), *field.shape)
        return np.ndarray(shape, field.dtype, self._blocks[k].host, self._offset[number, k].item())

    def together(self, name: str) -> np.ndarray[Any, Any] | None:
        """Return the array `name` of all scenes as one view, shape (scenes, ...), or None if impossible.

        It is possible on a CPU if all scenes have equal layouts and no scene has moved to a larger block.
        """
        number = self._number[name]
        field, length = array_fields()[number], self._length[number]
        start, memory = field.of(self.host)["data"].astype(np.int64), self._memory
        step = np.diff(start)
        if memory is None or (length != length[0]).any() or (step != step[:1]).any():
            return None
        first = int(start[0] - memory.ctypes.data)
        inner = np.empty((1, *field.shape), field.dtype).strides
        strides = (int(step[0]) if len(step) else field.bytes, *inner)
        shape = (len(start), int(length[0]), *field.shape)
        return np.ndarray(shape, field.dtype, memory, first, strides)

    def stacked(self, name: str, which: IndexArray) -> np.ndarray[Any, Any]:
        """Return a copy of the array `name`, by grain, of scenes with n grains each, shape (m, n, ...).

        `which` holds the indices of these m scenes.
        """
        whole, n = self.together(name), self.scenes[which[0]].n
        return np.stack([self.array(int(k), name)[:n] for k in which]) if whole is None else whole[which, :n]

    def reserve_contacts(self, k: int, contacts: int) -> None:
        """Move scene k to a memory block for a list of `contacts` contacts, unless its block suffices.

        Raises SimulationError if there is not so much memory, or the search has found too many contacts.
        """
        if contacts > MOST_CONTACTS:
            scene = self.scenes[k]
            raise SimulationError(
                f"in a step of {scene.dt} s, more than {MOST_CONTACTS} contacts of {scene.n} grains are"
                f" within reach: dt is too long for a smallest radius of {scene.smallest_radius} m"
            )
        if contacts <= self.sizes.contacts[k]:
            return
        grown = self.sizes.contacts.copy()
        grown[k] = min(contacts + contacts // 4, MOST_CONTACTS)
        self._resize(k, replace(self.sizes, contacts=grown))

    def keep_history(self, k: int, iterations: int) -> None:
        """Reserve memory for zeta and residual of the first `iterations` iterations of a step of scene k.

        Raises SimulationError if there is not enough memory.
        """
        if iterations != self.sizes.history[k]:
            history = self.sizes.history.copy()
            history[k] = iterations
            self._resize(k, replace(self.sizes, history=history))

    def _resize(self, k: int, sizes: Sizes) -> None:
        """Move scene k to a memory block for other sizes."""
        require_memory(bytes_needed(sizes.of(k)), self.scenes[k].n, self._device)
        names = [field.name for field in array_fields()]
        kept = [self.array(k, name) for name in names]
        self.sizes, self._memory = sizes, None
        self._place(np.array([k]), sizes.of(k))
        for name, array in zip(names, kept, strict=True):
            moved = self.array(k, name)
            moved[: len(array)] = array[: len(moved)]

    def pull(self) -> None:
        """Wait for the GPU, and copy all records and blocks from it."""
        for host, gpu in {self._copies, *(block.copies for block in self._blocks)}:
            wp.copy(host, gpu)
        wp.synchronize_device(self._device)

    def push(self) -> None:
        """Copy all records and blocks to the GPU."""
        for host, gpu in {self._copies, *(block.copies for block in self._blocks)}:
            wp.copy(gpu, host)
