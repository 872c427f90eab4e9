"""`Batch`: many scenes advanced together on one device, with the results of each alone."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.batch.resident import Ending, ResidentSets, StepsDone
from warpgrains.console import progress_bar
from warpgrains.errors import InputError, SimulationError
from warpgrains.scene import checks
from warpgrains.scene.scene import Scene, SceneLike, as_scene
from warpgrains.scene.state import State, require_state
from warpgrains.shown import Shown
from warpgrains.simulation.options import steps_of
from warpgrains.simulation.until import Question, criterion
from warpgrains.solver.advance import OnProgress
from warpgrains.solver.statistics import RunStatistics, StepReport, Summary
from warpgrains.solver.threads import cores
from warpgrains.solver.tuning import find_device
from warpgrains.turns import ExclusiveUse


@dataclass(frozen=True, repr=False)
class SceneSummary(Summary):
    """Summary of the run of one scene of a batch; `seconds` is its share of one core's time.

    Examples
    --------
    >>> scene = wg.Scene.load("annulus", ["solver.max_iterations=3"]).replace(on_unconverged="raise")
    >>> (failed,) = wg.Batch([scene]).run()
    >>> failed.steps, failed.error
    (19, 'step 20, from t = 0.19 s: not converged after 3 iterations: ...')
    """

    error: str | None = None
    """Reason why the scene stopped early, at its last good state; None if it did not."""

    def summary(self) -> dict[str, str]:
        """Return the fields of the one-line summary by name."""
        return super().summary() | ({} if self.error is None else {"error": self.error})


class Batch(Shown):
    """Many scenes on one device, of any sizes and parameters.

    The results of each scene are bit-identical to those of a `Simulation`, and do not depend on the other
    scenes, their order and the number of threads. If the scenes do not all fit in memory, they are processed
    in groups. Advancing a batch from two Python threads at once raises `SimulationError`.

    Parameters
    ----------
    scenes : Scene or iterable of Scene
        Scenes, scene files or names of shipped scenes, see `Scene.load`.
    device : str
        A Warp device, "cpu" or "cuda:0".
    threads : int, optional
        OS threads among which the scenes are divided on a CPU; by default the number of cores.

    Raises
    ------
    InputError
        There is no scene, the device is unknown, or the number of threads is not positive.
    SimulationError
        A scene does not fit in memory.

    Attributes
    ----------
    scenes : tuple of Scene

    Notes
    -----
    Copies (also by `copy.copy`) and unpickled batches have separate memory. They continue from the exact
    states with the same bits.

    Examples
    --------
    >>> scene = wg.Scene.load("annulus")
    >>> batch = wg.Batch([scene, scene.replace(drag=0.1)])
    >>> [summary.steps for summary in batch.run(duration=4.0)]
    [400, 400]
    >>> bool((batch.position(0) == simulation.position).all())  # as alone
    True
    """

    def __init__(
        self, scenes: SceneLike | Iterable[SceneLike], device: str = "cpu", threads: int | None = None
    ):
        if isinstance(scenes, Scene | str | os.PathLike) or not np.iterable(scenes):
            scenes = (as_scene("scenes", scenes),)
        self.scenes = tuple(as_scene(f"scenes[{k}]", scene) for k, scene in enumerate(scenes))
        if not self.scenes:
            raise InputError("a batch needs at least one scene")
        if threads is not None:
            checks.thread_count("threads", threads)
        self._device, self._threads_wanted = find_device(device), threads
        self._sets = ResidentSets(self.scenes, self._device, cores() if threads is None else threads)
        self._reports: list[StepReport | None] = [None] * len(self.scenes)
        self._use = ExclusiveUse("batch")

    def __getstate__(self) -> tuple[Any, ...]:
        states = [self.state(k) for k in range(len(self))]
        return self.scenes, self._device.alias, self._threads_wanted, states, self._reports

    def __setstate__(self, kept: tuple[Any, ...]) -> None:
        *given, states, reports = kept
        Batch.__init__(self, *given)
        for k, state in enumerate(states):
            self.restore(k, state)
        self._reports = list(reports)

    def summary(self) -> dict[str, str]:
        """Return the fields of the one-line summary by name."""
        names = sorted({scene.name for scene in self.scenes})
        grains = sum(scene.n for scene in self.scenes)
        shown = ", ".join([*names[:3], "..."] if len(names) > 3 else names)
        return {f"{len(self)} scenes": f"of {shown}", "grains": f"{grains} in all"}

    def __len__(self) -> int:
        return len(self.scenes)

    def step(self) -> list[StepReport]:
        """Advance every scene by one time step.

        Raises
        ------
        SimulationError
            A number of some scene is no longer finite (that scene keeps the state before the step, and the
            other scenes have advanced), or another thread advances this batch.
        """
        outcomes = self._advance([1] * len(self), lambda _: None)
        failures = [f"scene {done.k}: {done.error}" for done in outcomes if done.error is not None]
        if failures:
            raise SimulationError("; ".join(failures))
        return [done.report for done in outcomes if done.report is not None]

    def run(
        self,
        steps: int | Sequence[int] | None = None,
        duration: float | None = None,
        progress: bool = False,
        until: str | Question | None = None,
    ) -> list[SceneSummary]:
        """Advance every scene by many time steps.

        A scene that fails stops at its last good state, and the other scenes continue.

        Parameters
        ----------
        steps : int or sequence of int, optional
            Number of steps, or one number per scene; or
        duration : float, optional
            simulated time [s]; by default the duration of each scene.
        progress : bool
            Whether to show a progress bar on standard error.
        until : str or callable, optional
            Criterion that ends each scene early, as in `Simulation.run`: "rest", or a callable. The callable
            receives a scene of the batch, with the attributes `scene`, `steps`, `time`, `position`,
            `velocity` and the method `state` of a `Simulation`.

        Returns
        -------
        list of SceneSummary
            One summary per scene; `error` is the reason of a failure, and `met` is True if `until` was met.

        Raises
        ------
        InputError
            `steps` is invalid, or `until` is no criterion for one of the scenes.
        """
        each = list(steps) if isinstance(steps, Sequence) else [steps] * len(self)
        if len(each) != len(self):
            raise InputError(
                f"steps has {len(each)} numbers: it must have one for each of the {len(self)} scenes"
            )
        wanted = [steps_of(scene, own, duration) for scene, own in zip(self.scenes, each, strict=True)]
        criteria = [criterion(until, scene) for scene in self.scenes]
        endings = [(found, RunStatistics()) for found in criteria if found is not None]
        with progress_bar(sum(wanted), shown=progress) as bar:
            outcomes = self._advance(wanted, bar.update, endings or None)
        return [SceneSummary(**vars(done.statistics.summary(None)), error=done.error) for done in outcomes]

    def _advance(
        self, steps: list[int], on_progress: OnProgress, endings: list[Ending] | None = None
    ) -> list[StepsDone]:
        """Advance each scene, see `ResidentSet.advance`, and keep the last reports."""
        outcomes: list[StepsDone] = []
        with self._use.advancing():
            for resident in self._sets.advance(steps, on_progress, endings):
                outcomes += map(resident.done, resident.scenes)
            for done in outcomes:
                self._reports[done.k] = done.report or self._reports[done.k]
        return sorted(outcomes)

    @property
    def reports(self) -> list[StepReport | None]:
        """The last report of every scene; None before its first step."""
        return list(self._reports)

    def position(self, k: int) -> FloatArray:
        """Return the centers of the grains of scene k [m], shape (n, 2); a read-only copy."""
        return checks.frozen(self.state(k).position.copy())

    def velocity(self, k: int) -> FloatArray:
        """Return the velocities of the grains of scene k [m/s], shape (n, 2); a read-only copy."""
        return checks.frozen(self.state(k).velocity.copy())

    def state(self, k: int) -> State:
        """Return the exact state of scene k.

        After `restore`, the scene continues from it with the same bits.
        """
        with self._use.exclusive():
            return self._sets.state(self._number(k))

    def restore(self, k: int, state: State) -> None:
        """Continue scene k from a state.

        Raises
        ------
        InputError
            `state` belongs to other grains, or `k` is out of range.
        """
        k = self._number(k)
        require_state(state, self.scenes[k])
        with self._use.exclusive():
            self._sets.restore(k, state)

    def _number(self, k: int) -> int:
        return checks.whole_number("k", k, least=0, most=len(self) - 1)
