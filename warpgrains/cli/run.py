"""`warpgrains run`: begin a run, or resume one, and tell what it did."""

from __future__ import annotations

import json
import os
import shlex
import sys
import warnings
from argparse import Namespace
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from warpgrains.analysis.series import Series
from warpgrains.cli.step_by_step import step_by_step
from warpgrains.cli.summary import results_of, summary_lines, true_rate
from warpgrains.console import start_warp, stdout_kept_clean
from warpgrains.errors import SceneError
from warpgrains.scene import checks
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import first_state
from warpgrains.simulation import run as runs
from warpgrains.simulation.checkpoint import Checkpoint, lock_checkpoint, read_checkpoint
from warpgrains.simulation.options import RunOptions
from warpgrains.simulation.until import criterion
from warpgrains.solver.statistics import RunStatistics

# What a resumed run takes from its checkpoint: the option of each argument.
KEPT = {
    "scene": "SCENE",
    "output": "--output",
    "fps": "--fps",
    "color_by": "--color-by",
    "forces": "--forces",
    "draw_as": "--as",
    "order": "--order",
    "method": "--method",
    "overrides": "--set",
    "measure": "--measure",
    "series": "--series",
    "until": "--until",
}

# What a run has that is not taken step by step.
_RECORDED = ("output", "fps", "color_by", "forces", "draw_as", "measure", "series", "until")
_NOT_STEP_BY_STEP = (*_RECORDED, "checkpoint", "every", "resume", "json")


def run(arguments: Namespace) -> bool:
    """Simulate a scene, or what is left of a run, record it if asked to, and print a summary."""
    if arguments.step_by_step:
        return _step_by_step(arguments)
    for option in ("history", "full_speed"):
        if getattr(arguments, option):
            raise SceneError(f"--{option.replace('_', '-')} needs --step-by-step")
    with ExitStack() as held:
        start, options = _begin(arguments, held) if arguments.resume is None else _resume(arguments, held)
        try:
            _carry_out(start, options, arguments)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(*_how_to_go_on(options)) from None
    results = results_of(start.scene, start.statistics, options)
    print(json.dumps(results) if arguments.json else summary_lines(results))
    return False


def _step_by_step(arguments: Namespace) -> bool:
    """Take the steps of a scene one by one."""
    if arguments.scene is None:
        raise SceneError("SCENE is missing")
    for name in _given(arguments, *_NOT_STEP_BY_STEP):
        option = KEPT.get(name, f"--{name}")
        raise SceneError(f"{option} cannot go with --step-by-step")
    scene = _scene(arguments)
    step_by_step(scene, _steps(scene, arguments) or scene.steps, arguments)
    return False


def _scene(arguments: Namespace) -> Scene:
    """Return the scene of a new run."""
    solver = [f"solver.{key}={value}" for key, value in _given(arguments, "order", "method").items()]
    return Scene.load(arguments.scene, [*(arguments.overrides or []), *solver])


def _carry_out(start: Checkpoint, options: RunOptions, arguments: Namespace) -> None:
    """Open what a run writes to, and simulate.

    Bad outputs, and those that another process writes, are refused before Warp starts and compiles kernels.
    """
    with stdout_kept_clean(), ExitStack() as held:
        until = criterion(options.until, start.scene)
        series = _series(start, options, arguments)
        recorder = held.enter_context(runs.open_outputs(options, start.scene, start.statistics))
        observer = None if series is None else held.enter_context(series)
        _simulate(start, options, runs.Outputs(recorder, observer, until), arguments)


def _how_to_go_on(options: RunOptions) -> Iterator[str]:
    """Yield what can be done after an interrupt, with what is on the disk."""
    if options.checkpoint is not None and Path(options.checkpoint).exists():
        yield f"to go on: warpgrains run --resume {shlex.quote(options.checkpoint)}"
    if options.record is not None and Path(f"{options.record}.frames").exists():
        yield f"for the frames so far: warpgrains recover {shlex.quote(options.record + '.frames')}"


