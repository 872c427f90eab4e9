"""Many scenes of one kind in memory, as the kernels of a batch see them."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warpgrains import scales
from warpgrains.host_list import HostList
from warpgrains.kernels import batch as kernels
from warpgrains.kernels.data import BAD_GRAIN, CARRYING, ITERATIONS, OVERLAP, RESIDUAL, SLACK, ZETA
from warpgrains.kernels.record import REBUILDS, REDOS
from warpgrains.kernels.step import FAILED, SOLVED, WITHOUT_ROOM
from warpgrains.kernels.variant import Variant
from warpgrains.reports import Lists, State, StepReport, Tally
from warpgrains.scene import Scene
from warpgrains.scene_records import SceneRecords

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
        self._crew = kernels.Crew()
        self._crew.workers = 1
        self._steps = np.zeros(count, np.int64)
        self._asked = np.zeros(count, np.int64)

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

    def launch(self) -> wp.Launch:
        """Return the launch of one thread: it advances scenes until there is no other free."""
        inputs = (self._crew, self._records.device, self._queue)
        return wp.launch(self._kernels.advance, dim=1, inputs=inputs, device="cpu", record_cmd=True)

    def halt(self) -> None:
        """Let the threads begin no other turn."""
        self._halt[0] = 1

    def grow(self) -> list[int]:
        """Make room where a list needs it; return for which scenes."""
        without = np.flatnonzero(self.outcome == WITHOUT_ROOM).tolist()
        for k in without:
            self._records.make_room(k, int(self._array(k, "rows.total")[0]))
            self.outcome[k] = SOLVED
        return without

    def settle(self) -> None:
        """Bring every scene between two steps, and count the steps done."""
        self._halt[0] = 0
        try:
            self._finish_steps()
        finally:
            self._steps += self._asked - self.left
            self._asked[:] = self.left

    def _finish_steps(self) -> None:
        """Solve to their ends the steps amid which lists are to grow."""
        while amid := self.grow():
            left = self.left.copy()
            self.left[:] = 0
            self.left[amid] = 1
            self.launch().launch()
            left[amid] += self.left[amid] - 1
            self.left[:] = left

    def report(self, k: int) -> StepReport:
        """Return what the last step of scene k did."""
        report, scene = self._array(k, "progress.report"), self.scenes[k]
        flag = self._array(k, "flag")
        pairs, _, walls = self._array(k, "contacts.count").tolist()
        zeta, error = report[ZETA].item(), report[RESIDUAL].item()
        return StepReport(
            iterations=int(report[ITERATIONS]),
            zeta=zeta,
            residual=error,
            converged=(error if scene.stops_on_residual else zeta) <= scene.tolerance,
            contacts=int(report[CARRYING]),
            candidates=pairs + walls,
            overlap=report[OVERLAP].item(),
            rebuilds=int(flag[REBUILDS]),
            redos=int(flag[REDOS]),
        )

    def tally(self, k: int) -> Tally:
        """Return what scene k has done since it was asked."""
        steps, iterations, most, unconverged, overlap, rebuilds, redos = self._array(k, "tally").tolist()
        return Tally(
            steps=int(steps),
            iterations=int(iterations),
            iterations_max=int(most),
            unconverged=int(unconverged),
            overlap=overlap,
            rebuilds=int(rebuilds),
            redos=int(redos),
            seconds=self._seconds[k].item(),
        )

    def error(self, k: int) -> str | None:
        """Return why scene k stopped before its end, if it did."""
        if self.outcome[k] != FAILED:
            return None
        grain, step = int(self._array(k, "watch.flag")[BAD_GRAIN]), self._steps[k].item()
        velocity, time = self._array(k, "grains.next_velocity")[grain].tolist(), step * self.scenes[k].dt
        return f"step {step + 1}, from t = {time} s: grain {grain} reached a velocity of {velocity} m/s"
