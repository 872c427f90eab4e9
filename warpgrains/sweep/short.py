"""Short runs: in large groups, without a folder or a lock of their own; what a group did is one file.

While a group is advanced, one thread sets up the next and another writes what the last one did. The runs of a
group that is cut off are done again. Those that take long, or fail, go on as runs with a folder.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, suppress
from itertools import islice
from time import perf_counter
from typing import NamedTuple

import numpy as np

from warpgrains.analysis.snapshot import Snapshot
from warpgrains.batch.resident import ResidentSet
from warpgrains.errors import SceneError, SimulationError
from warpgrains.files import csv_line
from warpgrains.locks import Claims
from warpgrains.scene import reader
from warpgrains.scene.scene import GEOMETRY, Scene
from warpgrains.simulation.options import ExecutionOptions, OnProgress
from warpgrains.solver.threads import cores
from warpgrains.solver.tuning import find_device, paying_threads
from warpgrains.sweep.folder import GRAINS, SweepFolder, writer
from warpgrains.sweep.parts import Lines
from warpgrains.sweep.results import result
from warpgrains.sweep.run import Start
from warpgrains.sweep.sweep import Run

SHORT = 20.0  # s; a run that is not done by then gets a folder and checkpoints
GROUP = 1.0  # s that a group is to take
FIRST_WIDTH, WIDTH, GROWTH = 16, 4096, 8  # runs in a group, and by how much the next one may be wider
MOST_GRAINS = 400_000  # in a group
ALIKE = 256  # scenes kept for others with the same grains

_NO_PAIRS = np.zeros((0, 2), np.int32)


class Group(NamedTuple):
    """Runs that are advanced together."""

    runs: list[Run]
    scenes: list[Scene]
    resident: ResidentSet | None
    """None if there are none."""


class ShortRuns:
    """Carries out short runs of a sweep.

    Parameters
    ----------
    folder, execution, on_progress
        As for `finish_runs`.

    Attributes
    ----------
    left : dict of str to str
        By the numbers of the runs that were left to other processes, why.
    long : list of Start
        What is to be carried out as runs with a folder.
    """

    def __init__(self, folder: SweepFolder, execution: ExecutionOptions, on_progress: OnProgress):
        self.left: dict[str, str] = {}
        self.long: list[Start] = []
        self._folder, self._on_progress = folder, on_progress
        self._threads, self._device = execution.threads or cores(), find_device(execution.device)
        self._alike: dict[str, Scene] = {}
        folder.parts.path.mkdir(parents=True, exist_ok=True)
        self._claims = Claims(folder.parts.path / ".claims")

    def finish(self, runs: Iterable[Run]) -> None:
        """Carry out runs to their end, but for those that are left, or long."""
        waiting, width = iter(runs), FIRST_WIDTH
        written: Future[None] | None = None
        with closing(self._claims), ThreadPoolExecutor(1) as ahead, ThreadPoolExecutor(1) as behind:
            following: Future[Group] | None = ahead.submit(self._set_up, list(islice(waiting, width)))
            while following is not None:
                group, chunk = following.result(), list(islice(waiting, width))
                following = ahead.submit(self._set_up, chunk) if chunk else None
                start = perf_counter()
                self._advance(group)
                width = _width(group, width, perf_counter() - start)
                if written is not None:
                    written.result()
                written = behind.submit(self._write, group)
            if written is not None:
                written.result()

    def _set_up(self, runs: list[Run]) -> Group:
        """Put the scenes of runs in memory."""
        free = self._free(runs)
        scenes = {run.number: scene for run in free if (scene := self._scene(run)) is not None}
        resident = None
        if scenes:
            try:
                resident = ResidentSet(dict(enumerate(scenes.values())), self._device, self._threads, 1)
            except SimulationError:  # they have no room together
                self.long += [Start(run) for run in free if run.number in scenes]
                scenes = {}
        return Group([run for run in free if run.number in scenes], list(scenes.values()), resident)

    def _free(self, runs: list[Run]) -> list[Run]:
        """Return the runs that nobody else has or has finished, and that have no folder."""
        begun = self._folder.begun()
        self.long += [Start(run) for run in runs if run.number in begun]
        runs = [run for run in runs if run.number not in begun]
        taken = set(self._claims.take(run.number for run in runs))
        self._folder.parts.refresh(taken)
        taken -= self._folder.parts.lines.keys()
        others = [run for run in runs if run.number not in taken]
        self.left |= {str(run.number): "another process has it" for run in others}
        self._on_progress(len(others))
        return [run for run in runs if run.number in taken]

    def _scene(self, run: Run) -> Scene | None:
        """Return the scene of a run; None if it is none, large, or has no label on one line: a long run."""
        scene = None
        if not any("\n" in label or "\r" in label for label in run.labels().values()):
            with suppress(SceneError):
                scene = self._built(run)
        if scene is None or paying_threads(scene) > 1:
            self.long.append(Start(run))
            return None
        return scene

    def _built(self, run: Run) -> Scene:
        document = run.sections(GRAINS)
        given = reader.settings(document)
        settings = {name: value for name, value in given.items() if name not in GEOMETRY}
        settings["name"] = run.base.name
        geometry = {name: value for name, value in given.items() if name in GEOMETRY}
        key = repr((document["grains"], geometry))
        alike = self._alike.get(key)
        if alike is not None:
            return alike.with_settings(**settings)
        scene = Scene(**geometry, **reader.grains(document, given, self._folder.path), **settings)
        if len(self._alike) == ALIKE:
            del self._alike[next(iter(self._alike))]
        self._alike[key] = scene
        return scene

    def _advance(self, group: Group) -> None:
        """Advance a group to its end, or for as long as a run is short."""
        if (resident := group.resident) is None:
            return
        steps, end = [scene.steps for scene in group.scenes], perf_counter() + SHORT
        share = len(steps) / sum(steps)

        def glance(done: int) -> None:
            self._on_progress(share * done)
            if perf_counter() > end:
                resident.halt()

        resident.work(steps, glance)

    def _write(self, group: Group) -> None:
        """Write what came of a group."""
        if group.resident is not None:
            lines: Lines = {}
            for k, run in enumerate(group.runs):
                line = self._line(group.resident, k, run, group.scenes[k])
                lines |= {} if line is None else {run.number: line}
            self._folder.parts.write(lines, writer())
            self._claims.give_back(lines)

    def _line(self, resident: ResidentSet, k: int, run: Run, scene: Scene) -> bytes | None:
        """Return the line of a run; None if it is not at its end, which is told as of a long run."""
        engine, place = resident.place[k]
        done, error = engine.statistics(place), engine.error(place)
        if error is not None or done.steps < scene.steps:
            self._on_progress(-done.steps / scene.steps)
            self.long.append(Start(run, resident.state(k), done, error))
            return None
        position, velocity = engine.grains(place, "position"), engine.grains(place, "velocity")
        end = Snapshot(
            scene=scene,
            steps=done.steps,
            position=position,
            velocity=velocity,
            start=position - scene.dt * velocity,
            pair=_NO_PAIRS,
            force=np.zeros(0),
            wall_force=scene.mass * engine.wall_correction(place) / scene.dt,
        )
        return csv_line(result(run.labels(), end, done).values())


def _width(group: Group, width: int, seconds: float) -> int:
    """Return how many runs the next group is to have."""
    grains = sum(scene.n for scene in group.scenes) / max(1, len(group.scenes))
    wanted = width * min(GROWTH, GROUP / max(seconds, 1e-3))
    return max(1, min(WIDTH, int(wanted), int(MOST_GRAINS / max(1.0, grains))))
