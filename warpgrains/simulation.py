"""Simulation: one scene, step by step."""

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from tqdm import tqdm

from warpgrains.contacts import ContactList
from warpgrains.errors import SceneError, SimulationError
from warpgrains.forces import pair_contacts, wall_contacts
from warpgrains.grains import allocate_grains, allocate_progress, allocate_watch, variant_of
from warpgrains.kernels import iteration, measure, motion, sweep, watch
from warpgrains.kernels.data import ACCEPTED, BAD_GRAIN, CARRYING, ITERATIONS, OVERLAP, ZETA
from warpgrains.kernels.iteration import Stop
from warpgrains.replay import Replay
from warpgrains.reports import (
    Corrections,
    FloatArray,
    PairContacts,
    State,
    StepReport,
    Summary,
    Tally,
    WallContacts,
)
from warpgrains.scene import Scene

if TYPE_CHECKING:
    from warpgrains.recording import Recorder

SLACK = 0.15  # of the smallest radius: how far grains move before contacts are searched anew


class Simulation:
    """One scene on one device.

    Parameters
    ----------
    scene : Scene
        What is simulated.
    device : str
        A Warp device, "cpu" or "cuda:0".
    **overrides
        Fields of the scene that are to be changed, such as order="color" or tolerance=1e-8.

    Raises
    ------
    SceneError
        The device is unknown, or a change makes no scene.
    """

    def __init__(self, scene: Scene, device: str = "cpu", **overrides: Any):
        self.scene = scene = scene.replace(**overrides) if overrides else scene
        self._replay = replay = Replay(_find_device(device))
        variant = variant_of(scene)
        self._motion, self._sweep = motion.kernels(variant), sweep.kernels(variant)
        self._watching, self._iteration = watch.kernels(variant), iteration.kernels(variant)
        self._measure = measure.kernels(variant)
        self._slack = SLACK * scene.radius.min().item()
        self._grains = allocate_grains(scene, variant, replay.device)
        self._watch = allocate_watch(scene.n, replay.device)
        self._progress = allocate_progress(replay.slots, replay.device)
        self._list = ContactList(
            scene, self._grains, self._watch, self._progress, variant, replay, self._slack
        )
        self._stop = Stop()
        self._stop.tolerance, self._stop.max_iterations = scene.tolerance, scene.max_iterations
        self._stop.calm = 0.1 * self._slack / scene.dt
        nothing = Corrections(np.zeros((0, 2), np.int32), np.zeros(0), np.zeros(scene.n))
        self.restore(State(0, scene.position, scene.velocity, nothing))

    def step(self) -> StepReport:
        """Advance by one time step.

        Raises
        ------
        SimulationError
            A number is no longer finite. The state is that before the step.
        """
        self._replay(self._solve_step)
        rebuilds = redos = 0
        while not self._accepted():
            redos += bool(self._progress.report.numpy()[ITERATIONS])
            rebuilds += 1
            self._list.rebuild()
            self._replay(self._attempt)
        self._steps += 1
        return self._step_report(rebuilds, redos)

    def _solve_step(self) -> None:
        scene = self.scene
        gravity = wp.vec2d(*scene.gravity)
        self._replay.share(self._motion.free_velocity, self._grains, gravity, scene.drag, scene.dt)
        self._attempt()

    def _attempt(self) -> None:
        """Solve the step for the listed contacts, and take it if none was missing."""
        self._warm_start()
        self._verify(reserve=0.1 * self._slack, foreseen=1.0)
        self._replay.each(self._iteration.start, 1, self._watch, self._progress)
        self._iterate()
        self._verify(reserve=0.0, foreseen=0.0)
        self._replay.each(self._iteration.judge, 1, self._watch, self._progress)
        wp.capture_if(self._progress.accepted, self._finish)

    def _warm_start(self) -> None:
        """Freeze normals and gaps, and re-apply the corrections of the previous step (iteration 0)."""
        scene, grains, contacts = self.scene, self._grains, self._list.contacts
        share = self._replay.share
        share(self._motion.reset, grains)
        for first, last in self._replay.group_ranges(self._list.groups):
            share(self._sweep.start_pairs, grains, contacts, scene.dt, first, last)
        share(self._sweep.start_walls, grains, contacts, scene.radius_in, scene.radius_out, scene.dt)
        self._replay.each(self._watching.clear, 1, self._watch)
        share(self._watching.find_frame, grains, self._watch)
        share(self._watching.first_look, grains, self._watch, scene.dt)

    def _iterate(self) -> None:
        """Correct contact by contact, again and again, until the corrections no longer change."""
        state = (self._grains, self._list.contacts, self._watch, self._progress)
        if self._replay.in_line:
            self._replay.share(self._sweep.iterate, *state, self._stop)
        else:
            wp.capture_while(self._progress.iterating, self._iterate_once)

    def _iterate_once(self) -> None:
        """One iteration on a GPU, where a launch ends before the next begins."""
        state = (self._grains, self._list.contacts, self._watch, self._progress)
        for group in range(self._list.groups):
            self._replay.share(self._sweep.sweep_pairs, *state, group)
        self._replay.share(self._sweep.sweep_walls, *state)
        self._replay.each(self._sweep.decide, 1, self._watch, self._progress, self._stop)
        self._replay.share(self._sweep.look, self._grains, self._watch)

    def _verify(self, reserve: float, foreseen: float) -> None:
        """Check that no contact is missing, with a reserve [m], and that every number is finite."""
        rounding = 16.0 * np.finfo(float).eps * self.scene.radius_out
        limits = (self.scene.dt, reserve + rounding, foreseen)
        self._replay.share(self._watching.verify, self._grains, self._watch, *limits)

    def _finish(self) -> None:
        """Move, and measure what the report tells."""
        scene, share = self.scene, self._replay.share
        share(self._motion.move, self._grains, scene.dt)
        share(self._watching.remember, self._watch)
        self._replay.each(self._watching.shift_frame, 1, self._watch, scene.dt)
        walls = (scene.radius_in, scene.radius_out)
        share(self._measure.overlaps, self._grains, self._list.contacts, self._progress, *walls)
        self._replay.each(self._iteration.gather, 1, self._progress)

    def _accepted(self) -> bool:
        """Whether the attempt solved the step; raise if it cannot be solved."""
        if self._progress.report.numpy()[ACCEPTED]:
            return True
        grain = int(self._watch.flag.numpy()[BAD_GRAIN])
        if grain >= 0:
            velocity = self._grains.next_velocity.numpy()[grain].tolist()
            self._list.revert()
            raise SimulationError(
                f"step {self._steps + 1}, from t = {self.time} s: grain {grain} reached {velocity} m/s"
            )
        return False

    def _step_report(self, rebuilds: int, redos: int) -> StepReport:
        report = self._progress.report.numpy()
        pairs, _, walls = self._list.counts
        zeta = report[ZETA].item()
        return StepReport(
            iterations=int(report[ITERATIONS]),
            zeta=zeta,
            converged=zeta <= self.scene.tolerance,
            contacts=int(report[CARRYING]),
            candidates=pairs + walls,
            overlap=report[OVERLAP].item(),
            rebuilds=rebuilds,
            redos=redos,
        )

    def run(
        self,
        steps: int | None = None,
        duration: float | None = None,
        record: str | Path | None = None,
        fps: float = 60.0,
        progress: bool = False,
    ) -> Summary:
        """Advance by many time steps.

        Parameters
        ----------
        steps : int, optional
            How many; or
        duration : float, optional
            for how long [s]; by default for the scene's duration.
        record : str or Path, optional
            A USD file to write the frames to, the present state first.
        fps : float
            Wanted frames per second of simulated time [1/s], see `recording_stride`.
        progress : bool
            Whether to show a progress bar on standard error.

        Raises
        ------
        SceneError
            The recording cannot be written there.
        SimulationError
            A step failed.
        """
        if steps is None:
            steps = self.scene.steps if duration is None else self.scene.steps_in(duration)
        start, tally = perf_counter(), Tally()
        with _recorder(record, self.scene, fps) as recorder, tqdm(total=steps, disable=not progress) as bar:
            for done in range(steps + 1):
                if recorder is not None and done % recorder.stride == 0:
                    recorder.record(self.position, self.velocity)
                if done < steps:
                    tally.add(self.step())
                    bar.update()
        return tally.summary(perf_counter() - start, None if record is None else str(record))

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._steps * self.scene.dt

    @property
    def position(self) -> FloatArray:
        """Centres of the grains [m], shape (n, 2); a copy."""
        return self._grains.position.numpy().copy()

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the grains [m/s], shape (n, 2); a copy."""
        return self._grains.velocity.numpy().copy()

    def contacts(self) -> PairContacts:
        """Return the contacts between grains of the last step, those that carry a correction."""
        return pair_contacts(self.scene, self._grains.last_position.numpy(), self._list.corrections())

    def wall_contacts(self) -> WallContacts:
        """Return the contacts with the walls of the last step, one entry a grain."""
        return wall_contacts(self.scene, self._list.corrections())

    def state(self) -> State:
        """Return the exact state, from which `restore` continues with the same bits."""
        return State(self._steps, self.position, self.velocity, self._list.corrections())

    def restore(self, state: State) -> None:
        """Continue from a state of this scene."""
        self._steps = state.steps
        self._grains.position.assign(state.position)
        self._grains.velocity.assign(state.velocity)
        self._grains.last_position.assign(state.position)
        self._list.load(state.corrections)
        self._watch.reach.fill_(-1.0)


def _find_device(name: str) -> wp.Device:
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError) as error:
        known = ", ".join(device.alias for device in wp.get_devices())
        raise SceneError(f"device {name!r} is unknown here; choose {known}") from error


def _recorder(path: str | Path | None, scene: Scene, fps: float) -> AbstractContextManager["Recorder | None"]:
    """Open a recording, or nothing."""
    if path is None:
        return nullcontext()
    from warpgrains.recording import Recorder

    return Recorder(path, scene, fps)
