"""The run of one scene, with its outputs, end criterion and checkpoints; the loop that advances runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from math import ceil
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
from warpgrains.simulation.checkpoint import Checkpoint, lock_checkpoint, read_checkpoint, write_checkpoint
from warpgrains.simulation.options import RunOptions, require_needed, spacing, steps_of
from warpgrains.simulation.until import TEST_INTERVAL, EndCriterion, Question, criterion
from warpgrains.solver.statistics import Summary, named
from warpgrains.space.region import table_of

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.state import State
    from warpgrains.simulation.simulation import Simulation
    from warpgrains.solver.loaded_scene import LoadedScene


SPACED = ("checkpoint", "series")
SEARCHES = 0.05  # largest time of searches, as a share of the time of unconverged steps
LEAST_TIME = 8e-9  # least time of an iteration per grain [s]


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


class SceneRun:
    """The run of one scene, which determines after how many steps an output or the end of the run is due.

    Attributes
    ----------
    scene : Scene
    options : RunOptions
    first_scene : Scene
        Scene at the start of the run, for outputs and end criterion. `scene` may have other grains.
    first_step : int
        Number of time steps before the run.
    state : State or None
        State from which the run continues; None at the start of the scene.
    statistics : Summary
        Statistics of the steps done. `statistics.frames` is the number of the next frame.
    until : EndCriterion or None
    observer : Observer or None
    error : str or None
        Reason why the run has failed.
    flows : dict
        At the end of the run, `Simulation.inflow` by "sources" and `Simulation.outflow` by "sinks".
    """

    def __init__(
        self,
        scene: Scene,
        options: RunOptions,
        first_step: int = 0,
        until: str | Question | EndCriterion | None = None,
    ) -> None:
        self._begin(scene, options, first_step)
        if until is not None:
            self.until = criterion(until, scene)

    def _begin(
        self,
        scene: Scene,
        options: RunOptions,
        first_step: int = 0,
        state: State | None = None,
        statistics: Summary | None = None,
        first_scene: Scene | None = None,
    ) -> None:
        """Begin a new run or, if `statistics` are given, continue a run of which `statistics.steps` are done.

        It starts from `state`, or from the start of the scene if `state` is None. `first_scene` is the scene
        at the start of the run, by default `scene`. InputError if the frames of these steps are incomplete.
        """
        self.scene, self.options, self.first_step, self.state = scene, options, first_step, state
        self.statistics, self._is_resumed = statistics or Summary(), statistics is not None
        self.first_scene = first_scene or scene
        self.until, self.times = criterion(options.until, self.first_scene), options.times(scene, first_step)
        self.flows: dict[str, list[Any]] = {}
        self.observer: Observer | None = None
        self.output: Output | None = None
        self.error: str | None = None
        self._begun_at: float | None = None
        if statistics is not None and self.missing_frames:
            after, due = f"after {statistics.steps} steps", statistics.frames + self.missing_frames
            raise InputError(f"the checkpoint counts {statistics.frames} frames {after}: there are {due}")

    @contextmanager
    def opened(self) -> Iterator[None]:
        """Lock the checkpoint, and open and lock the outputs. At the end, complete and unlock the outputs.

        If the run is resumed, the log of its recording is truncated to `statistics.frames` frames; doing so
        twice is harmless. InputError if a file cannot be written, or if the scene lacks a measured quantity,
        such as a wall.
        """
        with ExitStack() as held:
            self._lock(held)
            options = self.options
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
                    first_step=self.first_step,
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

    def _lock(self, held: ExitStack) -> None:
        if self.options.checkpoint is not None:
            held.enter_context(lock_checkpoint(Path(self.options.checkpoint)))

    @property
    def has_ended(self) -> bool:
        """True if all steps are done, the end criterion is met, or the run has failed."""
        statistics = self.statistics
        return self.error is not None or statistics.met or statistics.steps >= self.options.steps

    @property
    def missing_frames(self) -> int:
        """Number of frames due up to the present step that are not recorded. It must be 0 to resume a run."""
        return 0 if self.times is None else self.times.count(self.statistics.steps) - self.statistics.frames

    @property
    def lowered_rate(self) -> str | None:
        """The reason why a new run has fewer frames per second than requested; None if it has as many."""
        times, fps = self.times, self.options.fps
        if times is None or times.played == fps or self._is_resumed:
            return None
        reason = f"with one frame every step of {self.scene.dt:g} s there are {times.played:.6g}"
        if times.step(1) > 1 or times.left(1) > 0.0:
            reason = f"a file of this kind has at most {times.played:.6g}"
        return f"fps {fps:g} cannot be met: {reason}"

    @property
    def steps_due(self) -> int:
        """Number of steps to the next output, checkpoint or test of the end criterion; 0 at the end."""
        if self.has_ended:
            return 0
        steps = self.statistics.steps
        due = [self.options.steps, *([] if self.until is None else [_next(TEST_INTERVAL, steps)])]
        if self.output is not None and self.times is not None:
            due.append(self.times.step(self.statistics.frames))
        if self.observer is not None:
            due.append(_next(self.observer.every, self.first_step + steps) - self.first_step)
        if self._saves_itself:
            due.append(_next(self.options.every, steps))
        return min(due) - steps

    @property
    def _saves_itself(self) -> bool:
        return self._begun_at is not None and self.options.checkpoint is not None

    def count(self, done: Summary, now: LoadedScene) -> None:
        """Add the summary `done` of new steps to the statistics; end the run if its end criterion is met.

        These are at most `steps_due` steps. `now` is the scene after them.
        """
        statistics = self.statistics
        statistics.add(done)
        self.error = statistics.error = done.error
        if self.until is None or done.steps == 0:
            return
        statistics.met = False
        if statistics.steps % TEST_INTERVAL == 0:
            held = statistics.held + TEST_INTERVAL if statistics.held else 1
            statistics.held = held if self.until.condition(now) else 0
            statistics.met = statistics.held > self.until.steps

    def write_due(self, now: LoadedScene) -> None:
        """Measure, record and save what is due after the present step, from the scene `now`."""
        statistics, steps = self.statistics, self.statistics.steps
        if self.observer is not None and (self.first_step + steps) % self.observer.every == 0:
            self.observer.observe(now)
        if self.output is not None:
            is_due = self.has_ended if self.times is None else steps == self.times.step(statistics.frames)
            if is_due:
                left = 0.0 if self.times is None else self.times.left(statistics.frames)
                self.output.record(snapshot_of(now, left, self.output.needs_contacts))
                statistics.frames += 1
        if self._begun_at is not None:
            statistics.seconds = perf_counter() - self._begun_at
        if self._saves_itself and (steps % self.options.every == 0 or self.has_ended):
            self.save(now.state(), now.scene)

    def save(self, state: State, scene: Scene) -> None:
        """Flush frames and measurements to the disk, then write a checkpoint that counts them."""
        assert self.options.checkpoint is not None
        if self.output is not None:
            self.output.flush()
        if self.observer is not None:
            self.observer.flush()
            self.statistics.means = getattr(self.observer, "means", ())
        first = None if scene is self.first_scene else self.first_scene
        kept = Checkpoint(scene, state, self.options, self.statistics, first)
        write_checkpoint(Path(self.options.checkpoint), kept)

    def carry_out(self, simulation: Simulation, progress: bool) -> Summary:
        """Do the remaining steps of an opened run, and return its summary.

        Warns if a new output cannot have as many frames per second as requested, if grains cannot fit, and if
        the run ended before its end criterion was met.
        """
        statistics = self.statistics
        if self.lowered_rate is not None:
            warn(self.lowered_rate, stacklevel=3)
        self._begun_at = perf_counter() - statistics.seconds
        with progress_bar(self.options.steps, statistics.steps, progress) as bar:

            def advance(due: list[int]) -> list[tuple[int, Summary]]:
                done = simulation.advance(due[0], bar.update, simulation.failures_to_search)
                simulation.failures_to_search -= done.unconverged
                if simulation.failures_to_search == 0:
                    _search_for_wedged_grains(simulation)
                return [(0, done)]

            try:
                for _ in advance_runs([self], [simulation], advance):
                    pass
            finally:
                if self.observer is not None:
                    self.observer.flush()
        statistics.seconds = perf_counter() - self._begun_at
        self.flows = {"sources": simulation.inflow, "sinks": simulation.outflow}
        if self.until is not None and not statistics.met:
            time = f"{simulation.time:g} s of simulated time"
            warn(f"{self.until.name} was not reached within {time}", stacklevel=3)
        return replace(statistics, output=self.options.record)


class ResumedRun(SceneRun):
    """A run that continues from a checkpoint to a total of `steps` or `duration` [s], or as far as planned.

    If a run wrote the checkpoint `path`, the run keeps its options, of which `given` may only replace the
    next file ("checkpoint") and the intervals ("every"). If `Simulation.save` wrote it, a new run with the
    options `given` begins. `named` returns the name of an option for messages. `opened` locks the checkpoint
    of a run, then reads it again.
    """

    def __init__(
        self,
        path: str | Path,
        steps: int | None,
        duration: float | None,
        given: dict[str, Any],
        named: Callable[[str], str] = str,
    ) -> None:
        self._path, self._end, self._named, self._given = Path(path), (steps, duration), named, {**given}
        self._every = self._given.pop("every", None)
        self._read()

    def _read(self) -> None:
        start = read_checkpoint(self._path)
        options, statistics, done = start.options, start.statistics, start.state.steps
        if options is None:
            require_needed(self._given, self._named)
        for name in [] if options is None else [name for name in self._given if name != "checkpoint"]:
            flag = self._named(name)
            raise InputError(f"{flag} cannot be combined with --resume: a resumed run keeps its options")
        end = start.scene.steps if options is None else start.first_step + options.steps
        if self._end != (None, None):
            end = steps_of(start.scene, *self._end)
            statistics.met = statistics.met and end == done  # the run continues after its end criterion
        if end < done:
            raise InputError(f"the run cannot end at step {end}: its checkpoint is already at step {done}")
        checkpoint, series = (self._given.get(name) or getattr(options, name, None) for name in SPACED)
        given = self._given | spacing(self._every, checkpoint, series, self._named)
        given["steps"] = end - start.first_step
        if options is None:
            self._begin(start.scene, RunOptions(**given), done, start.state)
        else:
            options = replace(options, **given)
            self._begin(start.scene, options, start.first_step, start.state, statistics, start.start)

    def _lock(self, held: ExitStack) -> None:
        if self._is_resumed:
            held.enter_context(lock_checkpoint(self._path))
            self._read()  # the run may have continued before the lock was acquired
            if Path(self.options.checkpoint or "").resolve() == self._path.resolve():
                return
        super()._lock(held)


def advance_runs(
    runs: Sequence[SceneRun],
    scenes: Sequence[LoadedScene],
    advance: Callable[[list[int]], Iterable[tuple[int, Summary]]],
) -> Iterator[None]:
    """Advance every run to its end or failure. Yield whenever all runs have advanced to their next output.

    `advance` receives the number of steps to do for each of the scenes. It returns pairs of the index of a
    scene and the summary of its steps, for the scenes that have advanced.
    """
    for run, now in zip(runs, scenes, strict=True):
        with now.observed():
            run.write_due(now)
    while any(due := [run.steps_due for run in runs]):
        for k, done in advance(due):
            with scenes[k].observed():
                runs[k].count(done, scenes[k])
                runs[k].write_due(scenes[k])
        yield


def _search_for_wedged_grains(simulation: Simulation) -> None:
    """Warn if a search proves that the last step has no solution, because grains cannot fit.

    Set `Simulation.failures_to_search`, the number of unconverged steps before the next search, so that
    searches take little time.
    """
    begun_at, scene = perf_counter(), simulation.scene
    if grains := simulation.infeasible_grains():
        warn(f"step {simulation.steps}: {named(grains)} cannot fit", stacklevel=6)
    failure = LEAST_TIME * scene.n * scene.max_iterations
    simulation.failures_to_search = ceil((perf_counter() - begun_at) / (SEARCHES * failure))


def _next(every: int, steps: int) -> int:
    """Return the next multiple of `every` after step `steps`."""
    return steps - steps % every + every
