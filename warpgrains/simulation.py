"""Simulation: one scene, step by step."""

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from tqdm import tqdm

from warpgrains import checks
from warpgrains.errors import SceneError, SimulationError
from warpgrains.forces import pair_contacts, wall_contacts
from warpgrains.reports import (
    Corrections,
    FloatArray,
    PairContacts,
    State,
    StepReport,
    Summary,
    Tally,
    WallContacts,
)
from warpgrains.scene import Scene
from warpgrains.solver import StepSolver

if TYPE_CHECKING:
    from warpgrains.recording import Recorder


class Simulation:
    """One scene on one device.

    Parameters
    ----------
    scene : Scene
        What is simulated.
    device : str
        A Warp device, "cpu" or "cuda:0".
    threads : int, optional
        OS threads that share the work on a CPU; by default as many as pay. The result is the same for any.
    **overrides
        Fields of the scene that are to be changed, such as order="color" or tolerance=1e-8.

    Raises
    ------
    SceneError
        The device is unknown, the number of threads is not positive, or a change makes no scene.
    SimulationError
        The scene does not fit in memory.
    """

    def __init__(self, scene: Scene, device: str = "cpu", threads: int | None = None, **overrides: Any):
        self.scene = scene.replace(**overrides) if overrides else scene
        if threads is not None:
            checks.whole_number("threads", threads)
        self._solver = StepSolver(self.scene, _find_device(device), threads)
        nothing = Corrections(np.zeros((0, 2), np.int32), np.zeros(0), np.zeros(scene.n))
        self.restore(State(0, scene.position, scene.velocity, nothing))

    def step(self) -> StepReport:
        """Advance by one time step.

        Raises
        ------
        SimulationError
            A number is no longer finite. The state is that before the step.
        """
        try:
            report = self._solver.solve()
        except SimulationError as error:
            raise SimulationError(f"step {self._steps + 1}, from t = {self.time} s: {error}") from error
        self._steps += 1
        return report

    def run(
        self,
        steps: int | None = None,
        duration: float | None = None,
        record: str | Path | None = None,
        fps: float = 60.0,
        progress: bool = False,
    ) -> Summary:
        """Advance by many time steps.

        Parameters
        ----------
        steps : int, optional
            How many; or
        duration : float, optional
            for how long [s]; by default for the scene's duration.
        record : str or Path, optional
            A USD file to write the frames to, the present state first.
        fps : float
            Wanted frames per second of simulated time [1/s], see `recording_stride`.
        progress : bool
            Whether to show a progress bar on standard error.

        Raises
        ------
        SceneError
            The recording cannot be written there.
        SimulationError
            A step failed.
        """
        if steps is None:
            steps = self.scene.steps if duration is None else self.scene.steps_in(duration)
        start, tally = perf_counter(), Tally()
        with _recorder(record, self.scene, fps) as recorder, tqdm(total=steps, disable=not progress) as bar:
            for done in range(steps + 1):
                if recorder is not None and done % recorder.stride == 0:
                    recorder.record(self.position, self.velocity)
                if done < steps:
                    tally.add(self.step())
                    bar.update()
        return tally.summary(perf_counter() - start, None if record is None else str(record))

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._steps * self.scene.dt

    @property
    def position(self) -> FloatArray:
        """Centres of the grains [m], shape (n, 2); a copy."""
        return self._solver.grains.position.numpy().copy()

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the grains [m/s], shape (n, 2); a copy."""
        return self._solver.grains.velocity.numpy().copy()

    def contacts(self) -> PairContacts:
        """Return the contacts between grains of the last step, those that carry a correction."""
        return pair_contacts(
            self.scene, self._solver.grains.last_position.numpy(), self._solver.contacts.corrections()
        )

    def wall_contacts(self) -> WallContacts:
        """Return the contacts with the walls of the last step, one entry a grain."""
        return wall_contacts(self.scene, self._solver.contacts.corrections())

    def state(self) -> State:
        """Return the exact state, from which `restore` continues with the same bits."""
        contacts = self._solver.contacts
        return State(self._steps, self.position, self.velocity, contacts.corrections(), contacts.lists())

    def restore(self, state: State) -> None:
        """Continue from a state of this scene."""
        self._steps = state.steps
        self._solver.load(state)


def _find_device(name: str) -> wp.Device:
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError) as error:
        known = ", ".join(device.alias for device in wp.get_devices())
        raise SceneError(f"device {name!r} is unknown here; choose {known}") from error


def _recorder(path: str | Path | None, scene: Scene, fps: float) -> AbstractContextManager["Recorder | None"]:
    """Open a recording, or nothing."""
    if path is None:
        return nullcontext()
    from warpgrains.recording import Recorder

    return Recorder(path, scene, fps)
