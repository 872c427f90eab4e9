"""Engine: scenes of one method in memory, and the kernel that advances them."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import warp as wp

from warpgrains.errors import SimulationError
from warpgrains.kernels import batch as kernels
from warpgrains.kernels.launch import Launcher
from warpgrains.kernels.step import step
from warpgrains.kernels.threads import TeamRecord
from warpgrains.kernels.types import NOT_CONVERGED, NOT_FINITE, SOLVED, UNPROVED, WITHOUT_ROOM
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import Corrections, Lists, State
from warpgrains.solver import tuning
from warpgrains.solver.contact_list import ContactList
from warpgrains.solver.failures import not_converged, not_finite
from warpgrains.solver.infeasible import (
    InfeasibilityProof,
    find_infeasibility_proof,
    iterations_worth_a_search,
)
from warpgrains.solver.records import SceneRecords
from warpgrains.solver.statistics import RunStatistics, StepReport
from warpgrains.solver.threads import side_by_side, team_of

STEP = ("iterations", "zeta", "residual", "overlap", "active", "rebuilds", "redos")
SUMS = ("steps", "unconverged", "iterations", "iterations_max", "rebuilds", "redos", "residual", "overlap")
REFUSED = -1  # outcome of a step whose list finds no memory
CPU_BLOCK = 1  # threads in which Warp compiles a kernel for a CPU
VERLET = {
    "reach": "skin",
    "recent": "recent_deviation",
    "built_position": "reference_position",
    "built_velocity": "reference_velocity",
}


class Engine:
    """Scenes of one method, their queue, and the launches that work it off.

    Parameters
    ----------
    scenes : sequence of Scene
        All of one method.
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
    left, outcome : ndarray
        Steps left, and what became of the last one, by scene.
    """

    def __init__(self, scenes: Sequence[Scene], device: wp.Device, team: int = 1):
        self.scenes, self._device, self._team = scenes, device, team
        self._records = SceneRecords(scenes, team, device)
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
        self._refused: dict[int, str] = {}
        self._works: list[Callable[[], None]] = []
        self._graphs: dict[int, wp.Graph] = {}

    @property
    def kernel(self) -> wp.Kernel:
        """The kernel that advances the scenes on a CPU."""
        return kernels.kernel(self.scenes[0].method, self._records.sizes.has_strips)

    @property
    def is_compiled(self) -> bool:
        """Whether the kernels have been compiled for this machine before."""
        if self._device.is_cuda:
            return True
        cached = Path(wp.config.kernel_cache_dir) / self.kernel.module.get_module_identifier(CPU_BLOCK)
        return cached.is_dir()

    def load(self, k: int, state: State) -> None:
        """Continue scene k from a state."""
        scene, contacts, lists = self.scenes[k], ContactList(self._records, k), state.lists
        corrections = state.corrections
        if lists is None:
            wall = np.flatnonzero(corrections.wall_correction).astype(np.int32)
            contacts.load(corrections.pair, wall, corrections)
        else:
            contacts.load(lists.pair, lists.wall, corrections)
        for name, values in (("radius", scene.radius), ("mass", scene.mass), ("velocity", state.velocity)):
            self._array(k, f"grains.{name}")[:] = values
        for name in ("position", "last_position"):
            self._array(k, f"grains.{name}")[:] = state.position
        self._records.host["control"][k] = 0
        self._records.host["control"]["unordered"][k] = lists is not None
        self._records.host["statistics"][k] = 0
        self._steps[k] = state.steps
        numbers = self._records.verlet_numbers(k)
        if lists is None:
            self._array(k, "verlet.skin")[:] = -1.0
            self._array(k, "verlet.recent_deviation")[:] = 0.0
            numbers[:] = 0.0
            self._records.host["verlet"]["numbers"]["base_skin"][k] = tuning.first_skin(scene)
        else:
            for name, own in VERLET.items():
                self._array(k, f"verlet.{own}")[:] = getattr(lists, name)
            numbers[:] = np.concatenate([lists.frame.ravel(), lists.scalar])
        self._records.push(k)

    def _array(self, k: int, name: str) -> np.ndarray:
        return self._records.array(k, name)

    def state(self, k: int) -> State:
        """Return the exact state of scene k."""
        self._records.pull(k)
        contacts, numbers = ContactList(self._records, k), self._records.verlet_numbers(k).copy()
        verlet = {name: self._array(k, f"verlet.{own}").copy() for name, own in VERLET.items()}
        frame, scalar = numbers[:6].reshape(3, 2), numbers[6:]
        lists = Lists(contacts.listed_pairs(), contacts.listed_walls(), **verlet, frame=frame, scalar=scalar)
        position, velocity = self.grains(k, "position"), self.grains(k, "velocity")
        return State(self._steps[k].item(), position, velocity, contacts.corrections(), lists)

    def grains(self, k: int, name: str) -> np.ndarray:
        """Return an array of the grains of scene k, such as "position"; a copy."""
        self._records.pull(k)
        return self._array(k, f"grains.{name}").copy()

    def corrections(self, k: int) -> Corrections:
        """Return what the contacts of scene k carry after its last good step."""
        self._records.pull(k)
        return ContactList(self._records, k).corrections()

    def steps(self, k: int) -> int:
        """Return the steps that scene k has done since its start."""
        return self._steps[k].item()

    def submit(self, k: int, steps: int) -> None:
        """Ask for so many steps of scene k, and start counting anew."""
        self.left[k] = self._asked[k] = steps
        self.outcome[k] = SOLVED
        self._seconds[k] = 0.0
        statistics = self._records.host["statistics"]
        to_search = statistics["to_search"][k].item()
        statistics[k] = 0
        statistics["to_search"][k] = to_search
        self._proofs[k] = []
        self._errors.pop(k, None)

    def works(self, threads: int) -> list[Callable[[], None]]:
        """Return the work of each of so many threads: it advances scenes until there is no other free."""
        if not self._device.is_cpu:
            return [self._work_on_gpu]
        missing = threads - len(self._works)
        if missing > 0:
            self.kernel.module.load(self._device, CPU_BLOCK)
            shared = self._team > 1
            teams = team_of(self._team) if shared else [team_of(1)[0] for _ in range(missing)]
            self._works += [self._work_of(team) for team in teams]
        return self._works[:threads]

    def _work_of(self, team: TeamRecord) -> Callable[[], None]:
        """Return the work of one thread."""
        inputs = (self._records.device, self._queue, team)
        return wp.launch(self.kernel, dim=1, inputs=inputs, device="cpu", record_cmd=True).launch

    def _work_on_gpu(self) -> None:
        """Take the steps of all scenes, one after the other."""
        for k in range(len(self.scenes)):
            self._records.push(k)
            while self.left[k] > 0 and self.outcome[k] == SOLVED and not self._halt[0]:
                wp.capture_launch(self._graph(k))
                self._records.pull(k)
                record = self._records.host[k]
                self.left[k] -= record["control"]["accepted"]
                self.outcome[k] = record["step"]["outcome"]

    def _graph(self, k: int) -> wp.Graph:
        """Return the graph of a step of scene k."""
        if k not in self._graphs:
            method = self.scenes[k].method
            launcher = Launcher(wp.get_module(f"warpgrains.kernels_gpu_{method}"), self._records.device, k)
            with wp.ScopedCapture(device=self._device) as capture:
                launcher(step(method))
            self._graphs[k] = capture.graph
        return self._graphs[k]

    def halt(self) -> None:
        """Let the threads begin no other step."""
        self._halt[0] = 1

    def service(self) -> bool:
        """Do what scenes wait for; return whether one of them can go on."""
        waiting = self._grow() + np.flatnonzero(self.outcome == UNPROVED).tolist()
        for k in waiting:
            if self.outcome[k] == UNPROVED:
                self._look_for_proof(k)
            self.outcome[k] = SOLVED
        return bool((self.left[waiting] > 0).any())

    def _grow(self) -> list[int]:
        """Make room where a list needs it; return for which scenes."""
        grown = []
        for k in np.flatnonzero(self.outcome == WITHOUT_ROOM).tolist():
            try:
                self._records.make_room(k, int(self._array(k, "neighbors.total")[0]))
            except SimulationError as error:
                self._refused[k], self.outcome[k] = str(error), REFUSED
            else:
                grown.append(k)
        return grown

    def _find_proof(self, k: int, position: str, velocity: str) -> InfeasibilityProof | None:
        """Look for a proof that the step of scene k, from these positions, has no solution."""
        corrections = ContactList(self._records, k).corrections()
        where, how = self._array(k, f"grains.{position}"), self._array(k, f"grains.{velocity}")
        return find_infeasibility_proof(self.scenes[k], where, how, corrections)

    def _look_for_proof(self, k: int) -> None:
        """Name the grains that cannot fit after an unconverged step."""
        proof = self._find_proof(k, "last_position", "velocity")
        wait = 0 if proof else iterations_worth_a_search(self.scenes[k].n)
        self._records.host["statistics"]["to_search"][k] = wait
        if proof:
            self._proofs[k].append((self._done(k), proof.grains))

    def _done(self, k: int) -> int:
        """Steps of scene k since its start."""
        return int(self._steps[k] + self._asked[k] - self.left[k])

    def finish_open_steps(self) -> None:
        """Bring every scene between two steps, count the steps done, and say what failed."""
        self._halt[0] = 0
        try:
            self._solve_open_steps()
        finally:
            self._steps += self._asked - self.left
            self._asked[:] = self.left
            for k in np.flatnonzero(np.isin(self.outcome, (NOT_FINITE, NOT_CONVERGED, REFUSED))).tolist():
                step, time = self._steps[k] + 1, self._steps[k].item() * self.scenes[k].dt
                self._errors[k] = f"step {step}, from t = {time} s: {self._reason(k)}"

    def _solve_open_steps(self) -> None:
        """Solve to their ends the steps amid which lists are to grow."""
        while amid := self._grow():
            left = self.left.copy()
            self.left[:] = 0
            self.left[amid], self.outcome[amid] = 1, SOLVED
            self._work_once()
            left[amid] += self.left[amid] - 1
            self.left[:] = left

    def _work_once(self) -> None:
        """Advance scenes on the thread that calls, or on its whole team."""
        works = self.works(self._team)
        if len(works) == 1:
            works[0]()
        else:
            side_by_side(works, lambda: None, lambda: None)

    def _reason(self, k: int) -> str:
        """Say why the step of scene k failed; what it did to the corrections is taken back."""
        self._records.pull(k)
        record, scene = self._records.host[k], self.scenes[k]
        if self.outcome[k] == NOT_FINITE:
            grain = int(record["verlet"]["flags"]["bad_grain"])
            reason = not_finite(grain, self._array(k, "grains.next_velocity")[grain].tolist())
        elif self.outcome[k] == REFUSED:
            reason = self._refused.pop(k)
            self._records.host["control"][k] = 0
            self._array(k, "verlet.skin")[:] = -1.0  # the list that it has is not the one that it needs
        else:
            proof = self._find_proof(k, "position", "next_velocity")
            step = record["step"]
            iterations, zeta, residual = (step[name].item() for name in ("iterations", "zeta", "residual"))
            reason = not_converged(scene, iterations, zeta, residual, proof)
        ContactList(self._records, k).revert()
        self._records.push(k)
        return reason

    def report(self, k: int) -> StepReport:
        """Return what the last step of scene k did."""
        self._records.pull(k)
        scene, contacts = self.scenes[k], ContactList(self._records, k)
        step = {name: self._records.host["step"][name][k].item() for name in STEP}
        error = step["residual"] if scene.stops_on_residual else step["zeta"]
        return StepReport(
            iterations=step["iterations"],
            zeta=step["zeta"],
            residual=step["residual"],
            gap_error=_gap_error(scene, step["residual"]),
            converged=error <= scene.tolerance,
            infeasible=dict(self._proofs[k]).get(self._done(k), ()),
            contacts=step["active"],
            candidates=contacts.pairs + contacts.walls,
            overlap=step["overlap"],
            rebuilds=step["rebuilds"],
            redos=step["redos"],
        )

    def statistics(self, k: int) -> RunStatistics:
        """Return what scene k has done since it was asked."""
        self._records.pull(k)
        total = {name: self._records.host["statistics"][name][k].item() for name in SUMS}
        return RunStatistics(
            **total,
            infeasible=len(self._proofs[k]),
            infeasible_grains=self._proofs[k][0][1] if self._proofs[k] else (),
            gap_error=_gap_error(self.scenes[k], total["residual"]),
            seconds=self._seconds[k].item(),
        )

    def infeasible_steps(self, k: int) -> list[tuple[int, tuple[int, ...]]]:
        """Return the steps of scene k since it was asked that have no solution, and the grains that cannot fit."""
        return list(self._proofs[k])

    def error(self, k: int) -> str | None:
        """Return why scene k stopped before its end, if it did."""
        return self._errors.get(k)


def _gap_error(scene: Scene, residual: float) -> float:
    """Return dt * residual in smallest radii."""
    return scene.dt * residual / tuning.smallest_radius(scene)
