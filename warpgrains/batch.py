"""Batch: many scenes, advanced together."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from time import perf_counter

from tqdm import tqdm

from warpgrains.errors import SceneError, SimulationError
from warpgrains.reports import FloatArray, State, StepReport, Summary, Tally
from warpgrains.scene import Scene
from warpgrains.simulation import Simulation


@dataclass(frozen=True)
class SceneSummary(Summary):
    """What a run of a batch did with one of its scenes.

    Attributes
    ----------
    error : str or None
        Why the scene stopped before its end, at its last good state.
    """

    error: str | None = None


class Batch:
    """Many scenes on one device, of any sizes and parameters.

    Each scene gets the same bits as alone in a `Simulation`, whatever else is in the batch, in whatever
    order, on however many threads.

    Parameters
    ----------
    scenes : iterable of Scene
    device : str
        A Warp device, "cpu" or "cuda:0".
    threads : int, optional
        OS threads that share the scenes out on a CPU; by default as many as there are cores.

    Raises
    ------
    SceneError
        There is no scene, the device is unknown, or the number of threads is not positive.
    SimulationError
        A scene does not fit in memory.
    """

    def __init__(self, scenes: Iterable[Scene], device: str = "cpu", threads: int | None = None):
        self.scenes = list(scenes)
        if not self.scenes:
            raise SceneError("a batch needs at least one scene")
        self._simulations = [Simulation(scene, device, threads) for scene in self.scenes]
        self._reports: list[StepReport | None] = [None] * len(self.scenes)

    def __len__(self) -> int:
        """Return the number of scenes."""
        return len(self.scenes)

    def step(self) -> list[StepReport]:
        """Advance every scene by one time step.

        Raises
        ------
        SimulationError
            A number of some scene is no longer finite: that scene's state is that before the step, and the
            others have advanced.
        """
        failures = []
        for k, simulation in enumerate(self._simulations):
            try:
                self._reports[k] = simulation.step()
            except SimulationError as error:
                failures.append(f"scene {k}: {error}")
        if failures:
            raise SimulationError("; ".join(failures))
        return [report for report in self._reports if report is not None]

    def run(
        self, steps: int | None = None, duration: float | None = None, progress: bool = False
    ) -> list[SceneSummary]:
        """Advance every scene by many time steps.

        A scene that fails stops at its last good state, and the others go on.

        Parameters
        ----------
        steps : int, optional
            How many; or
        duration : float, optional
            for how long [s]; by default every scene for its own duration.
        progress : bool
            Whether to show a progress bar on standard error.

        Returns
        -------
        list of SceneSummary
            One a scene; `error` tells why it failed, if it did.
        """
        summaries = []
        wanted = [_steps_of(scene, steps, duration) for scene in self.scenes]
        with tqdm(total=sum(wanted), disable=not progress) as bar:
            for simulation, count in zip(self._simulations, wanted, strict=True):
                start, tally, error = perf_counter(), Tally(), None
                try:
                    while tally.steps < count:
                        tally.add(simulation.step())
                        bar.update()
                except SimulationError as failure:
                    error = str(failure)
                tally.seconds = perf_counter() - start
                summaries.append(SceneSummary(**asdict(tally.summary(None)), error=error))
        return summaries

    @property
    def reports(self) -> list[StepReport | None]:
        """The last report of every scene, None before its first step."""
        return list(self._reports)

    def position(self, k: int) -> FloatArray:
        """Return the centres of the grains of scene k [m], shape (n, 2); a copy."""
        return self._simulations[k].position

    def velocity(self, k: int) -> FloatArray:
        """Return the velocities of the grains of scene k [m/s], shape (n, 2); a copy."""
        return self._simulations[k].velocity

    def state(self, k: int) -> State:
        """Return the exact state of scene k, from which `restore` continues with the same bits."""
        return self._simulations[k].state()

    def restore(self, k: int, state: State) -> None:
        """Continue scene k from a state of it.

        Raises
        ------
        SceneError
            It is a state of other grains.
        """
        self._simulations[k].restore(state)


def _steps_of(scene: Scene, steps: int | None, duration: float | None) -> int:
    if steps is not None:
        return steps
    return scene.steps if duration is None else scene.steps_in(duration)
