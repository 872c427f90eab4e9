"""The list of candidate contacts, in sweeping order: built anew when the watch asks for it."""

import numpy as np
import warp as wp

from warpgrains.kernels import carry, data, detect, order, reach
from warpgrains.kernels.data import WALLS, Contacts, Grains, Progress, Watch
from warpgrains.kernels.momentum import Momentum
from warpgrains.kernels.variant import Variant
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import Corrections, Lists
from warpgrains.solver import tuning as scales
from warpgrains.solver.buffers import ContactBuffers
from warpgrains.solver.launch import CAPTURING, Replay, reader
from warpgrains.solver.neighbors import NeighborSearch
from warpgrains.solver.strips import Lanes

WINDOW = {"sequential": 32768, "color": 1024}  # pairs interleaved: many hide latency, few fit in cache


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
    momentum : Momentum
        What the accelerated method keeps.
    variant : Variant
        What the scene's kernels are compiled for.
    replay : Replay
        Launches the kernels.
    """

    def __init__(
        self,
        scene: Scene,
        grains: Grains,
        watch: Watch,
        progress: Progress,
        momentum: Momentum,
        variant: Variant,
        replay: Replay,
    ):
        self._scene, self._grains = scene, grains
        self._watch, self._progress, self._replay = watch, progress, replay
        self._detect, self._order = detect.kernels(variant), order.kernels(variant)
        self._carry, self._reach = carry.kernels(variant), reach.kernels(variant)
        self._buffers = ContactBuffers(scene.n, variant, momentum, replay)
        cell_size = scales.cell_size(scene)
        self._search = NeighborSearch(grains, watch, self._buffers.rows, variant, replay, cell_size)
        self._in_line = not replay.by_group and not variant.accelerated
        self._lanes = (
            Lanes(self._buffers, variant, replay) if self._in_line and replay.launchers > 1 else None
        )
        self._influence = wp.zeros(scene.n, dtype=wp.float64, device=replay.device)
        self._next_level = wp.zeros(scene.n, dtype=wp.int32, device=replay.device)
        self._used_colors = wp.zeros(scene.n, dtype=wp.uint64, device=replay.device)
        self._lost = wp.zeros(1, dtype=wp.int32, device=replay.device)
        self._read_lost = reader(self._lost)

    @property
    def device(self) -> Contacts:
        """The list on its device."""
        return self._buffers.contacts

    @property
    def counts(self) -> tuple[int, int, int]:
        """Candidate pairs, groups that they are swept in, and grains that may reach a wall."""
        return self._buffers.counts

    @property
    def groups(self) -> int:
        """Groups of pairs that are swept one after the other."""
        return self._buffers.counts[1]

    def rebuild(self) -> None:
        """List every pair and wall within reach, with the corrections that they carry."""
        with CAPTURING:
            self._rebuild()

    def _rebuild(self) -> None:
        self._replay.alone(self._set_old_aside)
        self._replay.alone(self._renew_reaches)
        while True:
            self._replay.alone(self._search.find)
            if self._buffers.reserve(self._search.total):
                self._replay.alone(self._search.find)
            self._replay.alone(self._sort)
            if not self._read_lost()[0]:
                break
        self._put_in_order()
        self._replay.alone(self._list_walls)
        if self._lanes is not None:
            self._lanes.deal_walls()

    def _set_old_aside(self) -> None:
        """Keep the pairs and corrections of the old list."""
        each, n, buffers = self._replay.each, self._scene.n, self._buffers
        each(self._carry.save_pairs, n, buffers.rows, buffers.slot, buffers.contacts, buffers.old_pair_dv)
        wp.copy(buffers.old_rows.start, buffers.rows.start)
        wp.copy(buffers.old_rows.neighbor, buffers.rows.neighbor)
        buffers.wall_dv.zero_()
        each(self._detect.save_walls, n, buffers.contacts, buffers.wall_dv)

    def _renew_reaches(self) -> None:
        """Choose what the new list must reach."""
        each, scene, watch, kernels = self._replay.each, self._scene, self._watch, self._reach
        each(kernels.adapt_slack, 1, watch, self._progress, scales.smallest_radius(scene), scene.dt)
        each(kernels.renew, scene.n, self._grains, watch, self._progress, scene.dt)
        each(kernels.clear, 1, watch)
        each(kernels.find_mean, scene.n, watch)
        each(kernels.find_spread, scene.n, watch)
        each(kernels.find_horizon, 1, watch, scales.room(scene), scales.acceleration(scene), scene.dt)

    def _sort(self) -> None:
        """Sort the pairs; where one that carries a correction is not among them, widen its reach."""
        self._search.sort()
        self._lost.zero_()
        buffers = self._buffers
        old = (buffers.old_rows, buffers.old_pair_dv)
        self._replay.each(
            self._carry.hold_pairs, self._scene.n, self._grains, self._watch, *old, buffers.rows, self._lost
        )

    def _put_in_order(self) -> None:
        """Put the pairs in sweeping order; where every group is a launch, more of them need a new graph."""
        groups = self.groups
        self._replay.alone(self._arrange)
        if self._lanes is not None:
            self._lanes.deal(self._grains.position.numpy())
        self._replay.alone(self._fill)
        if self._replay.by_group and self.groups > groups:
            self._replay.forget()

    def _arrange(self) -> None:
        """Give every pair its slot in the common order."""
        each, buffers, kernels = self._replay.each, self._buffers, self._order
        rows, group, slot, sequence = buffers.rows, buffers.group, buffers.slot, buffers.sequence
        if self._scene.order == "color":
            each(kernels.colors, 1, rows, self._used_colors, group)
        else:
            each(kernels.levels, 1, rows, self._next_level, group)
        each(kernels.place, 1, rows, group, int(self._in_line), buffers.contacts, slot)
        if self._in_line:
            each(kernels.line_up, self._scene.n, rows, slot, sequence)
            window = WINDOW[self._scene.order]
            each(kernels.windows, 1, buffers.contacts, sequence, window, self._next_level, group, slot)
            each(kernels.line_up, self._scene.n, rows, slot, sequence)

    def _fill(self) -> None:
        """Write every pair in its slot, with the correction that it carries."""
        each, n, buffers = self._replay.each, self._scene.n, self._buffers
        rows, contacts, slot = buffers.rows, buffers.contacts, buffers.slot
        old = (buffers.old_rows, buffers.old_pair_dv)
        each(self._carry.fill_slots, n, self._grains, *old, rows, slot, contacts)
        self._influence.zero_()
        each(self._carry.weigh, n, rows, slot, contacts, self._influence)
        each(self._carry.find_influence, n, self._influence, self._watch)

    def _list_walls(self) -> None:
        """List the grains that may reach a wall, with the corrections that they carry."""
        scene, buffers = self._scene, self._buffers
        buffers.contacts.count[WALLS:].zero_()
        walls = (self._watch, scene.radius_in, scene.radius_out, buffers.wall_dv)
        self._replay.each(self._detect.find_walls, scene.n, self._grains, buffers.contacts, *walls)

    def corrections(self) -> Corrections:
        """Return what the contacts carry after the last good step."""
        return self._buffers.host().corrections()

    def revert(self) -> None:
        """Take back what an unfinished step did to the corrections."""
        self._buffers.revert()

    def lists(self) -> Lists:
        """Return what is listed, and what the watch has seen of it."""
        watch = {name: getattr(self._watch, name).numpy().copy() for name in Lists.WATCHED}
        host = self._buffers.host()
        return Lists(host.listed_pairs(), host.listed_walls(), **watch)

    def load(self, corrections: Corrections, lists: Lists | None) -> None:
        """List what was listed; or, if that is not known, let the watch ask for a new list."""
        if lists is None:
            walls = np.flatnonzero(corrections.wall_correction).astype(np.int32)
            self._buffers.load(corrections.pair, walls, corrections)
            self._watch.reach.fill_(-1.0)
            self._watch.recent.zero_()
            scalar = np.zeros(self._watch.scalar.shape)
            scalar[data.SLACK] = scales.first_slack(self._scene)
            self._watch.scalar.assign(scalar)
            return
        self._buffers.load(lists.pair, lists.wall, corrections)
        self._put_in_order()
        if self._lanes is not None:
            self._lanes.deal_walls()
        for name in Lists.WATCHED:
            getattr(self._watch, name).assign(getattr(lists, name))
