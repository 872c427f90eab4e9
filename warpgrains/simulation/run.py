"""Execution of a run: many steps with their outputs.

The checkpoints of a run let another process resume it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple, Protocol
from warnings import warn

from warpgrains.console import progress_bar
from warpgrains.errors import InputError
from warpgrains.files import require_writable_path
from warpgrains.pictures.kinds import FILMS, STILLS, require_drawing
from warpgrains.pictures.shots import Painter
from warpgrains.scene import checks
from warpgrains.simulation.checkpoint import Checkpoint, write_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.simulation.until import Criterion, steps_to_test
from warpgrains.solver.statistics import RunStatistics, named

if TYPE_CHECKING:
    from warpgrains.pictures.film import Film
    from warpgrains.scene.scene import Scene
    from warpgrains.simulation.simulation import Simulation
    from warpgrains.usd.recorder import Recorder


class Observer(Protocol):
    """Interface of objects that measure during a run, such as `warpgrains.analysis.Series`."""

    every: int
    """Interval [steps]: `observe` is called at its multiples."""

    def observe(self, simulation: Simulation) -> None:
        """Measure the present state."""

    def flush(self) -> None:
        """Write all measurements to the disk, before a checkpoint and at the end of the run."""


def require_observer(observer: Observer) -> None:
    """Raise InputError unless `observer` has `every`, `observe` and `flush`."""
    if not all(callable(getattr(observer, name, None)) for name in ("observe", "flush")):
        raise InputError(f"observer is {checks.shown(observer)}: it must have every, observe() and flush()")
    checks.whole_number("observer.every", getattr(observer, "every", None))


class Outputs(NamedTuple):
    """Recorder, observer and stopping criterion of a run."""

    recorder: Recorder | Film | None = None
    observer: Observer | None = None
    until: Criterion | None = None


@contextmanager
def open_outputs(
    options: RunOptions, scene: Scene, statistics: RunStatistics, first_step: int = 0
) -> Iterator[Recorder | Film | None]:
    """Yield the recorder of a run, or None. Its file is locked meanwhile and completed at the end.

    `first_step` is the number of time steps before the run.

    The log of a resumed run is truncated to the frames that its statistics count, which is idempotent.

    Raises
    ------
    InputError
        An output cannot be written.
    """
    recorder = _recorder(options, scene, statistics, first_step)
    if recorder is None:
        yield None
        return
    with recorder:
        yield recorder
        at_end = perf_counter()
    statistics.seconds += perf_counter() - at_end


def carry_out(
    simulation: Simulation,
    options: RunOptions,
    statistics: RunStatistics,
    outputs: Outputs,
    progress: bool,
) -> None:
    """Do the remaining steps of a run and update `statistics`.

    Parameters
    ----------
    outputs : Outputs
        Its recorder comes from `open_outputs`.
    progress : bool
        Whether to show progress on standard error, see `progress_bar`.

    Raises
    ------
    SimulationError
        A step failed.

    Warns
    -----
    UserWarning
        Grains cannot fit (once per run), or the run ended before its criterion was met.
    """
    start = perf_counter() - statistics.seconds
    with progress_bar(options.steps, statistics.steps, progress) as bar, _flushed(outputs.observer):
        _write_outputs(simulation, options, statistics, outputs)
        while statistics.steps < options.steps:
            done = simulation.advance(_steps_to_next(options, statistics, outputs, simulation), bar.update)
            if done.infeasible and not statistics.infeasible:
                step, grains = simulation.infeasible_steps[0]
                warn(f"step {step}: {named(grains)} cannot fit", stacklevel=3)
            statistics.add(done)
            statistics.seconds = perf_counter() - start
            if outputs.until is not None and outputs.until.is_met(simulation, statistics):
                options = replace(options, steps=statistics.steps)
            _write_outputs(simulation, options, statistics, outputs)
    if options.record is not None and options.shows == "still":
        simulation.plot(options.color_by, options.forces).save(options.record)
    statistics.seconds = perf_counter() - start
    if outputs.until is not None and not statistics.met:
        warn(
            f"{outputs.until.name} was not reached within {simulation.time:g} s of simulated time",
            stacklevel=3,
        )


@contextmanager
def _flushed(observer: Observer | None) -> Iterator[None]:
    """Flush the observer at the end, even after an exception."""
    try:
        yield
    finally:
        if observer is not None:
            observer.flush()


def _recorder(
    options: RunOptions, scene: Scene, statistics: RunStatistics, first_step: int
) -> Recorder | Film | None:
    """Return the recorder of a run; None if no frame is left to record, or only the final picture."""
    if options.record is None:
        return None
    if options.shows is not None:
        require_drawing(f"'{options.record}'", options.shows == "film")
        if options.shows == "film":
            from warpgrains.pictures.film import Film

            painter = Painter(scene, options.color_by, options.forces)
            return Film(Path(options.record), scene, options.rate, painter)
        require_writable_path("picture", Path(options.record), *STILLS)
        return None
    from warpgrains.usd.recorder import SUFFIXES, Recorder, log_of

    record = Path(options.record)
    require_writable_path("output", record, *SUFFIXES, *FILMS, *STILLS)
    is_whole = statistics.frames > 0 and record.is_file() and not log_of(record).exists()
    if is_whole and statistics.steps == options.steps:
        return None
    return Recorder(
        record,
        scene,
        options.rate,
        color_by=options.color_by,
        forces=options.forces,
        draw_as=options.draw_as,
        resume_at=statistics.frames or None,
        first_step=first_step,
    )


def _write_outputs(
    simulation: Simulation, options: RunOptions, statistics: RunStatistics, outputs: Outputs
) -> None:
    """Record, observe and write a checkpoint if due.

    Recordings and series reach the disk before the checkpoint that counts them.
    """
    recorder, observer, _ = outputs
    if observer is not None and simulation.steps % observer.every == 0:
        observer.observe(simulation)
    if recorder is not None and statistics.steps == recorder.times.step(statistics.frames):
        contacts = (simulation.contacts(), simulation.wall_contacts()) if recorder.needs_contacts else ()
        spin, angle = simulation.spin, simulation.angle
        position, velocity, time = simulation.position, simulation.velocity, simulation.time
        driven = simulation.driven
        recorder.record(position, velocity, *contacts, spin=spin, angle=angle, time=time, driven=driven)
        statistics.frames += 1
    checkpoint = options.checkpoint_after(statistics.steps)
    if checkpoint is not None:
        if recorder is not None:
            recorder.flush()
        if observer is not None:
            observer.flush()
        write_checkpoint(checkpoint, Checkpoint(simulation.scene, simulation.state(), options, statistics))


def _steps_to_next(
    options: RunOptions, statistics: RunStatistics, outputs: Outputs, simulation: Simulation
) -> int:
    """Return the number of steps to the next frame, observation, checkpoint or end."""
    recorder, observer, until = outputs
    ends = [options.steps]
    if until is not None:
        ends.append(statistics.steps + steps_to_test(statistics.steps))
    if observer is not None:
        ends.append(statistics.steps + observer.every - simulation.steps % observer.every)
    if recorder is not None:
        ends.append(recorder.times.step(statistics.frames))
    if options.checkpoint is not None:
        ends.append((statistics.steps // options.every + 1) * options.every)
    return min(ends) - statistics.steps
