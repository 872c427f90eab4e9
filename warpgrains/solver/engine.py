"""Engine: scenes of one kind in memory, and the launches that advance them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from warpgrains.arrays import IndexArray
from warpgrains.errors import SimulationError
from warpgrains.kernels import advance as kernels
from warpgrains.kernels.access import CHECKED
from warpgrains.kernels.gpu import Launcher
from warpgrains.kernels.record import (
    BEYOND_WALL,
    HALTED,
    NOT_CONVERGED,
    NOT_FINITE,
    SLOW,
    SOLVED,
    UNPROVED,
    WITHOUT_ROOM,
    Phase,
)
from warpgrains.kernels.stages import OPTIONS
from warpgrains.kernels.step import fused_step, step
from warpgrains.scene.state import Corrections, State, first_state
from warpgrains.solver import tuning
from warpgrains.solver.crew import Crew
from warpgrains.solver.ends import Ends
from warpgrains.solver.records import SceneRecords
from warpgrains.solver.scene_memory import SceneMemory
from warpgrains.solver.service import REFUSED, Service
from warpgrains.solver.statistics import RunStatistics, StepReport
from warpgrains.solver.threads import side_by_side
from warpgrains.turns import BUILDING

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

CPU_BLOCK = 1  # threads in which Warp compiles a kernel for a CPU
BRIEF = 2e7  # iterations of grains: some tenths of a second
FAILURES = (NOT_FINITE, BEYOND_WALL, NOT_CONVERGED, REFUSED)


class Engine:
    """Scenes of one kind, their queue, and the launches that work it off.

    Parameters
    ----------
    scenes : sequence of Scene
        All of one `Scene.kernel_kind`.
    device : wp.Device
    team : int
        Threads that share a scene on a CPU.

    Raises
    ------
    SimulationError
        They do not fit in memory.

    Attributes
    ----------
    scenes : sequence of Scene
    left, outcome, seconds : ndarray
        Steps left, what became of the last one, and what they took in all [s], by scene.
    """

    def __init__(self, scenes: Sequence[Scene], device: wp.Device, team: int = 1):
        self.scenes, self._device, self._team = scenes, device, team
        self._records = SceneRecords(scenes, team, device)
        self._memory = [SceneMemory(self._records, k, scene) for k, scene in enumerate(scenes)]
        self._service = Service(scenes, self._records, self._memory)
        count = len(scenes)
        self._queue = kernels.Queue()
        self._queue.cursor = wp.zeros(1, dtype=wp.int64, device="cpu")
        for name in ("taken", "left", "outcome"):
            setattr(self._queue, name, wp.zeros(count, dtype=wp.int32, device="cpu"))
        self._queue.seconds = wp.zeros(count, dtype=wp.float64, device="cpu")
        self._queue.halt = wp.zeros(1, dtype=wp.int32, device="cpu")
        self.left, self.outcome = self._queue.left.numpy(), self._queue.outcome.numpy()
        self.seconds, self._halt = self._queue.seconds.numpy(), self._queue.halt.numpy()
        self._steps, self._submitted = np.zeros(count, np.int64), np.zeros(count, np.int64)
        self._most = np.array([float(scene.n * scene.max_iterations) for scene in scenes])
        self._works: list[Callable[[], None]] = []
        self._crew = Crew(team, *tuning.crew(scenes[0], team))
        self._graphs: dict[int, wp.Graph] = {}

    @property
    def kernel(self) -> wp.Kernel:
        """The kernel that advances the scenes on a CPU."""
        kind, dealt = self.scenes[0].kernel_kind, self._records.sizes.is_dealt
        with BUILDING:
            return kernels.kernel(_module_name(*kind, "dealt" * dealt), fused_step(kind, dealt))

    @property
    def is_compiled(self) -> bool:
        """Whether the kernels have been compiled before; of a GPU this is not told."""
        if self._device.is_cuda:
            return True
        with BUILDING:
            cached = self.kernel.module.get_module_identifier(CPU_BLOCK)
        return (Path(wp.config.kernel_cache_dir) / cached).is_dir()

    def load_kernels(self) -> None:
        """Compile the kernels, or load what was compiled before."""
        if self._device.is_cpu:
            with BUILDING:
                self.kernel.module.load(self._device, CPU_BLOCK)

    def begin(self) -> None:
        """Begin all scenes at their starts, in memory that is new."""
        if self._records.begin():
            return
        for k, scene in enumerate(self.scenes):
            self.load(k, first_state(scene))

    def load(self, k: int, state: State) -> None:
        """Continue scene k from a state."""
        self._memory[k].load(state)
        self._steps[k] = state.steps
        self._records.push(k)

    def _pulled(self, k: int) -> SceneMemory:
        """Return scene k as the device has left it."""
        self._records.pull(k)
        return self._memory[k]

    def state(self, k: int) -> State:
        """Return the exact state of scene k."""
        return self._pulled(k).state(self.steps(k))

    def steps(self, k: int) -> int:
        """Return the steps that scene k has done since its start."""
        return self._steps[k].item()

    def grains(self, k: int, name: str) -> np.ndarray[Any, Any]:
        """Return an array of the grains of scene k, such as "position"; a copy."""
        return self._pulled(k).array(f"grains.{name}").copy()

    def last_staggered(self, k: int) -> bool:
        """Return whether the velocities of scene k were half a step behind before its last good step."""
        return self._pulled(k).moment("last_staggered")

    def ends(self, which: IndexArray) -> Ends:
        """Return what some scenes of as many grains have come to since they were submitted; on a CPU."""
        ends = Ends.of(self._records, which)
        return ends._replace(done={**ends.done, "seconds": self.seconds[which]})

    def corrections(self, k: int) -> Corrections:
        """Return what the contacts of scene k carry after its last good step."""
        return self._pulled(k).corrections()

    def keep_history(self, k: int, keep: bool) -> None:
        """Let reports of scene k have a history, or none; see `SceneRecords.keep_history`."""
        self._records.keep_history(k, self.scenes[k].max_iterations if keep else 0)

    def submit(self, steps: Sequence[int]) -> None:
        """Ask for so many steps of each scene, and start counting anew."""
        self.left[:] = self._submitted[:] = steps
        self.outcome[:] = SOLVED
        self.seconds[:] = 0.0
        self._records.host["statistics"] = 0
        self._service.forget()

    def works(self, threads: int) -> list[Callable[[], None]]:
        """Return the work of each of so many threads: it advances scenes until there is no other free.

        Of a team there are as many as are worth while now.
        """
        if self._device.is_cuda:
            return [self._work_on_gpu]
        if self._team > 1:
            threads = self._crew.threads_of_next_launch()
        begun = len(self._works)
        if threads > begun:
            self.load_kernels()
            teams = self._crew.members if self._team > 1 else [Crew(1).members[0] for _ in range(threads)]
            for team in teams[begun:threads]:
                inputs = (self._records.device, self._queue, team)
                with BUILDING:
                    command = wp.launch(self.kernel, dim=1, inputs=inputs, device="cpu", record_cmd=True)
                self._works.append(command.launch)
        return self._works[:threads]

    def _work_on_gpu(self) -> None:
        """Take the steps of all scenes, one after the other."""
        for k in range(len(self.scenes)):
            self._records.push(k)
            while self.left[k] > 0 and self.outcome[k] == SOLVED and not self._halt[0]:
                with BUILDING:
                    graph = self._graph(k)
                wp.capture_launch(graph)
                self._records.pull(k)
                self.left[k] -= self._memory[k].record["control"]["phase"] == Phase.ACCEPTED
                self.outcome[k] = self._memory[k].record["step"]["outcome"]

    def _graph(self, k: int) -> wp.Graph:
        """Return the graph of a step of scene k on a GPU."""
        if k not in self._graphs:
            kind = self.scenes[k].kernel_kind
            stages = step(kind)
            module = wp.get_module(_module_name(*kind, "gpu"))
            wp.set_module_options(OPTIONS, module)
            launcher = Launcher(module, self._records.device, k, stages)
            with wp.ScopedCapture(device=self._device) as capture:
                launcher(stages)
            self._graphs[k] = capture.graph
        return self._graphs[k]

    @property
    def is_brief(self) -> bool:
        """Whether the steps left are done before anyone would want to interrupt them."""
        return bool(self.left @ self._most < BRIEF)

    def halt(self) -> None:
        """Let the threads give up the steps that they are at, and begin no other; a GPU ends its step."""
        self._halt[0] = 1
        self._records.host["control"]["halted"] = 1

    def service(self) -> bool:
        """Do what scenes wait for; return whether one of them can go on."""
        if not self.outcome.any():  # all are solved; a team ends its launch before it grows
            return bool(self.left.any() and not self._halt[0])
        unproved = np.flatnonzero(self.outcome == UNPROVED).tolist()
        for k in unproved:
            self._service.look_for_proof(k, self._done(k))
        slow = np.flatnonzero(self.outcome == SLOW).tolist()
        for k in slow:
            start = perf_counter()
            self._service.solve_exactly(k)
            self.seconds[k] += perf_counter() - start
        waiting = self._grow() + unproved + slow
        self.outcome[waiting] = SOLVED
        return bool((self.left[self.outcome == SOLVED] > 0).any() and not self._halt[0])

    def _grow(self) -> list[int]:
        """Make room where a list needs it; return for which scenes there is room now."""
        waiting = np.flatnonzero(self.outcome == WITHOUT_ROOM).tolist()
        grown = [k for k in waiting if self._service.make_room(k)]
        self.outcome[[k for k in waiting if k not in grown]] = REFUSED
        return grown

    def _done(self, k: int) -> int:
        """Steps of scene k since its start, those of the run under way included."""
        return int(self._steps[k] + self._submitted[k] - self.left[k])

    def finish_open_steps(self) -> None:
        """Bring every scene between two steps, count the steps done, and say what failed."""
        if CHECKED:
            self._raise_violation()
        if self._halt[0]:
            self._halt[0] = 0
            self._records.host["control"]["halted"] = 0
        if self.outcome.any():  # not all are solved
            self._solve_open_steps()
            for k in np.flatnonzero(np.isin(self.outcome, FAILURES)).tolist():
                self._service.explain(k, self.outcome[k], self._done(k))
            for k in np.flatnonzero(np.isin(self.outcome, (*FAILURES, HALTED, SLOW))).tolist():
                self._service.give_up(k)
        self._steps += self._submitted - self.left
        self._submitted[:] = self.left

    def _raise_violation(self) -> None:
        """Raise SimulationError if a kernel has used an index outside of its array."""
        for k in range(len(self.scenes)):
            violation = self._records.violation(k)
            if violation is not None:
                raise SimulationError(f"step {self._done(k) + 1}: {violation}: please report this scene")

    def _solve_open_steps(self) -> None:
        """Solve to their ends the steps amid which lists are to grow."""
        while amid := self._grow():
            left = self.left.copy()
            self.left[:] = 0
            self.left[amid], self.outcome[amid] = 1, SOLVED
            side_by_side(self.works(self._team))
            left[amid] += self.left[amid] - 1
            self.left[:] = left

    def report(self, k: int) -> StepReport:
        """Return what the last step of scene k did."""
        return self._pulled(k).report(dict(self._service.proofs[k]).get(self._done(k), ()))

    def statistics(self, k: int) -> RunStatistics:
        """Return what scene k has done since it was submitted."""
        statistics = self._pulled(k).statistics()
        statistics.infeasible = len(self._service.proofs[k])
        statistics.infeasible_grains = self._service.proofs[k][0][1] if self._service.proofs[k] else ()
        statistics.seconds = self.seconds[k].item()
        return statistics

    def infeasible_steps(self, k: int) -> list[tuple[int, tuple[int, ...]]]:
        """Return which steps since scene k was submitted have no solution, and the grains that cannot fit."""
        return list(self._service.proofs[k])

    def error(self, k: int) -> str | None:
        """Return why scene k stopped before its end, if it did."""
        return self._service.errors.get(k)


def _module_name(method: str, has_friction: bool, way: str) -> str:
    """Return the name of the module that holds the kernels of a kind, launched in one way."""
    parts = ["warpgrains.kernels", method.replace("-", "_"), "friction" * has_friction, way]
    return "_".join(filter(None, parts))
