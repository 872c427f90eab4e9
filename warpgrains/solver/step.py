"""StepSolver: one time step, solved exactly for a list of contacts that proves itself complete."""

from dataclasses import replace

import numpy as np
import warp as wp

from warpgrains.errors import SimulationError
from warpgrains.kernels import iterate, iteration, measure, momentum, motion, residual, sweep, watch
from warpgrains.kernels.data import ACCEPTED, BAD_GRAIN, ITERATIONS, ZETA
from warpgrains.kernels.iteration import Stop
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State
from warpgrains.solver import tuning as scales
from warpgrains.solver.contact_list import ContactList
from warpgrains.solver.failures import not_converged, not_finite
from warpgrains.solver.grains import (
    allocate_grains,
    allocate_momentum,
    allocate_progress,
    allocate_watch,
    variant_of,
)
from warpgrains.solver.infeasible import (
    InfeasibilityProof,
    find_infeasibility_proof,
    iterations_worth_a_search,
)
from warpgrains.solver.launch import Replay, reader
from warpgrains.solver.memory import require_memory
from warpgrains.solver.statistics import StepReport
from warpgrains.solver.step_report import has_converged, read_step_report
from warpgrains.solver.threads import cores

CALM = 0.3  # of the slack: what a grain may stray in a step without being watched
PAIRS_PER_GRAIN = 4  # that a list may come to hold
SHARED_GRAINS = 20_000  # from which workers with turns of their own gain far more than they wait
SHARED_GROUP = 1000  # pairs of a group, from which workers that meet after each gain more than they wait
RESERVE = 0.1  # of the slack: what must be left of a reach before the iteration starts


def paying_threads(scene: Scene) -> int:
    """Return how many threads pay: all cores, if there is enough to sweep between two waits.

    A pile has about 3 contacts a grain; they fall in about 12 colors, or in 7 sqrt(n) levels (DESIGN.md).
    """
    if scene.method == "accelerated":
        groups = 12.0 if scene.order == "color" else 7.0 * np.sqrt(scene.n)
        return cores() if 3.0 * scene.n / groups > SHARED_GROUP else 1
    return cores() if scene.n >= SHARED_GRAINS else 1


