"""The list of candidate contacts, in sweeping order: built anew when the watch asks for it."""

import numpy as np
import warp as wp

from warpgrains.kernels import carry, detect, order, reach
from warpgrains.kernels.data import WALLS, Contacts, Grains, Pair, Progress, Wall, Watch
from warpgrains.kernels.variant import Variant
from warpgrains.memory import require_memory
from warpgrains.neighbors import NeighborSearch, empty_rows
from warpgrains.replay import Replay, reader
from warpgrains.reports import Corrections, IntArray
from warpgrains.scene import Scene

WINDOW = 2048  # pairs that one worker interleaves by levels: many hide latency, few stay in cache


class ContactList:
    """The candidate contacts of a scene, and what it takes to build them anew.

    Parameters
    ----------
    scene : Scene
    grains : Grains
    watch : Watch
        Its reaches decide what is listed.
    progress : Progress
        Tells whether the step is being solved again.
    variant : Variant
        What the scene's kernels are compiled for.
    replay : Replay
        Launches the kernels; forgets its graphs when buffers have grown.
    slack : float
        How far grains may move, beyond what they move in a step, before the list is built anew [m].

    Attributes
    ----------
    device : Contacts
        The list on its device.
    """

    def __init__(
        self,
        scene: Scene,
        grains: Grains,
        watch: Watch,
        progress: Progress,
        variant: Variant,
        replay: Replay,
        slack: float,
    ):
        self._scene, self._grains, self._slack = scene, grains, slack
        self._watch, self._progress = watch, progress
        self._replay, device = replay, replay.device
        self._detect, self._order = detect.kernels(variant), order.kernels(variant)
        self._carry, self._reach = carry.kernels(variant), reach.kernels(variant)
        cell_size = 2.0 * (float(np.median(scene.radius)) + slack)
        self._search = NeighborSearch(grains, watch, variant, replay, cell_size)
        self._old_rows = empty_rows(scene.n, device)
        self.device = Contacts()
        self.device.count = wp.zeros(3, dtype=wp.int32, device=device)
        self._read_count = reader(self.device.count)
        self.device.walls = wp.zeros(scene.n, dtype=Wall, device=device)
        self.device.wall_dv_start = wp.zeros(scene.n, dtype=wp.float64, device=device)
        self._wall_dv = wp.zeros(scene.n, dtype=wp.float64, device=device)
        self._influence = wp.zeros(scene.n, dtype=wp.float64, device=device)
        self._next_level = wp.zeros(scene.n, dtype=wp.int32, device=device)
        self._used_colors = wp.zeros(scene.n, dtype=wp.uint64, device=device)
        self._lost = wp.zeros(1, dtype=wp.int32, device=device)
        self._read_lost = reader(self._lost)
        contacts, rows, old_rows = self.device, self._search.rows, self._old_rows
        contacts.pairs = wp.zeros(0, dtype=Pair, device=device)
        contacts.weights = wp.zeros(0, dtype=wp.vec2d, device=device)
        contacts.group_start = wp.zeros(2, dtype=wp.int32, device=device)
        contacts.pair_dv_start = wp.zeros(0, dtype=wp.float64, device=device)
        self._old_pair_dv = wp.zeros(0, dtype=wp.float64, device=device)
        self._slot = wp.zeros(0, dtype=wp.int32, device=device)
        self._group = wp.zeros(0, dtype=wp.int32, device=device)
        self._buffers = [
            (contacts, "pairs"),
            (contacts, "pair_dv_start"),
            (contacts, "group_start"),
            (rows, "found"),
            (rows, "neighbor"),
            (old_rows, "neighbor"),
            (self, "_old_pair_dv"),
            (self, "_slot"),
            (self, "_group"),
        ]
        if variant.distinct_masses:
            self._buffers.append((contacts, "weights"))
        self._capacity = 0

    @property
    def counts(self) -> tuple[int, int, int]:
        """Candidate pairs, groups that they are swept in, and grains that may reach a wall."""
        pairs, groups, walls = self._read_count().tolist()
        return pairs, groups, walls

    @property
    def groups(self) -> int:
        """Groups of pairs that are swept one after the other."""
        return self.counts[1]

    def rebuild(self) -> None:
        """List every pair and wall within reach, with the corrections that they carry."""
        self._replay.alone(self._set_old_aside)
        while True:
            self._replay.alone(self._search.find)
            if self._reserve(self._search.total):
                self._replay.alone(self._search.find)
            self._replay.alone(self._sort)
            if not self._read_lost()[0]:
                break
        groups = self.groups
        self._replay.alone(self._arrange)
        if self.groups > groups:
            self._replay.forget()

    def _set_old_aside(self) -> None:
        """Keep the pairs and corrections of the old list, and choose the reaches of the new one."""
        each, n, rows = self._replay.each, self._scene.n, self._search.rows
        each(self._carry.save_pairs, n, rows, self._slot, self.device, self._old_pair_dv)
        wp.copy(self._old_rows.start, rows.start)
        wp.copy(self._old_rows.neighbor, rows.neighbor)
        self._wall_dv.zero_()
        each(self._detect.save_walls, n, self.device, self._wall_dv)
        self._renew_reaches()

    def _renew_reaches(self) -> None:
        """Choose what the new list must reach."""
        each, scene, watch, kernels = self._replay.each, self._scene, self._watch, self._reach
        each(kernels.renew, scene.n, self._grains, watch, self._progress, self._slack, scene.dt)
        each(kernels.clear, 1, watch)
        each(kernels.find_mean, scene.n, watch)
        each(kernels.find_spread, scene.n, watch)
        room, acceleration = 0.5 * float(np.median(scene.radius)), float(np.hypot(*scene.gravity))
        each(kernels.find_horizon, 1, watch, self._slack, room, acceleration, scene.dt)

    def _sort(self) -> None:
        """Sort the pairs; where one that carries a correction is not among them, widen its reach."""
        self._search.sort()
        self._lost.zero_()
        rows, old_rows = self._search.rows, self._old_rows
        self._replay.each(
            self._carry.hold_pairs,
            self._scene.n,
            self._grains,
            self._watch,
            old_rows,
            self._old_pair_dv,
            rows,
            self._lost,
        )

    def _arrange(self) -> None:
        """Put the pairs in sweeping order, and list the walls."""
        each, scene, contacts, rows = self._replay.each, self._scene, self.device, self._search.rows
        in_line = self._replay.in_line
        if scene.order == "color":
            each(self._order.colors, 1, rows, self._used_colors, self._group)
        else:
            window = WINDOW if in_line else np.iinfo(np.int32).max
            each(self._order.levels, 1, rows, window, self._next_level, self._group)
        each(self._order.place, 1, rows, self._group, int(in_line), contacts, self._slot)
        old_rows, old_dv = self._old_rows, self._old_pair_dv
        each(self._carry.fill_slots, scene.n, self._grains, old_rows, old_dv, rows, self._slot, contacts)
        self._influence.zero_()
        each(self._carry.weigh, scene.n, rows, self._slot, contacts, self._influence)
        each(self._carry.find_influence, scene.n, self._influence, self._watch)
        contacts.count[WALLS:].zero_()
        walls = (self._watch, scene.radius_in, scene.radius_out, self._wall_dv)
        each(self._detect.find_walls, scene.n, self._grains, contacts, *walls)

    def _reserve(self, pairs: int) -> bool:
        """Make room for so many pairs, keeping what the buffers hold. Returns whether they have grown."""
        if pairs <= self._capacity:
            return False
        require_memory(0, pairs, self._replay.device)
        self._capacity = pairs + pairs // 4
        for owner, name in self._buffers:
            old = getattr(owner, name)
            new = wp.zeros(self._capacity + 2, dtype=old.dtype, device=self._replay.device)
            if old.shape[0] > 0:
                wp.copy(new, old, count=old.shape[0])
            setattr(owner, name, new)
        self._replay.forget()
        return True

    def corrections(self) -> Corrections:
        """Return what the contacts carry after the last good step."""
        pairs, _, walls = self.counts
        i, j, slot = self._listed_pairs(pairs)
        dv = self.device.pairs.numpy()["dv"][slot]
        carrying = dv != 0.0
        wall = self.device.walls.numpy()[:walls]
        wall_correction = np.zeros(self._scene.n)
        wall_correction[wall["i"]] = wall["dv"]
        return Corrections(np.stack([i, j], axis=1)[carrying], dv[carrying], wall_correction)

    def _listed_pairs(self, pairs: int) -> tuple[IntArray, IntArray, IntArray]:
        """Return first grain, second grain and slot of every listed pair, in lexicographic order."""
        rows = self._search.rows
        first = np.repeat(np.arange(self._scene.n, dtype=np.int32), np.diff(rows.start.numpy()))
        return first, rows.neighbor.numpy()[:pairs], self._slot.numpy()[:pairs]

    def load(self, corrections: Corrections) -> None:
        """List just what carries a correction; the watch must ask for a new list before anything is swept."""
        carrying = np.flatnonzero(corrections.wall_correction).astype(np.int32)
        pairs, walls = len(corrections.pair), len(carrying)
        self._reserve(pairs)
        i, j = corrections.pair.T
        rows, contacts = self._search.rows, self.device
        starts = np.searchsorted(i, np.arange(self._scene.n + 1))
        rows.start.assign(starts.astype(np.int32))
        _write(rows.neighbor, j)
        _write(self._slot, np.arange(pairs))
        _write(contacts.pair_dv_start, corrections.pair_correction)
        _write(contacts.wall_dv_start, corrections.wall_correction[carrying])
        wall = np.zeros(self._scene.n, dtype=contacts.walls.numpy().dtype)
        wall["i"][:walls] = carrying
        contacts.walls.assign(wall)
        contacts.count.assign([pairs, 0, walls])

    def revert(self) -> None:
        """Take back what an unfinished step did to the corrections."""
        pairs, _, walls = self.counts
        for contacts, start, count in (
            (self.device.pairs, self.device.pair_dv_start, pairs),
            (self.device.walls, self.device.wall_dv_start, walls),
        ):
            records = contacts.numpy()
            records["dv"][:count] = start.numpy()[:count]
            contacts.assign(records)


def _write(array: wp.array, values: np.ndarray) -> None:
    """Write values to the beginning of a device array."""
    host = array.numpy()
    host[: len(values)] = values
    array.assign(host)
