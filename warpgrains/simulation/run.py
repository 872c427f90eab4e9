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
from warpgrains.simulation.options import Plan
from warpgrains.solver.statistics import Summary, Tally, named

if TYPE_CHECKING:
    from warpgrains.simulation.simulation import Simulation
    from warpgrains.usd.recorder import Recorder


def carry_out(simulation: Simulation, plan: Plan, tally: Tally, progress: bool = False) -> Summary:
    """Do what is left of a run.

    Parameters
    ----------
    simulation : Simulation
    plan : Plan
        What the run is to do.
    tally : Tally
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
    start = perf_counter() - tally.seconds
    with open_outputs(plan, simulation.scene, tally) as recorder, _bar(plan, tally, progress) as bar:
        _keep(simulation, plan, tally, recorder)
        while tally.steps < plan.steps:
            report = simulation.step()
            if report.infeasible and not tally.infeasible:
                warn(f"step {tally.steps + 1}: {named(report.infeasible)} cannot fit", stacklevel=2)
            tally.add(report)
            tally.seconds = perf_counter() - start
            _keep(simulation, plan, tally, recorder)
            bar.update()
    tally.seconds = perf_counter() - start
    return tally.summary(plan.record)


def open_outputs(plan: Plan, scene: Scene, tally: Tally) -> AbstractContextManager[Recorder | None]:
    """Return the recorder of a run, if it needs one; raise SceneError if it cannot write what it is to write.

    The chunks of a run that is resumed are cut to the frames of its tally: doing so twice does no harm.
    """
    if plan.checkpoint is not None:
        require_checkpoint_path(Path(plan.checkpoint))
    if plan.record is None:
        return nullcontext()
    from warpgrains.usd.recorder import Recorder, chunks_of
    from warpgrains.usd.reopen import reopen

    record = Path(plan.record)
    if tally.frames and record.is_file() and not chunks_of(record).exists():
        if tally.steps == plan.steps:
            return nullcontext()
        reopen(record, chunks_of(record))
    return Recorder(
        record,
        scene,
        plan.fps,
        color_by=plan.color_by,
        forces=plan.forces,
        as_spheres=plan.as_spheres,
        resume_at=tally.frames or None,
    )


def _keep(simulation: Simulation, plan: Plan, tally: Tally, recorder: Recorder | None) -> None:
    """Record a frame and write a checkpoint, where due; the frames a checkpoint counts are on the disk."""
    if recorder is not None and tally.steps == tally.frames * recorder.stride:
        contacts = (simulation.contacts(), simulation.wall_contacts()) if recorder.needs_contacts else ()
        recorder.record(simulation.position, simulation.velocity, *contacts)
        tally.frames += 1
    checkpoint = plan.checkpoint_after(tally.steps)
    if checkpoint is not None:
        if recorder is not None:
            recorder.flush()
        write_checkpoint(checkpoint, Checkpoint(simulation.scene, simulation.state(), plan, tally))


def _bar(plan: Plan, tally: Tally, progress: bool) -> tqdm:
    return tqdm(total=plan.steps, initial=tally.steps, disable=not progress)
