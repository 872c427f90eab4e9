"""Execution of a run: many steps with their outputs.

The checkpoints of a run let another process resume it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING, Any, Protocol
from warnings import warn

from warpgrains.console import progress_bar
from warpgrains.drawing.frames import Frame, Output
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.simulation.checkpoint import Checkpoint, write_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.simulation.until import EndCriterion, steps_to_multiple, steps_to_test
from warpgrains.solver.statistics import RunStatistics, named

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.simulation.simulation import Simulation
    from warpgrains.solver.present import PresentState


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


@dataclass(eq=False)
class OpenRun:
    """A run between two steps, with what it writes."""

    options: RunOptions
    """Its `steps` become those done when the run ends early."""
    statistics: RunStatistics
    first_step: int = 0
    """Time steps before the run."""
    until: EndCriterion | None = None
    observer: Observer | None = None
    output: Output | None = None
    """File that receives frames, see `opened`."""

    @contextmanager
    def opened(self, scene: Scene) -> Iterator[None]:
        """Open the output. Its file is locked meanwhile and completed at the end.

        The log of a resumed run is truncated to the frames that its statistics count, which is idempotent.

        Raises
        ------
        InputError
            The output cannot be written.
        """
        self.output = self.options.open_output(scene, self.statistics, self.first_step)
        if self.output is None:
            yield
            return
        with self.output:
            yield
            at_end = perf_counter()
        self.statistics.seconds += perf_counter() - at_end

    @property
    def _next_frame(self) -> int | None:
        """Step of the run after which a frame is due."""
        if self.output is None or self.output.times is None:
            return None if self.output is None else self.options.steps
        return self.output.times.step(self.statistics.frames)

    @property
    def steps_to_output(self) -> int:
        """Number of steps to the next frame or observation, or to the end of the run."""
        steps, frame = self.statistics.steps, self._next_frame
        left = [self.options.steps - steps] + ([] if frame is None else [frame - steps])
        if self.observer is not None:
            left.append(steps_to_multiple(self.first_step + steps, self.observer.every))
        return min(left)

    @property
    def steps_to_stop(self) -> int:
        """Number of steps to the next output, test of the end criterion or checkpoint."""
        steps, left = self.statistics.steps, [self.steps_to_output]
        if self.until is not None:
            left.append(steps_to_test(steps))
        if self.options.checkpoint is not None:
            left.append(steps_to_multiple(steps, self.options.every))
        return min(left)

    def record(self, now: PresentState) -> None:
        """Observe and record the present state, if due."""
        steps = self.statistics.steps
        if self.observer is not None and (self.first_step + steps) % self.observer.every == 0:
            self.observer.observe(now)
        if self.output is not None and steps == self._next_frame:
            self.output.record(Frame.of(now, self.output.needs_contacts))
            self.statistics.frames += 1

    def save_if_due(self, now: PresentState) -> None:
        """Save a checkpoint, if due, after flushing the frames and measurements that it counts."""
        path = self.options.checkpoint_after(self.statistics.steps)
        if path is not None:
            self.flush()
            write_checkpoint(path, Checkpoint(now.scene, now.state(), self.options, self.statistics))

    def flush(self) -> None:
        """Flush frames and measurements to the disk, before a checkpoint that counts them."""
        if self.output is not None:
            self.output.flush()
        if self.observer is not None:
            self.observer.flush()

    def end(self) -> None:
        """End the run after the steps done, because its end criterion is met."""
        self.options = replace(self.options, steps=self.statistics.steps)


def carry_out(simulation: Simulation, run: OpenRun, progress: bool) -> None:
    """Do the remaining steps of an opened run and update its statistics.

    Parameters
    ----------
    progress : bool
        Whether to show progress on standard error, see `progress_bar`.

    Raises
    ------
    SimulationError
        A step failed.

    Warns
    -----
    UserWarning
        Grains cannot fit (once per run), or the run ended before its end criterion was met.
    """
    statistics, until = run.statistics, run.until
    start = perf_counter() - statistics.seconds
    with progress_bar(run.options.steps, statistics.steps, progress) as bar, _flushed(run.observer):
        run.record(simulation)
        run.save_if_due(simulation)
        while statistics.steps < run.options.steps:
            done = simulation.advance(run.steps_to_stop, bar.update)
            if done.infeasible and not statistics.infeasible:
                step, grains = simulation.infeasible_steps[0]
                warn(f"step {step}: {named(grains)} cannot fit", stacklevel=3)
            statistics.add(done)
            statistics.seconds = perf_counter() - start
            if until is not None and until.is_met(simulation, statistics):
                run.end()
            run.record(simulation)
            run.save_if_due(simulation)
    statistics.seconds = perf_counter() - start
    if until is not None and not statistics.met:
        warn(f"{until.name} was not reached within {simulation.time:g} s of simulated time", stacklevel=3)


@contextmanager
def _flushed(observer: Observer | None) -> Iterator[None]:
    """Flush the observer at the end, even after an exception."""
    try:
        yield
    finally:
        if observer is not None:
            observer.flush()
