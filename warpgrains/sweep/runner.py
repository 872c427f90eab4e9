"""Runs of a sweep in one process, in groups.

A group of runs is advanced for 20 s at most, while another thread prepares the next group. Then the results
of the runs that have ended or failed are written to one shard. Each other run gets a folder with a checkpoint
and continues in a later group. So a killed process loses 20 s at most.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from time import perf_counter
from typing import Any

from warpgrains.analysis.quantities import require_quantities
from warpgrains.base.errors import InputError, LockedError, MissingExtraError, written_as
from warpgrains.base.locks import RunLocks
from warpgrains.base.warp_start import find_device
from warpgrains.batch.loaded_scenes import team_size
from warpgrains.scene.fields import KEY_OF
from warpgrains.scene.reader import document_fields
from warpgrains.scene.scene import Scene
from warpgrains.solver.exact.solver import exact_solver
from warpgrains.solver.memory import OutOfMemoryError
from warpgrains.solver.threads import cores
from warpgrains.sweep.execution import ExecutionOptions, OnFraction, next_size
from warpgrains.sweep.group import Group
from warpgrains.sweep.results import failure
from warpgrains.sweep.sweep import GRAINS, BaseScene, Run
from warpgrains.sweep.sweep_folder import SweepFolder
from warpgrains.sweep.sweep_run import SweepRun

LIMIT = 20.0  # largest duration of a group [s]
GROUP = 1.0  # intended duration of a group [s]
LEAST_WIDTH, WIDTH = 16, 4096  # runs in a group
WIDTH_OF_FOLDERS = 64  # most runs in a group, if runs have open outputs
MOST_GRAINS = 200_000  # in a group
CACHED_SCENES = 256  # scenes kept to derive scenes with the same grains and walls


def finish_runs(
    folder: SweepFolder, runs: Iterable[Run], execution: ExecutionOptions, on_progress: OnFraction
) -> dict[int, str]:
    """Execute runs, from checkpoints if any; return why runs remain unfinished, by number of the run.

    A run that fails is finished: the failure is its result. Runs that another process holds, or whose files
    cannot be used, remain unfinished.
    """
    runner = Runner(folder, runs, execution, on_progress)
    with runner.held, ThreadPoolExecutor(1) as ahead:

        def prepare_next(width: int) -> tuple[int, Future[Group]] | None:
            chosen = runner.choose(width)
            return (len(chosen), ahead.submit(runner.prepare, chosen)) if chosen else None

        width = runner.narrowest
        following = prepare_next(width)
        while following is not None:
            size, future = following
            group = future.result()
            runner.load(group)
            following, start = prepare_next(width), perf_counter()
            grains = sum(one.scene.n for one in group.members)
            runner.carry_out(group)
            most = min(runner.widest, MOST_GRAINS * size // max(1, grains))
            width = next_size(size, perf_counter() - start, GROUP, most, runner.narrowest)
            del group, future  # frees their memory
            following = following or prepare_next(width)
    return runner.reasons


class Runner:
    """Queues of runs, from which groups are chosen, loaded and advanced.

    `held` is a stack that releases the locks and completes the outputs of runs. `reasons` says why runs
    remain unfinished, by number of the run.
    """

    def __init__(
        self, folder: SweepFolder, runs: Iterable[Run], execution: ExecutionOptions, on_progress: OnFraction
    ):
        self.held = ExitStack()
        self.reasons: dict[int, str] = {}
        self._waiting, self._begun, self._alone = deque(runs), deque[SweepRun](), deque[SweepRun]()
        self._folder, self._has_folders, self._on_progress = folder, execution.folders, on_progress
        self._threads, self._device = execution.threads or cores(), find_device(execution.device)
        self.narrowest = max(LEAST_WIDTH, self._threads)
        self.widest = WIDTH_OF_FOLDERS if execution.folders else WIDTH
        self._cache: dict[tuple[BaseScene, str], Scene] = {}
        folder.shards.path.mkdir(parents=True, exist_ok=True)
        self._locks = RunLocks(folder.shards.path / ".claims")
        self.held.callback(self._locks.close)

    def choose(self, width: int) -> Sequence[Run | SweepRun]:
        """Return at most `width` runs for the next group, from one queue.

        A run that needs its own group comes first. Otherwise begun runs are chosen if they suffice, else new
        runs.
        """
        if self._alone:
            return [self._alone.popleft()]
        is_enough = len(self._begun) >= self.narrowest or not self._waiting
        source: deque[Any] = self._begun if is_enough else self._waiting
        return [source.popleft() for _ in range(min(width, len(source)))]

    def prepare(self, chosen: Sequence[Run | SweepRun]) -> Group:
        """Return a group of runs, loaded if memory suffices. Another group may advance in the meantime."""
        group = Group([one for one in chosen if isinstance(one, SweepRun)])
        self._begin([one for one in chosen if isinstance(one, Run)], group)
        if group.members and not group.members[0].is_alone:
            with suppress(OutOfMemoryError):  # `load` tries again when the previous group is deleted
                group.load(self._device, self._threads)
        return group

    def load(self, group: Group) -> None:
        """Load the group unless `prepare` has loaded it.

        If memory does not suffice, the group becomes empty, and each of its runs gets its own group.
        """
        members = group.members
        if group.is_loaded or not members:
            return
        try:
            group.load(self._device, self._threads)
        except OutOfMemoryError as error:
            if len(members) == 1:
                members[0].error = str(error)
                return
            for one in members:
                one.is_alone = True
            self._alone += members
            members.clear()

    def _begin(self, runs: Sequence[Run], group: Group) -> None:
        """Begin runs and add them to a group, unless another process has locked or finished them."""
        free = set(self._locks.acquire(run.number for run in runs))
        free -= self._folder.finished([run for run in runs if run.number in free])
        with_folders = self._folder.with_folders()
        for run in runs:
            try:
                if run.number not in free:
                    raise LockedError("another process has it")
                one = self._member(run)
                if self._has_folders or run.number in with_folders:
                    self._open_folder(one)
                    self._on_progress(one.progress)
                (self._alone if one.is_alone else group.members).append(one)
            except (LockedError, MissingExtraError, OSError) as error:
                self.reasons[run.number] = str(error)
                self._on_progress(1.0)
            except InputError as error:
                group.ended[run.number] = run.labels(), failure(str(error), self._folder.settings)
                self._on_progress(1.0)

    def _member(self, run: Run) -> SweepRun:
        settings = self._folder.settings
        with written_as(KEY_OF):
            scene = self._scene(run)
            one = SweepRun(run, scene, settings, team_size(scene, self._device, self._threads) > 1)
        exact_solver(scene.method)
        require_quantities(settings.measured, scene, settings.table)
        return one

    def _scene(self, run: Run) -> Scene:
        """Return the scene of a run; if possible, as a changed copy of a cached scene, which saves time.

        The cached scene must have the same base, grains and walls.
        """
        settings: dict[str, Any] = {}
        of_grains = []
        for name, value in run.changes().items():
            section, _, key = name.partition(".")
            if section in ("domain", "grains", "walls") or name == "time.time":  # walls move with time
                of_grains.append(value)
            else:
                settings[key] = value
        cached = self._cache.get((run.base, repr(of_grains)))
        if cached is not None:
            return cached.replace(**settings)
        fields = document_fields(run.sections(GRAINS), self._folder.path)
        scene = Scene(**fields, name=run.base.name)
        if len(self._cache) == CACHED_SCENES:
            del self._cache[next(iter(self._cache))]
        self._cache[run.base, repr(of_grains)] = scene
        return scene

    def _open_folder(self, one: SweepRun) -> None:
        text = one.run.text(f"../../{GRAINS}")
        one.open(self._folder.of(one.run), text, self._folder.settings, self.held)

    def carry_out(self, group: Group) -> None:
        """Advance a group, write results of runs that have ended or failed, and queue the other runs."""
        members = group.members
        reported = sum(one.progress for one in members)

        def on_progress(fraction: float) -> None:
            nonlocal reported
            reported += fraction
            self._on_progress(fraction)

        group.advance(LIMIT, on_progress)
        self.reasons |= group.finish(self._folder.settings)
        self._folder.shards.write(group.ended)
        self._locks.release(group.ended)
        done = group.ended.keys() | self.reasons.keys()
        left = [k for k, one in enumerate(members) if one.run.number not in done]
        left = [k for k in left if self._has_folder(members[k])]
        group.save(left)
        for one in (members[k] for k in reversed(left)):
            (self._alone if one.is_alone else self._begun).appendleft(one)
        on_progress(len(members) - len(left) + sum(members[k].progress for k in left) - reported)

    def _has_folder(self, one: SweepRun) -> bool:
        """Return True if a run has a folder, or one could be opened for it; otherwise store the reason."""
        try:
            if one.folder is None:
                self._open_folder(one)
        except (InputError, OSError) as error:
            self.reasons[one.run.number] = str(error)
        return one.folder is not None
