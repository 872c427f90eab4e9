"""`warpgrains report`: speed against error, measured, drawn and written down."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from tqdm import tqdm

from warpgrains.report_files import prepare, write_picture, write_text
from warpgrains.report_frontier import FrontierRow, measure_frontier
from warpgrains.report_moments import follow_course
from warpgrains.report_options import Effort
from warpgrains.report_paths import PathRow, measure_paths
from warpgrains.report_plots import draw_paths, draw_steps
from warpgrains.report_steps import StepRow, measure_steps
from warpgrains.report_text import csv_text, markdown
from warpgrains.scene import Scene


def write_report(
    scenes: Sequence[Scene], folder: Path, effort: Effort | None = None, progress: bool = False
) -> list[Path]:
    """Measure speed against error of scenes, and write a report of it.

    Parameters
    ----------
    scenes : sequence of Scene
        With different names.
    folder : Path
        Where report.md, steps.csv, trajectories.csv, frontier.csv and two pictures a scene are put: see
        `StepRow`, `PathRow` and `FrontierRow` for their columns.
    effort : Effort, optional
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
    effort = effort or Effort()
    steps: list[StepRow] = []
    paths: list[PathRow] = []
    frontier: list[FrontierRow] = []
    with tqdm(total=len(scenes), disable=not progress, unit="scene") as bar:
        for scene in scenes:
            for stage, rows in _measure(scene, effort, steps, paths, frontier):
                bar.set_postfix_str(f"{scene.name}, {stage}: {rows} rows")
            bar.update()
    texts = {
        "report.md": markdown(steps, paths, frontier, effort),
        "steps.csv": csv_text(steps),
        "trajectories.csv": csv_text(paths),
        "frontier.csv": csv_text(frontier),
    }
    written = [write_text(folder / name, text) for name, text in texts.items()]
    for scene in scenes:
        own_steps = [row for row in steps if row.scene == scene.name]
        written.append(write_picture(folder / f"{scene.name}-steps.png", draw_steps(own_steps)))
        own_paths = [row for row in paths if row.scene == scene.name]
        own_frontier = [row for row in frontier if row.scene == scene.name]
        written.append(write_picture(folder / f"{scene.name}-dt.png", draw_paths(own_paths, own_frontier)))
    return written


def _measure(
    scene: Scene,
    effort: Effort,
    steps: list[StepRow],
    paths: list[PathRow],
    frontier: list[FrontierRow],
) -> Iterator[tuple[str, int]]:
    """Add the rows of a scene; yield what is being measured, and how many rows there are."""
    yield "course", 0
    course = follow_course(scene, effort.course)
    for moment in course.moments:
        for step in measure_steps(scene, moment, effort):
            steps.append(step)
            yield moment.name, len(steps)
    for path in measure_paths(scene, course.first, effort.horizon):
        paths.append(path)
        yield "trajectories", len(paths)
    for run in measure_frontier(scene, course.hardest, effort.horizon):
        frontier.append(run)
        yield "equal work", len(frontier)
