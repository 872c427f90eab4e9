"""Engine: scenes of one kind in memory, and the launches that advance them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warpgrains.base import kernel_cache
from warpgrains.base.arrays import IndexArray
from warpgrains.base.checks import LARGEST_WHOLE_NUMBER
from warpgrains.base.errors import SimulationError
from warpgrains.base.turns import BUILDING
from warpgrains.kernels.access import CHECKED
from warpgrains.kernels.record import Outcome, Phase
from warpgrains.kernels.step import fused_step
from warpgrains.kernels.team import advance as advance_kernel
from warpgrains.kernels.team.threads import TeamRecord, team_records
from warpgrains.scene.snapshot import Snapshots
from warpgrains.solver import tuning
from warpgrains.solver.exact.solver import exact_solver
from warpgrains.solver.failures import failure
from warpgrains.solver.last_steps import LastSteps
from warpgrains.solver.loaded_scene import LoadedScene
from warpgrains.solver.loading import give_up_step, scene_with_walls
from warpgrains.solver.records import SceneRecords
from warpgrains.solver.sizes import Sizes, kind_of
from warpgrains.solver.threads import run_threads

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

CPU_BLOCK = 1  # block size for which Warp compiles CPU kernels
BRIEF = 2e7  # grains times iterations, some tenths of a second
MOVES = 10  # number of iterations that take as long as the rest of a step
FAILURES = (Outcome.NOT_FINITE, Outcome.TOO_FAR, Outcome.NOT_CONVERGED)


class Engine:
    """Scenes of one kind in memory, their queue, and the launches that process it.

    Scenes of one kind use the same kernels (`kind_of`). Raises SimulationError if the scenes do not fit in
    memory.

    Attributes
    ----------
    team : int
        Threads that share a scene on a CPU.
    records : SceneRecords
    scenes : list of LoadedScene
    left, seconds : ndarray
        Remaining steps, and wall time of the steps done [s], of every scene.
    last_steps : LastSteps
        Results of the steps since `submit`, in arrays that further steps change.
    is_brief : bool
        Whether the submitted steps take too little time for a user to interrupt them.
    """

    def __init__(self, scenes: Sequence[Scene], device: wp.Device, sizes: Sizes):
        count = len(scenes)
        self._device, self.team = device, sizes.team
        self._block = CPU_BLOCK if device.is_cpu else tuning.block_size(scenes)
        self.records = SceneRecords(scenes, sizes, device)
        self.scenes = [LoadedScene(self.records, k) for k in range(count)]
        solver = exact_solver(scenes[0].method)
        self._exact = [] if solver is None else [solver(self.records, k) for k in range(count)]
        self._queue = advance_kernel.Queue()
        for name, length, dtype in (
            ("cursor", 1, wp.int64),
            ("taken", count, wp.int32),
            ("left", count, wp.int32),
            ("outcome", count, wp.int32),
            ("seconds", count, wp.float64),
            ("cancel", 1, wp.int32),
            ("most_unconverged", 1, wp.int32),
        ):  # a GPU reads and writes pinned memory of the host
            array = wp.zeros(length, dtype=dtype, device="cpu", pinned=device.is_cuda)
            setattr(self._queue, name, array)
        self._queue.going_on = wp.zeros(count, dtype=wp.int32, device=device)
        self.left, self._outcome = self._queue.left.numpy(), self._queue.outcome.numpy()
        self.seconds, self._cancel = self._queue.seconds.numpy(), self._queue.cancel.numpy()
        self._most_unconverged = self._queue.most_unconverged.numpy()
        self._grains = self.records.sizes.grains
        self.is_brief = True
        self._tasks: list[Callable[[], None]] = []
        self._errors: dict[int, SimulationError] = {}
        host = self.records.host
        arrays = host["reported"], host["statistics"], host["contacts"]["count"], self.left, self.seconds
        self.last_steps = LastSteps(self.records.scenes, *arrays, self._errors)
        self._sums = host["statistics"].view(np.void)  # filled ten times as fast as by fields
        self._no_steps = np.zeros((), self._sums.dtype)

    @property
    def kernel(self) -> wp.Kernel:
        """The kernel that advances the scenes."""
        kind, on_gpu = kind_of(self.records.scenes[0]), self._device.is_cuda
        flags = [has[4:] for has, given in kind._asdict().items() if given is True] + ["gpu"] * on_gpu
        name = "_".join(["warpgrains.kernels", kind.method.replace("-", "_"), *flags])
        with BUILDING:
            return advance_kernel.kernel(name, fused_step(kind), on_gpu)

    @property
    def is_compiled(self) -> bool:
        """True if the compiled kernels are in the cache."""
        return kernel_cache.is_cached(self.kernel.module, self._block)

    def load_kernels(self) -> None:
        """Compile the kernels, or load them from the cache."""
        kernel_cache.load(self.kernel.module, self._device, self._block)

    def fits(self, k: int, scene: Scene) -> bool:
        """Return True if `loading.change_scene` can replace scene k by this scene in this engine."""
        same_kind = kind_of(scene) == kind_of(self.records.scenes[k])
        return scene.method != "exact" and same_kind and self.records.sizes.fits(k, scene)

    def snapshots(self, which: IndexArray) -> Snapshots:
        """Return the present states of the scenes with indices `which`.

        All these scenes must have the same numbers of grains and walls, and be in an engine on a CPU.
        """
        records, scenes = self.records, [scene_with_walls(self.records, k) for k in which.tolist()]
        dt = records.host["dt"][which]
        names = ("position", "velocity", *(("spin",) if records.sizes.friction else ()))
        arrays = {name: records.stacked(f"grains.{name}", which) for name in names}
        arrays.setdefault("spin", np.zeros(arrays["position"].shape[:2]))
        times = (records.host["start_time"][which] + records.host["steps"][which] * dt).tolist()
        return Snapshots(scenes=scenes, time=times, **arrays)

    def submit(self, steps: Sequence[int], most_unconverged: int = LARGEST_WHOLE_NUMBER) -> None:
        """Set the number of steps to do for each scene, and reset the statistics.

        Scenes stop early after `most_unconverged` steps that have not converged.
        """
        self.left[:], self._most_unconverged[:] = steps, most_unconverged
        iterations = self.records.host["stopping"]["max_iterations"]
        self.is_brief = float(self._grains @ iterations) * max(steps) < BRIEF
        self._outcome[:] = Outcome.SOLVED
        self.seconds[:] = 0.0
        self._sums.fill(self._no_steps)
        self._errors.clear()

    def work(self) -> float:
        """Estimate the remaining work, in grains times iterations, from the iterations of the last steps."""
        return float(self._grains * self.left @ (self.records.host["step"]["iterations"] + MOVES))

    def tasks(self, threads: int) -> list[Callable[[], None]]:
        """Return one task per CPU thread, or a single task for a GPU, which together do the submitted steps.

        There are `threads` tasks, each of which advances one scene of the queue after the other; but if a
        team shares each scene, there is one task for each of its `team` threads.
        """
        if self._device.is_cuda:
            return [self._work_on_gpu]
        count = self.team if self.team > 1 else threads
        begun = len(self._tasks)
        if count > begun:
            self.load_kernels()
            teams = team_records(count) if self.team > 1 else [team_records(1)[0] for _ in range(count)]
            for team in teams[begun:]:
                inputs = (self.records.device, self._queue, team)
                with BUILDING:
                    command = wp.launch(self.kernel, dim=1, inputs=inputs, device="cpu", record_cmd=True)
                self._tasks.append(command.launch)
        return self._tasks[:count]

    def _work_on_gpu(self) -> None:
        """Do the steps of all scenes.

        Records and blocks are copied to the GPU before, and back to the host afterwards.
        """
        self.load_kernels()
        team = TeamRecord()
        team.size = self._block
        self.records.push()
        try:
            inputs, threads = (self.records.device, self._queue, team), len(self.scenes) * self._block
            with BUILDING:
                wp.launch(self.kernel, threads, inputs, device=self._device, block_dim=self._block)
        finally:
            self.records.pull()

    def cancel(self, abandon: bool) -> None:
        """Start no further step. With `abandon`, a CPU also gives up the steps in progress.

        An abandoned step has changed the list, and the numbers from which the next list is made. In color
        order, later steps may therefore differ in the last bits from those of a run that was not cancelled.
        """
        self._cancel[0] = 1
        if abandon:
            self.records.host["control"]["cancelled"] = 1

    def service(self) -> bool:
        """Enlarge full lists, and solve slow steps on the host; return True if a scene can continue."""
        if not np.count_nonzero(self._outcome):  # all are solved
            return bool(np.count_nonzero(self.left) and not self._cancel[0])
        self._outcome[self._serve()] = Outcome.SOLVED
        return bool((self.left[self._outcome == Outcome.SOLVED] > 0).any() and not self._cancel[0])

    def _serve(self, solves_slow: bool = True) -> list[int]:
        """Serve the open requests of waiting scenes; return the indices of the scenes that can continue.

        A scene cannot continue if there is not enough memory for its list, or if its step is slow and
        `solves_slow` is False.
        """
        phase, served = self.records.host["control"]["phase"], []
        waiting = set(np.flatnonzero(self._outcome == Outcome.WAITING).tolist())
        for k in sorted(waiting - self._errors.keys()):
            if phase[k] == Phase.LIST_FULL:
                self._grow(k)
            elif phase[k] == Phase.SLOW and solves_slow:
                start = perf_counter()
                self._exact[k].solve()
                self.seconds[k] += perf_counter() - start
            if phase[k] == Phase.SEARCH or (phase[k] == Phase.ANSWERED and solves_slow):
                served.append(k)
        return served

    def _grow(self, k: int) -> None:
        """Enlarge the list of scene k, or store the error if there is not enough memory."""
        try:
            self.records.reserve_contacts(k, int(self.records.array(k, "neighbors.total")[0]))
        except SimulationError as error:
            self._errors[k] = error
        else:
            self.records.host["control"]["phase"][k] = Phase.SEARCH

    def finish_open_steps(self, has_failed: bool) -> None:
        """Finish or undo all open steps, and store the errors of failed scenes.

        Slow steps are undone after `cancel(abandon=True)`, or if an exception is being handled
        (`has_failed`).
        """
        if CHECKED:
            self._raise_violation()
        control = self.records.host["control"]
        undoes_slow = has_failed or bool(control["cancelled"].any())
        if self._cancel[0]:
            self._cancel[0] = 0
            control["cancelled"] = 0
        if np.count_nonzero(self.left):  # a step may not have continued since its request was served
            self._outcome[control["phase"] != Phase.ENDED] = Outcome.WAITING
        if np.count_nonzero(self._outcome):  # not all are solved
            self._continue_open_steps(undoes_slow)
            for k in np.flatnonzero(self._outcome).tolist():
                if k in self._errors or self._outcome[k] in FAILURES:
                    self._errors[k] = failure(self.records, k, self._outcome[k], self._errors.get(k))
                give_up_step(self.records, k)

    def _raise_violation(self) -> None:
        """Raise SimulationError if a kernel has used an index outside its array (checked mode)."""
        for k in range(len(self.scenes)):
            violation = self.records.violation(k)
            if violation is not None:
                step = self.scenes[k].steps + 1
                raise SimulationError(f"step {step}: {violation}: please report this defect with the scene")

    def _continue_open_steps(self, undoes_slow: bool) -> None:
        """Finish the open steps that wait for the host, and begin no further step.

        Slow steps stay open if `undoes_slow`, because the caller undoes them.
        """
        while amid := self._serve(solves_slow=not undoes_slow):
            left = self.left.copy()
            self.left[:] = 0
            self.left[amid], self._outcome[amid] = 1, Outcome.SOLVED
            run_threads(self.tasks(self.team))
            left[amid] += self.left[amid] - 1
            self.left[:] = left
