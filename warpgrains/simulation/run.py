"""A run: many steps, with what they write, which another process can resume."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING
from warnings import warn

from tqdm import tqdm

from warpgrains.scene.scene import Scene
from warpgrains.simulation.checkpoint import Checkpoint, require_checkpoint_path, write_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.solver.statistics import RunStatistics, Summary, named

if TYPE_CHECKING:
    from warpgrains.simulation.simulation import Simulation
    from warpgrains.usd.recorder import Recorder


def run(
    simulation: Simulation, options: RunOptions, statistics: RunStatistics, progress: bool = False
) -> Summary:
    """Do what is left of a run.

    Parameters
    ----------
    simulation : Simulation
    options : RunOptions
        What the run is to do.
    statistics : RunStatistics
        What it has done; it is counted on.
    progress : bool
        Whether to show a progress bar on standard error.

    Raises
    ------
    SceneError
        The recording cannot be written there, or cannot be continued.
    SimulationError
        A step failed.

    Warns
    -----
    UserWarning
        Grains cannot fit; said once a run.
    """
    start = perf_counter() - statistics.seconds
    with (
        open_outputs(options, simulation.scene, statistics) as recorder,
        _bar(options, statistics, progress) as bar,
    ):
        _keep(simulation, options, statistics, recorder)
        while statistics.steps < options.steps:
            done = simulation.advance(_steps_to_next_output(options, statistics, recorder), bar.update)
            if done.infeasible and not statistics.infeasible:
                step, grains = simulation.infeasible_steps[0]
                warn(f"step {step}: {named(grains)} cannot fit", stacklevel=2)
            statistics.add(done)
            statistics.seconds = perf_counter() - start
            _keep(simulation, options, statistics, recorder)
    statistics.seconds = perf_counter() - start
    return statistics.summary(options.record)


def open_outputs(
    options: RunOptions, scene: Scene, statistics: RunStatistics
) -> AbstractContextManager[Recorder | None]:
    """Return the recorder of a run, if it needs one; raise SceneError if it cannot write what it is to write.

    The chunks of a run that is resumed are cut to the frames of its statistics: doing so twice does no harm.
    """
    if options.checkpoint is not None:
        require_checkpoint_path(Path(options.checkpoint))
    if options.record is None:
        return nullcontext()
    from warpgrains.usd.flatten import reopen
    from warpgrains.usd.recorder import Recorder, chunks_of

    record = Path(options.record)
    if statistics.frames and record.is_file() and not chunks_of(record).exists():
        if statistics.steps == options.steps:
            return nullcontext()
        reopen(record, chunks_of(record))
    return Recorder(
        record,
        scene,
        options.fps,
        color_by=options.color_by,
        forces=options.forces,
        as_spheres=options.as_spheres,
        resume_at=statistics.frames or None,
    )


def _keep(
    simulation: Simulation, options: RunOptions, statistics: RunStatistics, recorder: Recorder | None
) -> None:
    """Record a frame and write a checkpoint, where due; the frames a checkpoint counts are on the disk."""
    if recorder is not None and statistics.steps == statistics.frames * recorder.stride:
        contacts = (simulation.contacts(), simulation.wall_contacts()) if recorder.needs_contacts else ()
        recorder.record(simulation.position, simulation.velocity, *contacts)
        statistics.frames += 1
    checkpoint = options.checkpoint_after(statistics.steps)
    if checkpoint is not None:
        if recorder is not None:
            recorder.flush()
        write_checkpoint(checkpoint, Checkpoint(simulation.scene, simulation.state(), options, statistics))


def _steps_to_next_output(options: RunOptions, statistics: RunStatistics, recorder: Recorder | None) -> int:
    """Return after how many steps there is something to record or to save, or the run ends."""
    ends = [options.steps]
    if recorder is not None:
        ends.append(statistics.frames * recorder.stride)
    if options.checkpoint is not None:
        ends.append((statistics.steps // options.every + 1) * options.every)
    return min(ends) - statistics.steps


def _bar(options: RunOptions, statistics: RunStatistics, progress: bool) -> tqdm:
    return tqdm(total=options.steps, initial=statistics.steps, disable=not progress)
