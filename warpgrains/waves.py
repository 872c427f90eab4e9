"""Many runs in one process: in waves, each a batch of scenes that have as many steps left.

A wave proceeds in slices of about a second. Every now and then its runs save where they are, so that a killed
process loses little; at its end each run gets its result.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from time import perf_counter

from warpgrains.batch import Batch
from warpgrains.errors import SceneError, SimulationError
from warpgrains.results import failure
from warpgrains.run_folder import RunFolder
from warpgrains.wave_member import Member

SLICE = 1.0  # s
FIRST_SLICE, GROWTH = 4, 8  # steps of the first slice, and by how much the next one may be longer
BETWEEN_CHECKPOINTS = 20.0  # s
WIDTH, RECORDED_WIDTH = 64, 16  # runs in a wave; frames wait in memory
WRITERS = 16
MOST_WAITING = 256  # runs that wait for others with as many steps left
MOST_GRAINS = 2_000_000  # in a wave

Tell = Callable[[float], None]
"""Hears of progress, in runs."""


@dataclass(frozen=True)
class Means:
    """With what runs are carried out.

    Attributes
    ----------
    device : str
        A Warp device, "cpu" or "cuda:0".
    threads : int or None
        OS threads on a CPU; None for as many as there are cores.
    fps : float or None
        Frames recorded a second of simulated time [1/s], if runs are to be recorded.
    """

    device: str = "cpu"
    threads: int | None = None
    fps: float | None = None


def finish_runs(folders: Iterable[RunFolder], means: Means, tell: Tell) -> None:
    """Carry runs out to their end, each from where it is.

    A run that fails gets a result that says why, and the others go on.

    Parameters
    ----------
    folders
        The runs, none of them finished.
    means
        With what.
    tell
        Is called with every advance.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    for wave in _waves(folders, means, tell):
        _finish(wave, means, tell)


def _waves(folders: Iterable[RunFolder], means: Means, tell: Tell) -> Iterator[list[Member]]:
    """Gather runs with as many steps left; a run whose scene is none has failed."""
    waiting: dict[int, list[Member]] = {}
    width = WIDTH if means.fps is None else RECORDED_WIDTH
    for folder in folders:
        try:
            member = Member(folder, means.fps)
        except SceneError as error:
            folder.finish(failure(folder.labels, str(error)))
            tell(1.0)
            continue
        group = waiting.setdefault(member.left, [])
        group.append(member)
        if len(group) == width or sum(member.scene.n for member in group) >= MOST_GRAINS:
            yield waiting.pop(member.left)
        elif sum(map(len, waiting.values())) == MOST_WAITING:
            yield waiting.pop(max(waiting, key=lambda left: len(waiting[left])))
    yield from waiting.values()


def _finish(wave: list[Member], means: Means, tell: Tell) -> None:
    """Carry a wave out to its end; the recordings are whole before there is a result."""
    with ExitStack() as outputs:
        for member in wave:
            member.open(outputs)
            tell(1.0 - member.left / member.plan.steps)
        if wave[0].left > 0:
            _advance(wave, means, tell)
    _write(Member.finish, wave)


def _advance(wave: list[Member], means: Means, tell: Tell) -> None:
    """Advance a wave to its end; a run that does not fit in memory, even alone, has failed."""
    try:
        batch = Batch([member.scene for member in wave], means.device, means.threads)
    except SimulationError as error:
        if len(wave) > 1:
            for member in wave:
                _advance([member], means, tell)
        else:
            wave[0].error = str(error)
            tell(wave[0].left / wave[0].plan.steps)
        return
    for k, member in enumerate(wave):
        batch.restore(k, member.state)
    _run(wave, batch, tell)


def _run(wave: list[Member], batch: Batch, tell: Tell) -> None:
    """Run a batch in slices, record its frames and save where its runs are."""
    left, pace, kept_at = wave[0].left, FIRST_SLICE, perf_counter()
    if any(member.is_recorded for member in wave):
        _record(wave, batch)
        _keep(wave, batch)
    while left > 0:
        start = perf_counter()
        steps = min(pace, left, *(member.until_frame for member in wave))
        for member, summary in zip(wave, batch.run(steps), strict=True):
            member.count(summary)
            tell(steps / member.plan.steps)
        left -= steps
        _record(wave, batch)
        now = perf_counter()
        pace = max(1, min(GROWTH * pace, int(SLICE / (now - start) * steps)))
        if left == 0 or now - kept_at > BETWEEN_CHECKPOINTS:
            _keep(wave, batch)
            kept_at = now


def _record(wave: list[Member], batch: Batch) -> None:
    for k, member in enumerate(wave):
        if member.until_frame == 0:
            member.record(batch.position(k), batch.velocity(k))


def _keep(wave: list[Member], batch: Batch) -> None:
    for k, member in enumerate(wave):
        member.reach(batch.state(k))
    _write(Member.keep, wave)


def _write(write: Callable[[Member], None], wave: list[Member]) -> None:
    """Write files of all runs side by side: most of the time is spent waiting for the disk."""
    with ThreadPoolExecutor(WRITERS) as writers:
        list(writers.map(write, wave))
