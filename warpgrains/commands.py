"""What the subcommands do. Each returns whether something is wrong; heavy imports wait until one runs."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from warpgrains.console import start_warp, stdout_kept_clean

if TYPE_CHECKING:
    from warpgrains.scene import Scene
    from warpgrains.simulation import Summary


def run(arguments: Namespace) -> bool:
    """Simulate a scene, record it if asked to, and print a summary."""
    scene = _load_scene(arguments)
    steps = _steps(scene, arguments)
    if arguments.output is not None:
        _refuse_bad_output(scene, arguments)
    with stdout_kept_clean():
        summary = _simulate(scene, steps, arguments)
    results = _results(scene, summary)
    print(json.dumps(results) if arguments.json else _lines(results))
    return False


def check(arguments: Namespace) -> bool:
    """Print what is wrong with a recording, a line a problem."""
    from warpgrains.inspection import inspect_recording

    problems = inspect_recording(arguments.file)
    for problem in problems or ["nothing is wrong"]:
        print(f"{arguments.file}: {problem}")
    return bool(problems)


def _load_scene(arguments: Namespace) -> Scene:
    from warpgrains.scene import Scene

    order = [] if arguments.order is None else [f"solver.order={arguments.order}"]
    return Scene.load(arguments.scene, [*arguments.overrides, *order])


def _steps(scene: Scene, arguments: Namespace) -> int:
    from warpgrains import checks

    if arguments.steps is not None:
        return checks.whole_number("--steps", arguments.steps)
    if arguments.duration is not None:
        return scene.steps_in(checks.positive("--duration", arguments.duration))
    return scene.steps


def _refuse_bad_output(scene: Scene, arguments: Namespace) -> None:
    """Raise what recording would raise, before Warp is started and kernels are compiled."""
    from warpgrains.recording import Recorder

    Recorder(arguments.output, scene, arguments.fps)


def _simulate(scene: Scene, steps: int, arguments: Namespace) -> Summary:
    start_warp()
    from warpgrains.kernel_cache import load_kernels
    from warpgrains.simulation import Simulation

    simulation = Simulation(scene, arguments.device)
    load_kernels(scene, arguments.device)
    progress = sys.stderr.isatty()
    return simulation.run(steps, record=arguments.output, fps=arguments.fps, progress=progress)


def _results(scene: Scene, summary: Summary) -> dict[str, Any]:
    overlaps = scene.count_overlaps()
    return {
        "scene": scene.name,
        "grains": scene.n,
        **asdict(summary),
        "overlap_in_radii": summary.overlap / scene.radius.min().item(),
        "overlaps_at_start": {"pairs": overlaps.pairs, "walls": overlaps.walls},
    }


def _lines(results: dict[str, Any]) -> str:
    start = results["overlaps_at_start"]
    rows = {
        "scene": f"{results['scene']}, {results['grains']} grains",
        "steps": f"{results['steps']}",
        "iterations": f"mean {results['iterations_mean']:.1f}, max {results['iterations_max']}",
        "not converged": f"{results['unconverged']} steps",
        "worst overlap": f"{results['overlap']:.2e} m ({results['overlap_in_radii']:.2e} smallest radii)",
        "overlaps at start": f"{start['pairs']} between grains, {start['walls']} with a wall",
        "time": f"{results['seconds']:.2f} s, {results['steps'] / results['seconds']:.0f} steps/s",
        "output": results["output"] or "none (-o records one)",
    }
    return "\n".join(f"{name:<17} {value}" for name, value in rows.items())
