"""What `warpgrains run` tells of a run: as numbers by name, and in lines."""

from dataclasses import asdict
from typing import Any

from warpgrains.console import in_columns
from warpgrains.drawing.frame_times import FrameTimes
from warpgrains.kernels.access import CHECKED
from warpgrains.scene.scene import Scene
from warpgrains.simulation.options import RunOptions
from warpgrains.solver.statistics import RunStatistics, named


def results_of(scene: Scene, statistics: RunStatistics, options: RunOptions) -> dict[str, Any]:
    """Return what there is to tell of a run, by name."""
    summary, overlaps = statistics.summary(options.record), scene.count_overlaps()
    results = {
        "scene": scene.name,
        "grains": scene.n,
        **asdict(summary),
        "overlap_in_radii": summary.overlap / scene.radius.min().item(),
        "overlaps_at_start": {"pairs": overlaps.pairs, "walls": overlaps.walls},
    }
    if CHECKED:
        results["bounds_checked"] = True
    if options.until is not None:
        results["until"] = options.until
    if options.record is not None and options.shows != "still":
        results |= {"frames": statistics.frames, "fps": true_rate(scene, options.rate)}
    return results


def summary_lines(results: dict[str, Any]) -> str:
    """Return the same in aligned lines."""
    start = results["overlaps_at_start"]
    rows = {
        "scene": f"{results['scene']}, {results['grains']} grains",
        "steps": f"{results['steps']}{_ended(results)}",
        "iterations": f"mean {results['iterations_mean']:.1f}, max {results['iterations_max']}",
        "not converged": f"{results['unconverged']} steps{_without_solution(results)}",
        "worst residual": f"{results['residual']:.2e} m/s ({results['gap_error']:.2e} smallest radii a step)",
        "worst overlap": f"{results['overlap']:.2e} m ({results['overlap_in_radii']:.2e} smallest radii)",
        "overlaps at start": f"{start['pairs']} between grains, {start['walls']} with a wall",
        "time": f"{results['seconds']:.2f} s, {results['steps'] / results['seconds']:.0f} steps/s",
        **({"bounds": "every index within its array"} if "bounds_checked" in results else {}),
        "output": "none (-o records one)" if results["output"] is None else _output(results),
    }
    return in_columns(rows)


def _ended(results: dict[str, Any]) -> str:
    if "until" not in results:
        return ""
    return f", {'at' if results['met'] else 'not at'} {results['until']}"


def _output(results: dict[str, Any]) -> str:
    if "frames" not in results:
        return str(results["output"])
    frames = results["frames"]
    return f"{results['output']}, {frames} frame{'s' * (frames > 1)}, {results['fps']:.6g} a second"


def _without_solution(results: dict[str, Any]) -> str:
    grains = results["infeasible_grains"]
    return f", {results['infeasible']} or more have no solution: {named(grains)} cannot fit" if grains else ""


def true_rate(scene: Scene, fps: float) -> float:
    """Return the true rate of a recording that is to have so many frames a second [1/s]."""
    return FrameTimes.of(scene.dt, fps).rate
