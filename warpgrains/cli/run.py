"""`warpgrains run`: begin or resume a run, and print its summary."""

from __future__ import annotations

import json
import shlex
import sys
import warnings
from argparse import Namespace
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from tqdm import tqdm

from warpgrains.base import checks
from warpgrains.base.console import exit_on_interrupt, in_columns, stdout_to_stderr
from warpgrains.base.errors import InputError, written_as
from warpgrains.base.files import require_writable_path
from warpgrains.base.frame_log import log_of
from warpgrains.base.shown import number_of
from warpgrains.base.warp_start import start_warp
from warpgrains.cli.step_by_step import step_by_step
from warpgrains.drawing.kinds import FILM, RECORDING
from warpgrains.drawing.looks import with_style
from warpgrains.scene.fields import KEY_OF
from warpgrains.scene.scene import Scene
from warpgrains.simulation.options import FLAGS, RunOptions, require_needed, spacing, steps_of
from warpgrains.simulation.run import ResumedRun, SceneRun
from warpgrains.solver.statistics import Summary

DURATION = {"duration": "--duration"}
OF_SCENE = {"scene": "SCENE", "overrides": "--set"}
OF_SCENE |= {name: f"--{name}" for name in ("order", "method", "separate")}


def run(arguments: Namespace) -> bool:
    """Start or resume a run, record it if requested, and print a summary."""
    if arguments.step_by_step:
        return _step_by_step(arguments)
    for option in ("history", "full_speed"):
        if getattr(arguments, option):
            raise InputError(f"--{option.replace('_', '-')} needs --step-by-step")
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning  # type: ignore[assignment]
        run = _begun(arguments) if arguments.resume is None else _resumed(arguments)
        try:
            summary = _carry_out(run, arguments)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(*_commands_to_continue(run)) from None
    results = results_of(run, summary)
    print(json.dumps(results) if arguments.json else summary_lines(results))
    return False


def _step_by_step(arguments: Namespace) -> bool:
    """Run a scene interactively, one step per key press."""
    if arguments.scene is None:
        raise InputError("SCENE is missing: give a file or a name, listed by `warpgrains scenes`")
    for name in _given(arguments, *FLAGS, "style", "resume", "json"):
        raise InputError(f"{FLAGS.get(name, f'--{name}')} cannot be combined with --step-by-step")
    scene = _scene(arguments)
    if arguments.separate:
        scene = _separated(scene)
    step_by_step(scene, steps_of(scene, *_length(arguments)), arguments)
    return False


def _scene(arguments: Namespace) -> Scene:
    solver = [f"solver.{key}={value}" for key, value in _given(arguments, "order", "method").items()]
    return Scene.load(arguments.scene, [*(arguments.overrides or []), *solver])


def _separated(scene: Scene) -> Scene:
    with stdout_to_stderr():
        from warpgrains.packings.separate import separate

        separation = separate(scene)
    print(f"separated the grains: largest shift {separation.shift:.2e} m", file=sys.stderr, flush=True)
    return separation.scene


def _carry_out(run: SceneRun, arguments: Namespace) -> Summary:
    """Open the outputs of a run, then compile kernels and simulate."""
    if run.options.shows is RECORDING:
        with exit_on_interrupt():  # during the import, USD would only print an interrupt and continue
            import_module("warpgrains.usd.recorder")
    with stdout_to_stderr(), written_as(FLAGS | {"threads": "--threads"}), run.opened():
        start_warp()
        from warpgrains.simulation.simulation import Simulation

        simulation = Simulation(run.scene, arguments.device, arguments.threads, run.state)
        if not simulation.is_compiled:
            first = "compiling kernels for this kind of scene, the first time only ..."
            print(first, file=sys.stderr, flush=True)
        simulation.compile()
        return run.carry_out(simulation, progress=True)


def _commands_to_continue(run: SceneRun) -> Iterator[str]:
    """Yield the commands that continue an interrupted run, or recover its frames."""
    options, frames = run.options, run.statistics.frames
    if options.record is not None and options.shows is FILM and frames > 1:
        kept = "a run with -o FILE.usdc --checkpoint FILE.npz can be continued, and plot makes its film"
        yield f"'{options.record}' shows the {frames} frames so far; {kept}"
    if options.checkpoint is not None and Path(options.checkpoint).exists():
        yield f"to continue: warpgrains run --resume {shlex.quote(options.checkpoint)}"
    if options.record is not None and (log := log_of(Path(options.record))).exists():
        yield f"to recover the frames so far: warpgrains recover {shlex.quote(str(log))}"


