"""Short runs: in large groups, without a folder or a lock of their own; what a group did is one file.

While a group is advanced, another thread sets up the next. What a group did is written before the next one is
advanced: of a process that is killed, one is to be done again. Runs that take long, or fail, go on as runs
with a folder.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, suppress
from itertools import islice
from time import perf_counter
from typing import Any, NamedTuple

from warpgrains.analysis.snapshot import snapshot
from warpgrains.batch.resident import Done, ResidentSet
from warpgrains.errors import SceneError, SimulationError
from warpgrains.files import csv_line
from warpgrains.locks import Claims
from warpgrains.scene.reader import document_fields
from warpgrains.scene.scene import Scene
from warpgrains.simulation.options import ExecutionOptions, OnProgress
from warpgrains.simulation.until import Criterion, criterion
from warpgrains.solver.threads import cores
from warpgrains.solver.tuning import find_device, paying_threads
from warpgrains.sweep.folder import GRAINS, SweepFolder, writer
from warpgrains.sweep.parts import Lines
from warpgrains.sweep.results import columns_of, result, results
from warpgrains.sweep.run_folder import Start
from warpgrains.sweep.sweep import Base, Run

SHORT = 20.0  # s; a run that is not done by then gets a folder and checkpoints
GROUP = 1.0  # s that a group is to take
FIRST_WIDTH, WIDTH, GROWTH = 16, 4096, 8  # runs in a group, and by how much the next one may be wider
MOST_GRAINS = 200_000  # in a group
ALIKE = 256  # scenes kept for others with the same grains


class Member(NamedTuple):
    """A run of a group."""

    run: Run
    head: bytes
    """Its labels, which its line begins with."""
    scene: Scene
    until: Criterion | None
    """What ends it before its last step."""


class Group(NamedTuple):
    """Runs that are advanced together."""

    members: list[Member]
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
        self._alike: dict[tuple[Base, str], Scene] = {}
        self._ends: dict[int, Done] = {}
        folder.parts.path.mkdir(parents=True, exist_ok=True)
        self._claims = Claims(folder.parts.path / ".claims")

    def finish(self, runs: Iterable[Run]) -> None:
        """Carry out runs to their end, but for those that are left, or long."""
        waiting, width = iter(runs), FIRST_WIDTH
        with closing(self._claims), ThreadPoolExecutor(1) as ahead:
            following: Future[Group] | None = ahead.submit(self._set_up, list(islice(waiting, width)))
            while following is not None:
                group, chunk = following.result(), list(islice(waiting, width))
                following = ahead.submit(self._set_up, chunk) if chunk else None
                start = perf_counter()
                self._advance(group)
                width = _width(group, width, perf_counter() - start)
                self._write(group)

    def _set_up(self, runs: list[Run]) -> Group:
        """Put the scenes of runs in memory."""
        members = [member for run in self._free(runs) if (member := self._member(run)) is not None]
        resident = None
        if members:
            scenes = {k: member.scene for k, member in enumerate(members)}
            try:
                resident = ResidentSet(scenes, self._device, self._threads, 1)
            except SimulationError:  # they have no room together
                self.long += [Start(member.run) for member in members]
                members = []
        return Group(members, resident)

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

    def _member(self, run: Run) -> Member | None:
        """Return a run of a group; None if it is no scene, large, or has no label on one line: a long run."""
        member, head = None, csv_line(run.labels().values())[:-1]
        if b"\n" not in head and b"\r" not in head:
            with suppress(SceneError):
                scene = self._scene(run)
                member = Member(run, head, scene, criterion(self._folder.until, scene))
        if member is None or paying_threads(member.scene) > 1:
            self.long.append(Start(run))
            return None
        return member

    def _scene(self, run: Run) -> Scene:
        """Return the scene of a run, made of one that has the same grains and walls where there is one."""
        settings: dict[str, Any] = {}
        of_grains = []
        for name, value in run.values.items():
            section, _, key = name.partition(".")
            if section in ("domain", "grains"):
                of_grains.append(value)
            else:
                settings[key] = value
        alike = self._alike.get((run.base, repr(of_grains)))
        if alike is not None:
            return alike.with_settings(**settings)
        fields = document_fields(run.sections(GRAINS), self._folder.path)
        scene = Scene(**fields, name=run.base.name)
        if len(self._alike) == ALIKE:
            del self._alike[next(iter(self._alike))]
        self._alike[run.base, repr(of_grains)] = scene
        return scene

    def _advance(self, group: Group) -> None:
        """Advance a group to its end, or for as long as a run is short."""
        if (resident := group.resident) is None:
            return
        steps, end = [member.scene.steps for member in group.members], perf_counter() + SHORT
        share = len(steps) / sum(steps)

        def glance(done: int) -> None:
            self._on_progress(share * done)
            if perf_counter() > end:
                resident.halt()

        criteria = [member.until for member in group.members if member.until is not None]
        if criteria:
            self._ends = resident.work_until(criteria, steps, glance)
        else:
            resident.work(steps, glance)

    def _write(self, group: Group) -> None:
        """Write what came of a group; runs that are not at their end go on as long ones."""
        if (resident := group.resident) is None:
            return
        lines = (
            self._lines(group, resident) if self._folder.until is None else self._lines_until(group, resident)
        )
        self._folder.parts.write(lines, writer())
        self._claims.give_back(lines)

    def _lines(self, group: Group, resident: ResidentSet) -> Lines:
        """Return the lines of the runs of a group that are at their ends; the others go on."""
        lines: Lines = {}
        for engine, numbers, places in resident.alike():
            ended = engine.left[places] == 0
            for k in numbers[~ended].tolist():
                self._go_on(group.members[k], resident, resident.done(k))
            if ended.any():
                which = numbers[ended].tolist()
                each = (snapshot(group.members[k].scene, resident.state(k)) for k in which)
                rows = results(engine.ends(places[ended]), each, columns_of(self._folder.more))
                for k, cells in zip(which, rows, strict=True):
                    member = group.members[k]
                    lines[member.run.number] = b"%b,%b\n" % (member.head, ",".join(cells).encode())
        return lines

    def _lines_until(self, group: Group, resident: ResidentSet) -> Lines:
        """Return the same where runs end at a criterion, after different numbers of steps."""
        lines: Lines = {}
        for k, end in self._ends.items():
            run, _, scene, _ = group.members[k]
            steps = end.statistics.steps
            if end.statistics.met or steps == scene.steps:
                row = result(
                    run.labels(), snapshot(scene, resident.state(k)), end.statistics, self._folder.more
                )
                lines[run.number] = csv_line(row.values())
                self._on_progress(1.0 - steps / scene.steps)
            else:
                self._go_on(group.members[k], resident, end)
        return lines

    def _go_on(self, member: Member, resident: ResidentSet, done: Done) -> None:
        """Leave a run to those that have folders, from where it is."""
        self._on_progress(-done.statistics.steps / member.scene.steps)
        self.long.append(Start(member.run, resident.state(done.k), done.statistics, done.error))


def _width(group: Group, width: int, seconds: float) -> int:
    """Return how many runs the next group is to have."""
    grains = sum(member.scene.n for member in group.members) / max(1, len(group.members))
    wanted = width * min(GROWTH, GROUP / max(seconds, 1e-3))
    return max(1, min(WIDTH, int(wanted), int(MOST_GRAINS / max(1.0, grains))))
