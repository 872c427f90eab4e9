"""Many scenes of one kind in memory, as the kernels of a batch see them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import warp as wp

from warpgrains.kernels import batch as kernels
from warpgrains.kernels.data import BAD_GRAIN, ITERATIONS, SLACK, ZETA
from warpgrains.kernels.record import REBUILDS, REDOS, TO_SEARCH
from warpgrains.kernels.step import NOT_CONVERGED, NOT_FINITE, SOLVED, WITHOUT_ROOM
from warpgrains.kernels.tally import (
    ALL_REBUILDS,
    ALL_REDOS,
    MOST,
    STEPS,
    SUM,
    UNCONVERGED,
    WORST_OVERLAP,
    WORST_RESIDUAL,
)
from warpgrains.kernels.variant import Variant
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import Lists, State
from warpgrains.solver import tuning as scales
from warpgrains.solver.failures import not_converged, not_finite
from warpgrains.solver.host_list import HostList
from warpgrains.solver.infeasible import find_infeasibility_proof, iterations_worth_a_search
from warpgrains.solver.launch import CAPTURING
from warpgrains.solver.scene_records import SceneRecords
from warpgrains.solver.statistics import RunStatistics, StepReport
from warpgrains.solver.step_report import gap_error, read_step_report

PLACES = {
    "start": "rows.start",
    "neighbor": "rows.neighbor",
    "old_start": "workspace.old_rows.start",
    "old_neighbor": "workspace.old_rows.neighbor",
    "slot": "workspace.slot",
    "pair_dv": "contacts.pair_dv",
    "pair_dv_start": "contacts.pair_dv_start",
    "walls": "contacts.walls",
    "wall_dv_start": "contacts.wall_dv_start",
    "count": "contacts.count",
    "old_pair_dv": "workspace.old_pair_dv",
}


class ScenePool:
    """Scenes of one kind, their queue, and the launch of one thread that works it off.

    Parameters
    ----------
    scenes : sequence of Scene
    variant : Variant
        What the kernels of all of them are compiled for.

    Attributes
    ----------
    left, outcome : ndarray
        Steps left, and what became of the last one, by scene.
    """

    def __init__(self, scenes: Sequence[Scene], variant: Variant):
        self.scenes, self._records = scenes, SceneRecords(scenes, variant)
        self._array = self._records.array
        self._kernels = kernels.kernels(variant)
        count = len(scenes)
        self._queue = kernels.Queue()
        self._queue.cursor = wp.zeros(1, dtype=wp.int64, device="cpu")
        for name in ("taken", "left", "outcome"):
            setattr(self._queue, name, wp.zeros(count, dtype=wp.int32, device="cpu"))
        self._queue.seconds = wp.zeros(count, dtype=wp.float64, device="cpu")
        self._queue.halt = wp.zeros(1, dtype=wp.int32, device="cpu")
        self.left, self.outcome = self._queue.left.numpy(), self._queue.outcome.numpy()
        self._seconds, self._halt = self._queue.seconds.numpy(), self._queue.halt.numpy()
        self._steps = np.zeros(count, np.int64)
        self._asked = np.zeros(count, np.int64)
        self._proofs: list[list[tuple[int, tuple[int, ...]]]] = [[] for _ in scenes]
        self._errors: dict[int, str] = {}

    def _list(self, k: int) -> HostList:
        return HostList(**{name: self._array(k, place) for name, place in PLACES.items()})

    def load(self, k: int, state: State) -> None:
        """Continue scene k from a state."""
        corrections, lists = state.corrections, state.lists
        if lists is None:
            pair, wall = corrections.pair, np.flatnonzero(corrections.wall_correction).astype(np.int32)
        else:
            pair, wall = lists.pair, lists.wall
        self._records.make_room(k, len(pair))
        scene = self.scenes[k]
        for name in ("grains.radius", "grains.mass"):
            array = self._array(k, name)
            array[:] = getattr(scene, name.split(".")[1])[: len(array)]
        self._array(k, "grains.position")[:] = self._array(k, "grains.last_position")[:] = state.position
        self._array(k, "grains.velocity")[:] = state.velocity
        self._list(k).load(pair, wall, corrections)
        self._array(k, "flag")[:] = 0
        self._steps[k] = state.steps
        if lists is None:
            self._array(k, "watch.reach")[:] = -1.0
            self._array(k, "watch.recent")[:] = 0.0
            scalar = self._array(k, "watch.scalar")
            scalar[:] = 0.0
            scalar[SLACK] = scales.first_slack(scene)
            return
        wp.launch(self._kernels.order_list, dim=1, inputs=(self._records.device, k), device="cpu")
        for name in Lists.WATCHED:
            self._array(k, f"watch.{name}")[:] = getattr(lists, name)

    def state(self, k: int) -> State:
        """Return the exact state of scene k."""
        contacts = self._list(k)
        watch = {name: self._array(k, f"watch.{name}").copy() for name in Lists.WATCHED}
        lists = Lists(contacts.listed_pairs(), contacts.listed_walls(), **watch)
        position, velocity = self._array(k, "grains.position"), self._array(k, "grains.velocity")
        steps = self._steps[k].item()
        return State(steps, position.copy(), velocity.copy(), contacts.corrections(), lists)

    def ask(self, k: int, steps: int) -> None:
        """Ask for so many steps of scene k, and start counting anew."""
        self.left[k] = self._asked[k] = steps
        self.outcome[k] = SOLVED
        self._seconds[k] = 0.0
        self._array(k, "tally")[:] = 0.0
        self._proofs[k] = []
        self._errors.pop(k, None)

    def launch(self) -> Callable[[], None]:
        """Return the work of one thread: it advances scenes until there is no other free."""
        with CAPTURING, wp.ScopedCapture(device="cpu") as capture:
            wp.launch(self._kernels.advance, dim=1, inputs=(self._records.device, self._queue), device="cpu")
        return partial(wp.capture_launch, capture.graph)

    def halt(self) -> None:
        """Let the threads begin no other turn."""
        self._halt[0] = 1

    def attend(self) -> bool:
        """Do what scenes wait for; return whether one of them can go on."""
        waiting = self._grow() + np.flatnonzero(self.outcome == kernels.UNPROVED).tolist()
        for k in waiting:
            if self.outcome[k] == kernels.UNPROVED:
                self._look_for_proof(k)
            self.outcome[k] = SOLVED
        return bool((self.left[waiting] > 0).any())

    def _grow(self) -> list[int]:
        """Make room where a list needs it; return for which scenes."""
        without = np.flatnonzero(self.outcome == WITHOUT_ROOM).tolist()
        for k in without:
            self._records.make_room(k, int(self._array(k, "rows.total")[0]))
        return without

    def _look_for_proof(self, k: int) -> None:
        """Name the grains that cannot fit after an unconverged step, as `Simulation` does."""
        position, velocity = self._array(k, "grains.last_position"), self._array(k, "grains.velocity")
        certificate = find_infeasibility_proof(
            self.scenes[k], position, velocity, self._list(k).corrections()
        )
        wait = 0 if certificate else iterations_worth_a_search(self.scenes[k].n)
        self._array(k, "flag")[TO_SEARCH] = wait
        if certificate:
            self._proofs[k].append((self._done(k), certificate.grains))

    def _done(self, k: int) -> int:
        """Steps of scene k since its start."""
        return int(self._steps[k] + self._asked[k] - self.left[k])

    def settle(self) -> None:
        """Bring every scene between two steps, count the steps done, and say what failed."""
        self._halt[0] = 0
        try:
            self._finish_steps()
        finally:
            self._steps += self._asked - self.left
            self._asked[:] = self.left
            for k in np.flatnonzero(np.isin(self.outcome, (NOT_FINITE, NOT_CONVERGED))).tolist():
                step, time = self._steps[k] + 1, self._steps[k].item() * self.scenes[k].dt
                self._errors[k] = f"step {step}, from t = {time} s: {self._reason(k)}"

    def _finish_steps(self) -> None:
        """Solve to their ends the steps amid which lists are to grow."""
        while amid := self._grow():
            left = self.left.copy()
            self.left[:] = 0
            self.left[amid], self.outcome[amid] = 1, SOLVED
            self.launch()()
            left[amid] += self.left[amid] - 1
            self.left[:] = left

    def _reason(self, k: int) -> str:
        """Say why the step of scene k failed; what it did to the corrections is taken back."""
        velocity = self._array(k, "grains.next_velocity")
        if self.outcome[k] == NOT_FINITE:
            grain = int(self._array(k, "watch.flag")[BAD_GRAIN])
            return not_finite(grain, velocity[grain].tolist())
        scene, contacts, report = self.scenes[k], self._list(k), self._array(k, "progress.report")
        position, residual = self._array(k, "grains.position"), self._array(k, "progress.residual").item()
        certificate = find_infeasibility_proof(scene, position, velocity, contacts.corrections())
        contacts.revert()
        return not_converged(scene, int(report[ITERATIONS]), report[ZETA].item(), residual, certificate)

    def report(self, k: int) -> StepReport:
        """Return what the last step of scene k did."""
        scene, told, flag = self.scenes[k], self._array(k, "progress.report"), self._array(k, "flag")
        counts, smallest = self._array(k, "contacts.count").tolist(), scales.smallest_radius(scene)
        report = read_step_report(scene, smallest, told, counts, int(flag[REBUILDS]), int(flag[REDOS]))
        return replace(report, infeasible=dict(self._proofs[k]).get(self._done(k), ()))

    def tally(self, k: int) -> RunStatistics:
        """Return what scene k has done since it was asked."""
        sums, scene = self._array(k, "tally"), self.scenes[k]
        residual = sums[WORST_RESIDUAL].item()
        counts = sums.astype(np.int64).tolist()
        return RunStatistics(
            steps=counts[STEPS],
            iterations=counts[SUM],
            iterations_max=counts[MOST],
            unconverged=counts[UNCONVERGED],
            infeasible=len(self._proofs[k]),
            infeasible_grains=self._proofs[k][0][1] if self._proofs[k] else (),
            residual=residual,
            gap_error=gap_error(scene, scales.smallest_radius(scene), residual),
            overlap=sums[WORST_OVERLAP].item(),
            rebuilds=counts[ALL_REBUILDS],
            redos=counts[ALL_REDOS],
            seconds=self._seconds[k].item(),
        )

    def error(self, k: int) -> str | None:
        """Return why scene k stopped before its end, if it did."""
        return self._errors.get(k)
