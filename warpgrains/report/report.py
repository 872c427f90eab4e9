"""`warpgrains report`: speed against error, measured, drawn and written down."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from matplotlib.figure import Figure
from tqdm import tqdm

from warpgrains.errors import SceneError
from warpgrains.files import draft_of, require_writable_folder, table_text, write_whole
from warpgrains.report.figures import draw_paths, draw_steps
from warpgrains.report.history import follow_history
from warpgrains.report.rows import Budget, Findings
from warpgrains.report.steps import measure_steps
from warpgrains.report.text import markdown
from warpgrains.report.trajectories import measure_frontier, measure_paths
from warpgrains.scene.scene import Scene

DOTS_PER_INCH = 80


def write_report(
    scenes: Sequence[Scene], folder: Path, budget: Budget | None = None, progress: bool = False
) -> list[Path]:
    """Measure speed against error of scenes, write a report of it, and return its files, report.md first.

    These are report.md, steps.csv, trajectories.csv, frontier.csv and two pictures a scene: see `StepRow`,
    `PathRow` and `FrontierRow` for their columns. They are written scene by scene, so that a report that is
    cut short is one of the scenes before.

    Raises
    ------
    SceneError
        Two scenes have one name, the folder cannot be written, or no contact acts in a scene.
    SimulationError
        A step failed.
    """
    _prepare(scenes, folder)
    budget = budget or Budget()
    found = Findings()
    pictures: list[Path] = []
    with tqdm(total=len(scenes), disable=not progress, unit="scene") as bar:
        for scene in scenes:
            for stage in _measure(scene, budget, found):
                bar.set_postfix_str(f"{scene.name}: {stage}")
            own = found.of(scene.name)
            pictures.append(_write_picture(folder / f"{scene.name}-steps.png", draw_steps(own.steps)))
            pictures.append(
                _write_picture(folder / f"{scene.name}-dt.png", draw_paths(own.paths, own.frontier))
            )
            texts = _write_texts(folder, found, budget)
            bar.update()
    return texts + pictures


def _prepare(scenes: Sequence[Scene], folder: Path) -> None:
    """Make the folder of a report, unless it is there; raise SceneError if it cannot hold one."""
    names = [scene.name for scene in scenes]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"two scenes are called '{name}': a report tells scenes apart by their names")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"output folder '{folder}' cannot be made: {error.strerror}") from error
    require_writable_folder(folder)


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
        "steps.csv": table_text([*map(asdict, found.steps)]),
        "trajectories.csv": table_text([*map(asdict, found.paths)]),
        "frontier.csv": table_text([*map(asdict, found.frontier)]),
    }
    for name, text in texts.items():
        write_whole(folder / name, text.encode())
    return [folder / name for name in texts]


def _write_picture(path: Path, figure: Figure) -> Path:
    """Put a picture under its name, whole; return the name."""
    with draft_of(path) as draft:
        figure.savefig(draft, dpi=DOTS_PER_INCH, pil_kwargs={"optimize": True})
    return path