def _begin(arguments: Namespace, held: ExitStack) -> tuple[Checkpoint, RunOptions]:
    """Return the start of a new run, and what it is to do; its checkpoint is locked."""
    if arguments.scene is None:
        raise SceneError("SCENE is missing, or --resume FILE")
    if arguments.output is None:
        for name in _given(arguments, "fps", "color_by", "forces", "draw_as"):
            raise SceneError(f"{KEPT[name]} needs --output")
    if (arguments.measure is None) != (arguments.series is None):
        raise SceneError("--measure and --series go together")
    scene = _scene(arguments)
    given = _given(
        arguments, "fps", "color_by", "forces", "draw_as", "checkpoint", "measure", "series", "until"
    )
    given |= _spacing(arguments, arguments.checkpoint, arguments.series)
    options = RunOptions(steps=_steps(scene, arguments) or scene.steps, record=arguments.output, **given)
    if "fps" in given:
        _warn_of_rate(scene, options.fps)
    if options.checkpoint is not None:
        held.enter_context(lock_checkpoint(Path(options.checkpoint)))
    return Checkpoint(scene, first_state(scene), options, RunStatistics()), options


def _resume(arguments: Namespace, held: ExitStack) -> tuple[Checkpoint, RunOptions]:
    """Return where a run was when it left its checkpoint, and what it is to do in all.

    Its checkpoint is locked, and the one that it is to write from now on.
    """
    for name in _given(arguments, *KEPT):
        raise SceneError(f"{KEPT[name]} cannot go with --resume, which continues a run as it was begun")
    kept, other = Path(arguments.resume), arguments.checkpoint
    start = read_checkpoint(kept)
    if start.options is not None:
        held.enter_context(lock_checkpoint(kept))
        start = read_checkpoint(kept)  # the run may have gone on until the lock was free
    if other is not None and (start.options is None or os.path.realpath(other) != os.path.realpath(kept)):
        held.enter_context(lock_checkpoint(Path(other)))
    begun_at = start.state.steps - start.statistics.steps
    planned = start.scene.steps if start.options is None else begun_at + start.options.steps
    end = _steps(start.scene, arguments) or planned
    if end < start.state.steps:
        raise SceneError(f"the run is to end at step {end}: its checkpoint is at step {start.state.steps}")
    options = start.options or RunOptions(steps=planned)
    spacing = _spacing(arguments, options.checkpoint or other, options.series)
    return start, replace(options, steps=end - begun_at, **_given(arguments, "checkpoint"), **spacing)


def _spacing(arguments: Namespace, checkpoint: str | None, series: str | None) -> dict[str, Any]:
    """Return how many steps lie between two checkpoints, and two rows of a series, if it is told."""
    if arguments.every is None:
        return {}
    if checkpoint is series is None:
        raise SceneError("--every needs --checkpoint or --measure")
    spaced = {"every": checkpoint, "measure_every": series}
    return {name: arguments.every for name, file in spaced.items() if file is not None}


def _series(start: Checkpoint, options: RunOptions, arguments: Namespace) -> Series | None:
    """Return the series of a run, if there is one; a resumed run goes on with its rows."""
    if options.measure is None:
        return None
    resume_at = None if arguments.resume is None else start.state.steps
    return Series(options.measure, options.measure_every, options.series, resume_at)


def _given(arguments: Namespace, *names: str) -> dict[str, Any]:
    """Return those options that are given."""
    values = {name: getattr(arguments, name) for name in names}
    return {name: value for name, value in values.items() if value is not None and value is not False}


def _steps(scene: Scene, arguments: Namespace) -> int | None:
    """Return for how many steps the run is asked to be, if it is."""
    if arguments.steps is not None:
        return checks.whole_number("--steps", arguments.steps)
    if arguments.duration is not None:
        return scene.steps_in(checks.positive("--duration", arguments.duration))
    return None


def _simulate(start: Checkpoint, options: RunOptions, outputs: runs.Outputs, arguments: Namespace) -> None:
    start_warp()
    from warpgrains.simulation.simulation import Simulation

    simulation = Simulation(start.scene, arguments.device, arguments.threads)
    simulation.restore(start.state)
    if not simulation.is_compiled:
        print("compiling kernels for such a scene, this first time only ...", file=sys.stderr, flush=True)
    simulation.compile()
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning  # type: ignore[assignment]
        runs.carry_out(simulation, options, start.statistics, outputs, progress=True)


def _show_warning(message: Warning | str, *where: Any) -> None:
    """Say on standard error what the run warns of, above its progress bar."""
    tqdm.write(f"warpgrains: warning: {message}", file=sys.stderr)


def _warn_of_rate(scene: Scene, fps: float) -> None:
    """Say what a recording has instead of the frames a second that are asked for, if it cannot have them."""
    rate = true_rate(scene, fps)
    if rate != fps:
        steps = f"with one frame every step of {scene.dt:g} s there are {rate:.6g}"
        _show_warning(f"--fps {fps:g} cannot be met: {steps}")