def _begun(arguments: Namespace) -> SceneRun:
    if arguments.scene is None:
        raise InputError("SCENE is missing: give a scene, or --resume FILE to continue a run")
    given = _given(arguments, *FLAGS)
    every = given.pop("every", None)
    require_needed(given, FLAGS.__getitem__)
    given = with_style(given, arguments.style)
    given |= spacing(every, arguments.checkpoint, arguments.series, FLAGS.__getitem__)
    scene = _scene(arguments)
    with written_as(KEY_OF if arguments.duration is None else DURATION):
        steps = steps_of(scene, *_length(arguments))
    with written_as(FLAGS | {"measure_every": "--every"}):
        run = SceneRun(scene, RunOptions(steps=steps, **given))
    if arguments.separate:  # may take long, so check outputs before
        for name in given.keys() & {"record", "checkpoint", "series"}:
            require_writable_path("output", Path(given[name]))
        run = SceneRun(_separated(scene), run.options)
    return run


def _resumed(arguments: Namespace) -> SceneRun:
    for name in _given(arguments, *OF_SCENE):
        raise InputError(f"{OF_SCENE[name]} cannot be combined with --resume: the checkpoint has a scene")
    given = with_style(_given(arguments, *FLAGS), arguments.style)
    with written_as(DURATION):
        return ResumedRun(arguments.resume, *_length(arguments), given, FLAGS.__getitem__)


def _given(arguments: Namespace, *names: str) -> dict[str, Any]:
    values = {name: getattr(arguments, name) for name in names}
    return {
        name: one for name, one in values.items() if one is not None and (one is not False or name in FLAGS)
    }


def _length(arguments: Namespace) -> tuple[int | None, float | None]:
    """Return the options `--steps` and `--duration` [s], the length of the whole run; None if not given."""
    if arguments.steps is not None:
        checks.whole_number("--steps", arguments.steps)
    if arguments.duration is not None:
        checks.positive("--duration", arguments.duration)
    return arguments.steps, arguments.duration


def _show_warning(message: Warning | str, *where: Any) -> None:
    """Print a warning on standard error above the progress bar."""
    tqdm.write(f"warpgrains: warning: {message}", file=sys.stderr)


def results_of(run: SceneRun, summary: Summary) -> dict[str, Any]:
    """Return the results of a run by name, as `--json` prints them."""
    scene, options, overlaps = run.first_scene, run.options, run.first_scene.count_overlaps()
    results = {
        "scene": scene.name,
        "grains": scene.n,
        **summary.results(),
        "overlap_in_radii": summary.overlap / scene.smallest_radius,
        "overlaps_at_start": overlaps._asdict(),
        **{name: [own._asdict() for own in flow] for name, flow in run.flows.items() if flow},
    }
    if options.until is not None:
        results["until"] = options.until
    if run.times is not None:
        results |= {"frames": summary.frames, "fps": run.times.played, "slow": run.times.slow}
    return results


def summary_lines(results: dict[str, Any]) -> str:
    start, output = results["overlaps_at_start"], results["output"]
    largest = f", up to {start['largest']:.2e} m" if start["largest"] else ""
    ended, shown = "", "none (-o records one)" if output is None else str(output)
    if "until" in results:
        ended = f", {'at' if results['met'] else 'not at'} {results['until']}"
    if "frames" in results:
        shown += f", {number_of(results['frames'], 'frame')}, {results['fps']:.6g} a second"
        shown += f", {results['slow']:g} times slower" if results["slow"] != 1.0 else ""
    rows = {
        "scene": f"{results['scene']}, {number_of(results['grains'], 'grain')}",
        "steps": f"{results['steps']}{ended}",
        "iterations": f"mean {results['iterations_mean']:.1f}, max {results['iterations_max']}",
        "not converged": number_of(results["unconverged"], "step"),
        "worst residual": f"{results['residual']:.2e} m/s ({results['gap_error']:.2e} smallest radii a step)",
        "worst overlap": f"{results['overlap']:.2e} m ({results['overlap_in_radii']:.2e} smallest radii)",
        "overlaps at start": f"{start['pairs']} between grains, {start['walls']} with a wall{largest}",
        "time": f"{results['seconds']:.2f} s, {results['steps'] / results['seconds']:.0f} steps/s",
        **_of_sources(**{name: results.get(name, []) for name in ("sources", "sinks")}),
        "output": shown,
    }
    return in_columns(rows)


def _of_sources(sources: list[dict[str, int]], sinks: list[dict[str, float]]) -> dict[str, str]:
    """Return the lines "sources" and "sinks" of the summary, by name; none without these.

    `sources` and `sinks` hold the counts of each source and of each sink.
    """
    rows = {}
    if sources:
        entered, missed, waiting = (
            sum(own[key] for own in sources) for key in ("entered", "missed", "waiting")
        )
        rows["sources"] = f"{number_of(entered, 'grain')}; {missed} found no room, {waiting} wait for it"
    if sinks:
        rows["sinks"] = f"{number_of(sum(int(own['grains']) for own in sinks), 'grain')}"
        rows["sinks"] += f", {sum(own['mass'] for own in sinks):.6g} kg"
    return rows
