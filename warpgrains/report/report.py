"""`warpgrains report`: speed against error, measured, drawn and written down."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from tqdm import tqdm

from warpgrains.report.figures import draw_paths, draw_steps
from warpgrains.report.files import prepare, write_picture, write_text
from warpgrains.report.frontier import measure_frontier
from warpgrains.report.history import follow_history
from warpgrains.report.options import Budget
from warpgrains.report.steps import measure_steps
from warpgrains.report.text import Findings, csv_text, markdown
from warpgrains.report.trajectories import measure_paths
from warpgrains.scene.scene import Scene


def write_report(
    scenes: Sequence[Scene], folder: Path, budget: Budget | None = None, progress: bool = False
) -> list[Path]:
    """Measure speed against error of scenes, and write a report of it.

    Parameters
    ----------
    scenes : sequence of Scene
        With different names.
    folder : Path
        Where report.md, steps.csv, trajectories.csv, frontier.csv and two pictures a scene are put: see
        `StepRow`, `PathRow` and `FrontierRow` for their columns. They are written scene by scene, so that a
        report that is cut short is one of the scenes before.
    budget : Budget, optional
        How much is measured.
    progress : bool
        Whether to show a progress bar on standard error.

    Returns
    -------
    list of Path
        The files, report.md first.

    Raises
    ------
    SceneError
        The folder cannot be written, or no contact acts in a scene.
    SimulationError
        A step failed.
    """
    prepare(scenes, folder)
    budget = budget or Budget()
    found = Findings()
    pictures: list[Path] = []
    with tqdm(total=len(scenes), disable=not progress, unit="scene") as bar:
        for scene in scenes:
            for stage in _measure(scene, budget, found):
                bar.set_postfix_str(f"{scene.name}: {stage}")
            own = found.of(scene.name)
            pictures.append(write_picture(folder / f"{scene.name}-steps.png", draw_steps(own.steps)))
            pictures.append(
                write_picture(folder / f"{scene.name}-dt.png", draw_paths(own.paths, own.frontier))
            )
            texts = _write_texts(folder, found, budget)
            bar.update()
    return texts + pictures


def _measure(scene: Scene, budget: Budget, found: Findings) -> Iterator[str]:
    """Add what is found of a scene; say again and again what is being measured."""
    yield "history"
    history = follow_history(scene, budget.history)
    for snapshot in history.snapshots:
        for step in measure_steps(scene, snapshot, budget):
            found.steps.append(step)
            yield f"{snapshot.name}, {step.method}, {step.order}, {step.iterations} iterations"
    for path in measure_paths(scene, history.first, budget.horizon):
        found.paths.append(path)
        yield f"trajectory, dt {path.dt:.3g} s"
    for run in measure_frontier(scene, history.hardest, budget.horizon):
        found.frontier.append(run)
        yield f"equal work, {run.method}, dt {run.dt:.3g} s"


def _write_texts(folder: Path, found: Findings, budget: Budget) -> list[Path]:
    """Write what is found so far, in the place of what was."""
    texts = {
        "report.md": markdown(found, budget),
        "steps.csv": csv_text(found.steps),
        "trajectories.csv": csv_text(found.paths),
        "frontier.csv": csv_text(found.frontier),
    }
    return [write_text(folder / name, text) for name, text in texts.items()]
