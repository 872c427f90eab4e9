"""`Batch`: many scenes advanced together on one device, each with the same results as alone."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.console import progress_bar
from warpgrains.base.errors import InputError, SimulationError
from warpgrains.base.shown import Shown, number_of
from warpgrains.base.turns import NOTHING, READ, ExclusiveUse
from warpgrains.base.warp_start import find_device
from warpgrains.batch.loaded_scenes import LoadedScenes
from warpgrains.scene.compatibility import warn_of_start, warn_of_state_overlaps
from warpgrains.scene.scene import Scene, SceneLike, as_scene
from warpgrains.scene.state import State, require_state
from warpgrains.simulation.options import RunOptions, steps_of
from warpgrains.simulation.run import SceneRun, advance_runs
from warpgrains.simulation.until import Question
from warpgrains.solver.advance import OnProgress
from warpgrains.solver.last_steps import LastSteps
from warpgrains.solver.statistics import StepReport, Summary
from warpgrains.solver.threads import cores

T = TypeVar("T")
SHOWN = 10  # most results that repr shows


class Results(Sequence[T]):
    """Read-only sequence of the results of the scenes of a batch. Each result is made when it is read.

    `repr` gives one line per result. Of more than ten results, it shows the first five and the last five.
    """

    def __init__(self, count: int, make: Callable[[int], T]):
        self._numbers, self._make = range(count), make

    def __len__(self) -> int:
        return len(self._numbers)

    @overload
    def __getitem__(self, which: int) -> T: ...
    @overload
    def __getitem__(self, which: slice) -> list[T]: ...
    def __getitem__(self, which: int | slice) -> T | list[T]:
        numbers = self._numbers[which]
        return self._make(numbers) if isinstance(numbers, int) else list(map(self._make, numbers))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    def __repr__(self) -> str:
        lines = list(map(repr, self if len(self) <= SHOWN else [*self[: SHOWN // 2], *self[-(SHOWN // 2) :]]))
        if len(self) > SHOWN:
            lines.insert(SHOWN // 2, f"... {len(self) - SHOWN} more ...")
        return "[" + ",\n ".join(lines) + "]"


class Batch(Shown):
    """Many scenes on one device, of any sizes and parameters.

    The results of each scene are bit-identical to those of a `Simulation`, and do not depend on the other
    scenes, their order and the number of threads. Advancing a batch from two Python threads at once raises
    `SimulationError`.

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
        The scenes do not fit in memory; the message says how many do.

    Warns
    -----
    UserWarning
        Grains of a scene overlap at the start, or are so close that nothing bounces in the first step; the
        message is about one of the scenes.

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
        self._begin(device, threads)
        warn_of_start(self.scenes)

    def _begin(self, device: str, threads: int | None) -> None:
        self._device, self._threads_wanted = find_device(device), threads
        self._loaded = LoadedScenes(self.scenes, self._device, cores() if threads is None else threads)
        self._stepped: dict[int, LastSteps] = {}  # last steps of each scene, by its number
        self._restored: dict[int, StepReport | None] = {}
        self._turning = [k for k, scene in enumerate(self.scenes) if scene.gravity_rate]
        self._use = ExclusiveUse("batch")

    def __getstate__(self) -> tuple[Any, ...]:
        states = [self.state(k) for k in range(len(self))]
        return self.scenes, self._device.alias, self._threads_wanted, states, list(self.reports)

    def __setstate__(self, kept: tuple[Any, ...]) -> None:
        self.scenes, *given, states, reports = kept
        self._begin(*given)
        for k, state in enumerate(states):
            self._loaded.load(k, state)
        self._restored = dict(enumerate(reports))

    def summary(self) -> dict[str, str]:
        """Return the values that represent the batch on one line, as text by name."""
        names = sorted({scene.name for scene in self.scenes})
        grains = sum(scene.n for scene in self.scenes)
        shown = ", ".join([*names[:3], "..."] if len(names) > 3 else names)
        return {number_of(len(self), "scene"): f"of {shown}", "grains": f"{grains} in all"}

    def __len__(self) -> int:
        return len(self.scenes)

    def step(self, gravity: ArrayLike | None = None) -> Results[StepReport]:
        """Advance every scene by one time step.

        Parameters
        ----------
        gravity : array_like, optional
            As for `run`.

        Raises
        ------
        InputError
            `gravity` is invalid.
        SimulationError
            A number of some scene is no longer finite (that scene keeps the state before the step, and the
            other scenes have advanced), or another thread advances this batch.
        """
        with self._with_gravity(gravity):
            last = self._advance([1] * len(self))
        if errors := last.errors:
            raise SimulationError("; ".join(f"scene {k}: {error}" for k, error in errors.items()))
        return cast(Results[StepReport], self.reports)

    def run(
        self,
        steps: int | Sequence[int] | None = None,
        duration: float | None = None,
        until: str | Question | None = None,
        *,
        progress: bool = False,
        gravity: ArrayLike | None = None,
    ) -> Results[Summary]:
        """Advance every scene by many time steps.

        A scene that fails stops at its last good state, and the other scenes continue.

        Parameters
        ----------
        steps : int or sequence of int, optional
            Number of steps, or one number per scene; or
        duration : float, optional
            simulated time [s]; by default the duration of each scene.
        until : str or callable, optional
            End criterion of each scene, as in `Simulation.run`: "rest", or a callable. The callable
            receives a scene of the batch, with the attributes `scene`, `steps`, `time`, `position`,
            `velocity` and the method `state` of a `Simulation`.
        progress : bool
            Whether to show a progress bar on standard error.
        gravity : array_like, optional
            Acceleration of gravity of every scene in these steps [m/s2], shape (scenes, 2), or one for all,
            shape (2,); by default that of the scenes.

        Returns
        -------
        sequence of Summary
            One summary per scene; `error` is the reason of a failure, and `met` is True if `until` was met.

        Raises
        ------
        InputError
            `steps` or `gravity` is invalid, or `until` is no end criterion for one of the scenes.
        """
        wanted = self._steps_of_each(steps, duration)
        options = {most: RunOptions(steps=most) for most in set(wanted)}
        runs = [
            SceneRun(scene, options[own], until=until) for scene, own in zip(self.scenes, wanted, strict=True)
        ]
        with progress_bar(sum(wanted), shown=progress) as bar, self._with_gravity(gravity):

            def advance(due: list[int]) -> Iterator[tuple[int, Summary]]:
                last = self._advance(due, bar.update if progress else None)
                return ((k, last.summary(k)) for k, steps in enumerate(due) if steps)

            for _ in advance_runs(runs, self._loaded.scenes, advance):
                pass
        return Results(len(self), lambda k: runs[k].statistics)

    def _steps_of_each(self, steps: int | Sequence[int] | None, duration: float | None) -> list[int]:
        """Return the number of steps of each scene; InputError for invalid arguments of `run`."""
        if isinstance(steps, str) or (steps is not None and not isinstance(steps, Sequence)):
            return [steps_of(self.scenes[0], steps, duration)] * len(self)
        each = [None] * len(self) if steps is None else steps
        if len(each) != len(self):
            given = number_of(len(each), "number")
            raise InputError(f"steps has {given}: it must have one for each of the {len(self)} scenes")
        return [steps_of(scene, own, duration) for scene, own in zip(self.scenes, each, strict=True)]

    def _advance(self, steps: list[int], on_progress: OnProgress | None = None) -> LastSteps:
        """Advance scene k by `steps[k]` steps; return the results of these steps."""
        last = self._loaded.advance(steps, on_progress)
        self._stepped |= dict.fromkeys(np.flatnonzero(last.sums["steps"]).tolist(), last)
        return last

    @contextmanager
    def _with_gravity(self, gravity: ArrayLike | None) -> Iterator[None]:
        """Return a context in which only the caller can advance the batch, with `gravity` if it is given.

        `gravity` [m/s2] replaces that of the scenes. InputError if it is invalid.
        """
        given = None if gravity is None else self._checked_gravity(gravity)
        with self._use.held(allowed=NOTHING):
            if given is None:
                yield
                return
            self._loaded.set_gravity(given)
            try:
                yield
            finally:
                self._loaded.set_gravity(np.array([scene.gravity for scene in self.scenes]))

    def _checked_gravity(self, gravity: ArrayLike) -> FloatArray:
        one = np.iterable(gravity) and not any(map(np.iterable, gravity))
        if one and np.size(gravity) != 2:
            told = f"it must be two numbers, or two for each of the {len(self)} scenes"
            raise InputError(f"gravity is {checks.shown(gravity)}: {told}")
        given = checks.vectors("gravity", [gravity] * len(self) if one else gravity, "scene")
        if len(given) != len(self):
            raise InputError(
                f"gravity has {number_of(len(given), 'row')}: it must have {len(self)}, one for each scene"
            )
        if self._turning:
            k = self._turning[0]
            raise InputError(f"gravity is given, but scene {k} has one that turns: give one of them")
        return given

    @property
    def reports(self) -> Results[StepReport | None]:
        """The last report of every scene; None before its first step."""
        stepped, restored = dict(self._stepped), self._restored
        return Results(len(self), lambda k: stepped[k].report(k) if k in stepped else restored.get(k))

    def position(self, k: int | None = None) -> FloatArray:
        """Return the centers of the grains of scene k [m], shape (n, 2); a read-only copy.

        Without k, return those of all scenes, shape (scenes, n, 2).

        Raises
        ------
        InputError
            The scenes differ in their numbers of grains, or `k` is out of range.
        """
        return self._vectors("position", k)

    def velocity(self, k: int | None = None) -> FloatArray:
        """Return the velocities of the grains of scene k, or of all scenes [m/s], shapes as in `position`."""
        return self._vectors("velocity", k)

    def _vectors(self, name: str, k: int | None) -> FloatArray:
        if k is not None:
            return checks.frozen(getattr(self.state(k), name).copy())
        counts = {scene.n for scene in self.scenes}
        if len(counts) > 1:
            raise InputError(f"the scenes have {min(counts)} to {max(counts)} grains: ask for one, {name}(k)")
        with self._use.held(READ):
            return checks.frozen(self._loaded.vectors(name))

    def state(self, k: int) -> State:
        """Return the exact state of scene k.

        After `restore`, the scene continues from it with the same bits.
        """
        with self._use.held(READ):
            return self._loaded.scenes[self._number(k)].state()

    def restore(self, k: int, state: State) -> None:
        """Continue scene k from a state.

        Raises
        ------
        InputError
            `state` belongs to other grains, or `k` is out of range.
        """
        k = self._number(k)
        require_state(state, self.scenes[k])
        with self._use.held(READ):
            self._loaded.load(k, state)
        warn_of_state_overlaps(state, self.scenes[k])

    def _number(self, k: int) -> int:
        return checks.whole_number("k", k, least=0, most=len(self) - 1)
