"""A run: many steps, with what they write, which another process can resume."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from tqdm import tqdm

from warpgrains.checkpoint import Checkpoint, require_checkpoint_path, write_checkpoint
from warpgrains.errors import SceneError
from warpgrains.plan import Plan
from warpgrains.reports import Summary, Tally
from warpgrains.scene import Scene

if TYPE_CHECKING:
    from warpgrains.recording import Recorder
    from warpgrains.simulation import Simulation


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
    """
    if plan.checkpoint is not None:
        require_checkpoint_path(Path(plan.checkpoint))
    start = perf_counter() - tally.seconds
    with _recorder(plan, simulation.scene, tally) as recorder, _bar(plan, tally, progress) as bar:
        while True:
            if recorder is not None and tally.steps == tally.frames * recorder.stride:
                recorder.record(simulation.position, simulation.velocity)
                tally.frames += 1
            tally.seconds = perf_counter() - start
            if plan.checkpoint is not None and plan.asks_checkpoint(tally.steps):
                kept = Checkpoint(simulation.scene, simulation.state(), plan, tally)
                write_checkpoint(Path(plan.checkpoint), kept)
            if tally.steps == plan.steps:
                break
            tally.add(simulation.step())
            bar.update()
    return tally.summary(plan.record)


def _bar(plan: Plan, tally: Tally, progress: bool) -> tqdm:
    return tqdm(total=plan.steps, initial=tally.steps, disable=not progress)


def _recorder(plan: Plan, scene: Scene, tally: Tally) -> AbstractContextManager[Recorder | None]:
    """Open the recording of a run, or nothing."""
    if plan.record is None:
        return nullcontext()
    from warpgrains.recording import Recorder

    if tally.frames > 0:
        raise SceneError(f"recording '{plan.record}' cannot be continued yet")
    return Recorder(plan.record, scene, plan.fps)
