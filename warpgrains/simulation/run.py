"""Execution of a run: many steps with their outputs.

The checkpoints of a run let another process resume it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Protocol
from warnings import warn

from warpgrains.analysis.snapshot import snapshot_of
from warpgrains.base import checks
from warpgrains.base.console import progress_bar
from warpgrains.base.errors import InputError
from warpgrains.base.frame_log import is_complete
from warpgrains.drawing.kinds import Output
from warpgrains.simulation.checkpoint import Checkpoint, lock_checkpoint, write_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.simulation.until import CountedRun, criterion, steps_to
from warpgrains.solver.statistics import Summary, named
from warpgrains.space.region import table_of

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.state import State
    from warpgrains.simulation.simulation import Simulation
    from warpgrains.solver.loaded_scene import LoadedScene


class Observer(Protocol):
    """Interface of objects that measure during a run, such as `warpgrains.analysis.Series`."""

    every: int
    """Interval [steps]: `observe` is called at its multiples."""

    def observe(self, simulation: Any) -> None:
        """Measure the present state."""

    def flush(self) -> None:
        """Write all measurements to the disk, before a checkpoint and at the end of the run."""


def require_observer(observer: Observer) -> None:
    """Raise InputError unless `observer` has `every`, `observe` and `flush`."""
    if not all(callable(getattr(observer, name, None)) for name in ("observe", "flush")):
        raise InputError(f"observer is {checks.shown(observer)}: it must have every, observe() and flush()")
    checks.whole_number("observer.every", getattr(observer, "every", None))


class OpenRun(CountedRun):
    """A run between two steps, with what it writes.

    `statistics` are those of the steps done, given if the run is resumed; their number of frames is the
    number of the next one. `first_step` is the number of time steps before the run. The checkpoint
    `is_locked` if the caller has locked it. `first_scene` is that at the start of the run, if grains came or
    went since: outputs and end criteria depend on it.
    """

    def __init__(
        self,
        scene: Scene,
        options: RunOptions,
        statistics: Summary | None = None,
        first_step: int = 0,
        *,
        is_locked: bool = False,
        first_scene: Scene | None = None,
    ) -> None:
        self.first_scene = first_scene or scene
        super().__init__(options.steps, statistics or Summary(), criterion(options.until, self.first_scene))
        self.scene, self.options, self.first_step = scene, options, first_step
        self._is_resumed, self._is_locked = statistics is not None, is_locked
        self.observer: Observer | None = None
        self.flows: dict[str, list[Any]] = {}
        self.output: Output | None = None
        self.times = options.times(scene, first_step)
        if statistics is not None and self.missing_frames:
            after, due = f"after {statistics.steps} steps", statistics.frames + self.missing_frames
            raise InputError(f"the checkpoint counts {statistics.frames} frames {after}: there are {due}")

    @contextmanager
    def opened(self) -> Iterator[None]:
        """Lock the checkpoint and open the outputs, which are locked meanwhile and completed at the end.

        The log of a resumed run is truncated to the frames that its statistics count, which is idempotent.
        InputError if a file cannot be written, or the scene cannot have a measured quantity.
        """
        options = self.options
        with ExitStack() as held:
            if options.checkpoint is not None and not self._is_locked:
                held.enter_context(lock_checkpoint(Path(options.checkpoint)))
            if options.measure is not None:
                from warpgrains.analysis.quantities import require_quantities
                from warpgrains.analysis.series import Series

                resume_at = self.first_step + self.statistics.steps if self._is_resumed else None
                region = None if options.region is None else table_of("region", options.region)
                series = Series(
                    options.measure,
                    options.measure_every,
                    options.series,
                    resume_at=resume_at,
                    region=region,
                    mean=options.mean,
                )
                self.observer, series.means = held.enter_context(series), self.statistics.means
                require_quantities(series.names, self.scene, region)
            path, kind = Path(options.record or ""), options.shows
            has_all_frames = self._is_resumed and self.has_ended and is_complete(path)
            if kind is not None and not has_all_frames:
                resume_at = self.statistics.frames if self._is_resumed else None
                self.output = held.enter_context(
                    kind.opened(self.first_scene, options, self.times, resume_at)
                )
            yield
            at_end = perf_counter()
        self.statistics.seconds += perf_counter() - at_end

    @property
    def missing_frames(self) -> int:
        """Number of frames up to the present step that are not recorded; 0 if a run can be resumed there."""
        return 0 if self.times is None else self.times.count(self.statistics.steps) - self.statistics.frames

    @property
    def _step_of_next_frame(self) -> int:
        """Step of the run after which a frame is due: the last one, if there are not several frames."""
        if self.output is None or self.times is None:
            return self.statistics.steps if self.has_ended else self.steps
        return self.times.step(self.statistics.frames)

    @property
    def lowered_rate(self) -> str | None:
        """The reason why a new run has fewer frames per second than requested; None if it has not fewer."""
        times, fps = self.times, self.options.fps
        if times is None or times.played == fps or self._is_resumed:
            return None
        reason = f"with one frame every step of {self.scene.dt:g} s there are {times.played:.6g}"
        if times.step(1) > 1 or times.left(1) > 0.0:
            reason = f"a file of this kind has at most {times.played:.6g}"
        return f"fps {fps:g} cannot be met: {reason}"

    @property
    def steps_to_output(self) -> int:
        """Number of steps to the next frame or observation, or to the end of the run."""
        steps = self.statistics.steps
        left = min(self.steps, self._step_of_next_frame) - steps
        if self.observer is None:
            return left
        return min(left, steps_to(self.observer.every, self.first_step + steps))

    def record(self, now: LoadedScene) -> None:
        steps = self.statistics.steps
        if self.observer is not None and (self.first_step + steps) % self.observer.every == 0:
            self.observer.observe(now)
        if self.output is not None and steps == self._step_of_next_frame:
            left = 0.0 if self.times is None else self.times.left(self.statistics.frames)
            self.output.record(snapshot_of(now, left, self.output.needs_contacts))
            self.statistics.frames += 1

    def flush_and_checkpoint(self, state: State, scene: Scene | None = None) -> Checkpoint:
        """Return a checkpoint, after flushing the frames and measurements that it counts to the disk.

        `scene` is that of the state, if grains came or went.
        """
        if self.output is not None:
            self.output.flush()
        if self.observer is not None:
            self.observer.flush()
            self.statistics.means = getattr(self.observer, "means", ())
        scene = scene or self.scene
        start = None if scene is self.first_scene else self.first_scene
        return Checkpoint(scene, state, self.options, self.statistics, start)


def _warn_of_wedged_grains(simulation: Simulation) -> bool:
    """Warn if the last step has no solution, as far as a search can prove it; return True then."""
    grains = simulation.infeasible_grains()
    if grains:
        warn(f"step {simulation.steps}: {named(grains)} cannot fit", stacklevel=4)
    return bool(grains)


def carry_out(simulation: Simulation, run: OpenRun, progress: bool) -> None:
    """Do the remaining steps of an opened run and update its statistics.

    Warns if a new output cannot have as many frames per second as requested, if grains cannot fit (once;
    searched for after the first unconverged step, and whenever their number has doubled), and if the run
    ended before its end criterion was met.
    """
    statistics, until, every = run.statistics, run.until, run.options.every
    if run.lowered_rate is not None:
        warn(run.lowered_rate, stacklevel=3)
    kept = None if run.options.checkpoint is None else Path(run.options.checkpoint)
    start = perf_counter() - statistics.seconds

    def measure_time() -> None:
        statistics.seconds = perf_counter() - start

    def write_due() -> None:
        with simulation.observed():
            run.record(simulation)
        measure_time()
        if kept is not None and (statistics.steps % every == 0 or run.has_ended):
            write_checkpoint(kept, run.flush_and_checkpoint(simulation.state(), simulation.scene))

    wedged = False
    with progress_bar(run.steps, statistics.steps, progress) as bar:
        try:
            write_due()
            while not run.has_ended:
                steps = min(run.steps_to_output, run.steps_to_test)
                if kept is not None:
                    steps = min(steps, steps_to(every, statistics.steps))
                unconverged = statistics.unconverged
                to_search = (1 << unconverged.bit_length()) - unconverged
                done = simulation.advance(steps, bar.update, to_search)
                if done.unconverged == to_search:
                    wedged = wedged or _warn_of_wedged_grains(simulation)
                with simulation.observed():
                    run.count(done, simulation)
                write_due()
        finally:
            if run.observer is not None:
                run.observer.flush()
    measure_time()
    run.flows = {"sources": simulation.inflow, "sinks": simulation.outflow}
    if until is not None and not statistics.met:
        warn(f"{until.name} was not reached within {simulation.time:g} s of simulated time", stacklevel=3)
