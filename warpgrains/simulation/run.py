"""A run: many steps, with what they write, which another process can resume."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple, Protocol
from warnings import warn

from warpgrains.console import progress_bar
from warpgrains.errors import SceneError
from warpgrains.files import require_place
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
    """What looks at a simulation while it runs, such as `warpgrains.analysis.Series`."""

    every: int
    """Steps between two looks: it looks at steps that are multiples of it."""

    def observe(self, simulation: Simulation) -> None:
        """Look at it."""

    def flush(self) -> None:
        """Put all that was seen on the disk: there is to be a checkpoint, or the run ends."""


def require_observer(observer: Observer) -> None:
    """Raise SceneError unless something can observe a run."""
    if not all(callable(getattr(observer, name, None)) for name in ("observe", "flush")):
        raise SceneError(f"observer is {checks.shown(observer)}: it must have every, observe() and flush()")
    checks.whole_number("observer.every", getattr(observer, "every", None))


class Outputs(NamedTuple):
    """What hears of a run, and what may end it."""

    recorder: Recorder | Film | None = None
    observer: Observer | None = None
    until: Criterion | None = None


@contextmanager
def open_outputs(
    options: RunOptions, scene: Scene, statistics: RunStatistics
) -> Iterator[Recorder | Film | None]:
    """Give the recorder of a run, if it needs one, with a lock on the recording; it is whole in the end.

    The log of a run that is resumed is cut to the frames of its statistics: doing so twice does no harm.

    Raises
    ------
    SceneError
        What it is to write cannot be written.
    """
    recorder = _recorder(options, scene, statistics)
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
    """Do what is left of a run; `statistics` says what it has done, and counts on.

    Parameters
    ----------
    outputs : Outputs
        The recorder is that of `open_outputs`.
    progress : bool
        Whether to show progress on standard error, see `progress_bar`.

    Raises
    ------
    SimulationError
        A step failed.

    Warns
    -----
    UserWarning
        Grains cannot fit, once a run; or the run was not ended by its criterion.
    """
    start = perf_counter() - statistics.seconds
    with progress_bar(options.steps, statistics.steps, progress) as bar, _flushed(outputs.observer):
        _keep(simulation, options, statistics, outputs)
        while statistics.steps < options.steps:
            done = simulation.advance(_steps_to_next(options, statistics, outputs, simulation), bar.update)
            if done.infeasible and not statistics.infeasible:
                step, grains = simulation.infeasible_steps[0]
                warn(f"step {step}: {named(grains)} cannot fit", stacklevel=3)
            statistics.add(done)
            statistics.seconds = perf_counter() - start
            if outputs.until is not None and outputs.until.is_met(simulation, statistics):
                options = replace(options, steps=statistics.steps)
            _keep(simulation, options, statistics, outputs)
    if options.record is not None and options.shows == "still":
        simulation.plot(options.color_by, options.forces).save(options.record)
    statistics.seconds = perf_counter() - start
    if outputs.until is not None and not statistics.met:
        warn(f"{outputs.until.name} was not met within {simulation.time:g} s", stacklevel=3)


@contextmanager
def _flushed(observer: Observer | None) -> Iterator[None]:
    """Have what was seen on the disk in the end, whatever ends the run."""
    try:
        yield
    finally:
        if observer is not None:
            observer.flush()


def _recorder(options: RunOptions, scene: Scene, statistics: RunStatistics) -> Recorder | Film | None:
    """Return the recorder of a run; None if there is nothing to record, or no more, or but its end."""
    if options.record is None:
        return None
    if options.shows is not None:
        require_drawing(f"'{options.record}'", options.shows == "film")
        if options.shows == "film":
            from warpgrains.pictures.film import Film

            painter = Painter(scene, options.color_by, options.forces)
            return Film(Path(options.record), scene, options.rate, painter)
        require_place("picture", Path(options.record), *STILLS)
        return None
    from warpgrains.usd.recorder import SUFFIXES, Recorder, log_of

    record = Path(options.record)
    require_place("output", record, *SUFFIXES, *FILMS, *STILLS)
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
    )


def _keep(simulation: Simulation, options: RunOptions, statistics: RunStatistics, outputs: Outputs) -> None:
    """Record, observe and write a checkpoint, where due; what it counts is on the disk before it."""
    recorder, observer, _ = outputs
    if observer is not None and simulation.steps % observer.every == 0:
        observer.observe(simulation)
    if recorder is not None and statistics.steps == recorder.times.step(statistics.frames):
        contacts = (simulation.contacts(), simulation.wall_contacts()) if recorder.needs_contacts else ()
        spin, angle = simulation.spin, simulation.angle
        recorder.record(simulation.position, simulation.velocity, *contacts, spin=spin, angle=angle)
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
    """Return after how many steps there is something to record, to see or to save, or the run ends."""
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