class StepSolver:
    """Advances the grains of a scene on a device.

    Parameters
    ----------
    scene : Scene
    device : wp.Device
    threads : int, optional
        OS threads that share the work on a CPU; by default as many as pay.

    Raises
    ------
    SimulationError
        The scene does not fit in memory.

    Attributes
    ----------
    grains : Grains
        State on the device.
    contacts : ContactList
        Candidate contacts, and the corrections that they carry.
    start_velocity : wp.array
        Velocities at the start of the last good step [m/s]; its positions are `grains.last_position`.
    """

    def __init__(self, scene: Scene, device: wp.Device, threads: int | None):
        require_memory(scene.n, PAIRS_PER_GRAIN * scene.n, device)
        threads = paying_threads(scene) if threads is None else threads
        self._scene, self._replay, variant = scene, Replay(device, threads), variant_of(scene)
        self._motion, self._sweep = motion.kernels(variant), sweep.kernels(variant)
        self._watching, self._iteration = watch.kernels(variant), iteration.kernels(variant)
        self._loop, self._begin_momentum = iterate.kernels(variant), momentum.kernels(variant).begin
        self._measure, self._residual = measure.kernels(variant), residual.kernels(variant)
        self.grains = allocate_grains(scene, variant, device)
        self.start_velocity = wp.zeros_like(self.grains.velocity)
        self._watch = allocate_watch(scene.n, device)
        self._momentum = allocate_momentum(scene.n, variant, device)
        self._progress = allocate_progress(self._replay.slots, device)
        self._read_report = reader(self._progress.report)
        self.contacts = ContactList(
            scene, self.grains, self._watch, self._progress, self._momentum, variant, self._replay
        )
        self._stop = Stop()
        self._stop.on_residual = int(scene.stops_on_residual)
        self._stop.tolerance, self._stop.max_iterations = scene.tolerance, scene.max_iterations
        self._stop.calm = CALM / scene.dt
        self._iterations_to_search, self._smallest = 0, scales.smallest_radius(scene)

    def load(self, state: State) -> None:
        """Continue from a state."""
        self.grains.position.assign(state.position)
        self.grains.velocity.assign(state.velocity)
        self.grains.last_position.assign(state.position)
        self._iterations_to_search = 0
        self.contacts.load(state.corrections, state.lists)

    def solve(self) -> StepReport:
        """Advance by one time step; whether grains cannot fit is not asked.

        Raises
        ------
        SimulationError
            A number is no longer finite; or the step has not converged, where that is to raise. The state is
            that before the step.
        """
        self._replay(self._solve_step)
        rebuilds = redos = 0
        while not self._accepted():
            redos += bool(self._read_report()[ITERATIONS])
            rebuilds += 1
            self.contacts.rebuild()
            self._replay(self._attempt)
        if self._holds_back:
            self._require_convergence()
            self._replay(self._finish)
        told, counts = self._read_report(), self.contacts.counts
        return read_step_report(self._scene, self._smallest, told, counts, rebuilds, redos)

    @property
    def _holds_back(self) -> bool:
        """Whether grains move only once the host has seen that the step has converged."""
        return self._scene.on_unconverged == "raise"

    def _solve_step(self) -> None:
        """Free velocity, contacts, move: stages 1 to 3 of SPEC.md."""
        scene = self._scene
        gravity = wp.vec2d(*scene.gravity)
        self._replay.share(self._motion.free_velocity, self.grains, gravity, scene.drag, scene.dt)
        self._attempt()

    def _attempt(self) -> None:
        """Solve the step for the listed contacts, and take it if none was missing."""
        self._warm_start()
        self._verify(reserve=RESERVE, foreseen=1.0)
        self._iterate()
        self._verify(reserve=0.0, foreseen=0.0)
        self._replay.each(self._iteration.judge, 1, self._watch, self._progress)
        wp.capture_if(self._progress.accepted, self._measure_residual if self._holds_back else self._finish)

    def _warm_start(self) -> None:
        """Freeze normals and gaps, and re-apply the corrections of the previous step (iteration 0)."""
        scene, grains, contacts = self._scene, self.grains, self.contacts.device
        share = self._replay.share
        share(self._motion.reset, grains)
        for first, last in self._replay.group_ranges(self.contacts.groups):
            share(self._sweep.start_pairs, grains, contacts, scene.dt, first, last)
        share(self._sweep.start_walls, grains, contacts, scene.radius_in, scene.radius_out, scene.dt)
        self._replay.each(self._watching.clear, 1, self._watch)
        self._replay.each(self._watching.find_frame, scene.n, grains, self._watch)
        share(self._watching.first_look, grains, self._watch, scene.dt)

    def _iterate(self) -> None:
        """Correct contact by contact, again and again, until the corrections no longer change."""
        share, contacts = self._replay.share, self.contacts.device
        self._replay.each(self._iteration.start, 1, self._watch, self._progress)
        if self._scene.method == "accelerated":
            share(self._begin_momentum, self.grains, contacts, self._momentum)
        if self._replay.by_group:
            wp.capture_while(self._progress.iterating, self._iterate_once)
        else:
            state = (self.grains, contacts, self._watch, self._progress, self._momentum)
            share(self._loop.iterate, *state, self._stop)

    def _iterate_once(self) -> None:
        """One iteration on a GPU, where a launch ends before the next begins."""
        share, each, loop, progress = self._replay.share, self._replay.each, self._loop, self._progress
        state = (self.grains, self.contacts.device, self._watch, progress, self._momentum)
        for group in range(self.contacts.groups):
            share(loop.sweep_pairs, *state, group)
        share(loop.sweep_walls, *state)
        each(loop.decide_here, 1, *state, self._stop)
        self._measure_residual()
        each(loop.check_here, 1, progress, self._stop)
        share(loop.go_on_here, *state)

    def _verify(self, reserve: float, foreseen: float) -> None:
        """Check that no contact is missing, with a reserve of slacks, and that every number is finite."""
        limits = (self._scene.dt, scales.rounding(self._scene), reserve, foreseen)
        self._replay.share(self._watching.verify, self.grains, self._watch, *limits)

    def _finish(self) -> None:
        """Move, and measure what the report tells."""
        scene, share = self._scene, self._replay.share
        self._replay.copy(self.start_velocity, self.grains.velocity)
        self._measure_residual()
        share(self._motion.move, self.grains, scene.dt)
        share(self._watching.remember, self._watch)
        self._replay.each(self._watching.shift_frame, 1, self._watch, scene.dt)
        walls = (scene.radius_in, scene.radius_out)
        share(self._measure.overlaps, self.grains, self.contacts.device, self._progress, *walls)
        self._replay.each(self._iteration.gather, 1, self._progress)

    def _measure_residual(self) -> None:
        """Measure how far the corrections are from balance."""
        share, grains, contacts = self._replay.share, self.grains, self.contacts.device
        if not self._replay.by_group:
            share(self._residual.measure_all, grains, contacts, self._progress)
            return
        share(self._residual.begin_rebuild, grains, self._progress)
        for group in range(self.contacts.groups):
            share(self._residual.rebuild_pairs, grains, contacts, self._progress, group)
        share(self._residual.finish_rebuild, grains, contacts, self._progress)
        share(self._residual.find_worst, grains, contacts, self._progress)

    def _accepted(self) -> bool:
        """Whether the attempt solved the step; raise if it cannot be solved."""
        if self._read_report()[ACCEPTED]:
            return True
        grain = int(self._watch.flag.numpy()[BAD_GRAIN])
        if grain >= 0:
            velocity = self.grains.next_velocity.numpy()[grain].tolist()
            self.contacts.revert()
            raise SimulationError(not_finite(grain, velocity))
        return False

    def _require_convergence(self) -> None:
        """Raise unless the step has met its tolerance; the grains have not moved yet."""
        report = self._read_report()
        zeta, residual = report[ZETA].item(), self._progress.residual.numpy().max().item()
        if has_converged(self._scene, zeta, residual):
            return
        certificate = self._search(self.grains.position, self.grains.next_velocity)
        self.contacts.revert()
        iterations = int(report[ITERATIONS])
        raise SimulationError(not_converged(self._scene, iterations, zeta, residual, certificate))

    def _search(self, position: wp.array, velocity: wp.array) -> InfeasibilityProof | None:
        """Look for a proof that the step has no solution."""
        corrections = self.contacts.corrections()
        return find_infeasibility_proof(self._scene, position.numpy(), velocity.numpy(), corrections)

    def name_grains_that_cannot_fit(self, report: StepReport) -> StepReport:
        """Search for them after an unconverged step; a search that finds none waits until the next pays."""
        self._iterations_to_search -= report.iterations
        if self._iterations_to_search > 0:
            return report
        certificate = self._search(self.grains.last_position, self.grains.velocity)
        self._iterations_to_search = 0 if certificate else iterations_worth_a_search(self._scene.n)
        return replace(report, infeasible=certificate.grains) if certificate else report
