"""Simulation: one scene, step by step."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from warpgrains.arrays import FloatArray
from warpgrains.errors import SceneError, SimulationError, missing_extra
from warpgrains.pictures.kinds import require_drawing
from warpgrains.scene import checks
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import State, require_state
from warpgrains.shown import Shown
from warpgrains.simulation.checkpoint import (
    Checkpoint,
    lock_checkpoint,
    read_checkpoint,
    write_checkpoint,
)
from warpgrains.simulation.options import RunOptions, steps_of
from warpgrains.simulation.run import Observer, Outputs, run
from warpgrains.simulation.until import Question, criterion
from warpgrains.solver.advance import OnProgress, advance
from warpgrains.solver.engine import Engine
from warpgrains.solver.forces import PairContacts, WallContacts, pair_contacts, wall_contacts
from warpgrains.solver.statistics import RunStatistics, StepReport, Summary
from warpgrains.solver.tuning import find_device, threads_for

if TYPE_CHECKING:
    from warpgrains.pictures.still import Picture
    from warpgrains.view.page import Page


class StepStart(NamedTuple):
    """Where a step began.

    Examples
    --------
    >>> start = simulation.last_start()
    >>> moved = simulation.position - start.position
    >>> bool(np.allclose(moved, simulation.scene.dt * simulation.velocity))
    True
    """

    position: FloatArray
    """Centres [m], shape (n, 2)."""
    velocity: FloatArray
    """[m/s], shape (n, 2)."""
    staggered: bool
    """Whether the velocities were those of the middle of the step before, see `State`."""


class Simulation(Shown):
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

    Examples
    --------
    >>> simulation = wg.Simulation(wg.Scene.load("annulus"), tolerance=1e-8)
    >>> summary = simulation.run(duration=4.0)
    >>> simulation.steps, simulation.time, simulation.position.shape
    (400, 4.0, (15, 2))
    >>> f"{simulation.contacts().force.max():.4f} N"
    '2.0263 N'
    >>> simulation.save("annulus.npz")
    >>> again = wg.Simulation.load("annulus.npz")
    >>> bool((again.position == simulation.position).all())
    True
    """

    def __init__(self, scene: Scene, device: str = "cpu", threads: int | None = None, **overrides: Any):
        if threads is not None:
            checks.thread_count("threads", threads)
        self._device, self._threads_wanted = find_device(device), threads
        self._begin(scene.replace(**overrides) if overrides else scene)
        self._engine.begin()

    def _begin(self, scene: Scene) -> None:
        self.scene = scene
        self._threads = threads_for(scene, self._device, self._threads_wanted)
        self._engine = Engine([scene], self._device, self._threads)
        self._stepped = False

    def facts(self) -> dict[str, str]:
        """Return what there is to tell of it in a line."""
        return {
            self.scene.name: f"of {self.scene.n} grains",
            "steps": f"{self.steps}",
            "time": f"{self.time:g} s",
        }

    @property
    def is_compiled(self) -> bool:
        """Whether the kernels are ready, or the first step has to compile them, which takes some seconds."""
        return self._engine.is_compiled

    def compile(self) -> None:
        """Have the kernels ready before the first step."""
        self._engine.load_kernels()

    def step(self, history: bool = False) -> StepReport:
        """Advance by one time step.

        Parameters
        ----------
        history : bool
            Whether the report is to have zeta and residual of every iteration. The step is the same, and
            takes about twice as long.

        Raises
        ------
        SimulationError
            A number is no longer finite; or the step has not converged, and the scene's `on_unconverged` is
            "raise". The state is that before the step. Or a history of `max_iterations` finds no memory.
        """
        self._advance(1, None, history)
        return self._engine.report(0)

    def advance(self, steps: int, on_progress: OnProgress | None = None) -> RunStatistics:
        """Advance by some time steps without anything in between.

        Parameters
        ----------
        steps : int
        on_progress : callable, optional
            Told now and then how many steps more have been done.

        Raises
        ------
        SimulationError
            A step failed, as in `step`; those before it are done.
        """
        self._advance(steps, on_progress)
        return self._engine.statistics(0)

    def _advance(self, steps: int, on_progress: OnProgress | None, history: bool = False) -> None:
        before = self.steps
        self._engine.keep_history(0, history)
        self._engine.submit([steps])
        advance([self._engine], self._threads, on_progress)
        self._stepped = self._stepped or self.steps > before
        error = self._engine.error(0)
        if error is not None:
            raise SimulationError(error)

    @property
    def infeasible_steps(self) -> list[tuple[int, tuple[int, ...]]]:
        """Steps of the last `advance` that have no solution, by number, and the grains that cannot fit."""
        return self._engine.infeasible_steps(0)

    def run(
        self,
        steps: int | None = None,
        duration: float | None = None,
        until: str | Question | None = None,
        record: str | Path | None = None,
        fps: float = 60.0,
        color_by: str = "speed",
        forces: bool = False,
        draw_as: str = "discs",
        checkpoint: str | Path | None = None,
        every: int = 1000,
        observer: Observer | None = None,
        progress: bool = False,
    ) -> Summary:
        """Advance by many time steps.

        Parameters
        ----------
        steps : int, optional
            How many; or
        duration : float, optional
            for how long [s]; by default for the scene's duration.
        until : str or callable, optional
            What ends the run earlier: "rest", or a callable that is asked every 10 steps whether the
            simulation that it is given is to stop, see `warpgrains.simulation.until.criterion`.
        record : str or Path, optional
            A USD file (.usdc, .usda, .usdz) or a film (.mp4, .gif, .webp) to write the frames to, the present
            state first; or a picture of the end (.png, .pdf, .svg).
        fps : float
            Wanted frames per second of simulated time [1/s], see `recording_stride`.
        color_by, forces, draw_as
            What the frames show, see `Recorder`.
        checkpoint : str or Path, optional
            An .npz file to save the state to now and then, for `load` or ``warpgrains run --resume``.
        every : int
            Steps between two checkpoints.
        observer : Observer, optional
            Looks at the simulation now and then, such as `warpgrains.analysis.Series`.
        progress : bool
            Whether to show a progress bar on standard error.

        Raises
        ------
        SceneError
            The recording or the checkpoint cannot be written there; as an `OutputError`, if another run
            does so at the same time.
        SimulationError
            A step failed.
        """
        options = RunOptions(
            steps=steps_of(self.scene, steps, duration),
            record=None if record is None else str(record),
            fps=fps,
            color_by=color_by,
            forces=forces,
            draw_as=draw_as,
            checkpoint=None if checkpoint is None else str(checkpoint),
            every=every,
            until=until if isinstance(until, str) else None,
        )
        if checkpoint is not None and callable(until):
            raise SceneError("until is a callable, which no checkpoint can hold")
        outputs = Outputs(observer=observer, until=criterion(until, self.scene))
        return run(self, options, RunStatistics(), progress, outputs)

    def change(self, **fields: Any) -> None:
        """Continue from the present state with some fields of the scene changed, such as drag=0.1.

        Raises
        ------
        SceneError
            A change makes no scene, or one of other grains.
        """
        state = self.state()
        scene = self.scene.replace(**fields)
        require_state(state, scene.n)
        self._begin(scene)
        self._engine.load(0, state)

    def view(self, port: int = 8080) -> Page:
        """Play it in a page of this machine's browser, from where it is; a notebook shows the page.

        It is stepped by the page until ``close`` is called on what is returned; its ``url`` says where it is.

        Raises
        ------
        SceneError
            viser is not installed.
        """
        try:
            from warpgrains.view.page import Page
        except ModuleNotFoundError as error:
            raise missing_extra("view", error, "view") from error
        from warpgrains.view.players import Live

        return Page(Live(self), port).start()

    def plot(self, color_by: str = "speed", forces: bool = False) -> Picture:
        """Return a picture of the present state, which a notebook shows.

        Parameters
        ----------
        color_by : str
            "speed", "pressure", "radius" or "palette", see `GrainColors`.
        forces : bool
            Whether to draw force chains.

        Raises
        ------
        SceneError
            The coloring is unknown, or Matplotlib is not installed.
        """
        require_drawing("plot")
        from warpgrains.pictures.still import Picture

        return Picture(self, color_by, forces)

    @property
    def steps(self) -> int:
        """Time steps since the start."""
        return self._engine.steps(0)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.steps * self.scene.dt

    @property
    def position(self) -> FloatArray:
        """Centres of the grains [m], shape (n, 2); a copy."""
        return self._engine.grains(0, "position")

    @property
    def velocity(self) -> FloatArray:
        """Velocities with which the last step moved the grains [m/s], shape (n, 2); a copy.

        In the leapfrog scheme they are those of the middle of that step, half a step behind the positions.
        """
        return self._engine.grains(0, "velocity")

    def last_start(self) -> StepStart:
        """Return where the last step began.

        Raises
        ------
        SimulationError
            No step has been taken since the start, or since `restore`.
        """
        if not self._stepped:
            raise SimulationError("no step has been taken from this state: call step() first")
        position, velocity = (self._engine.grains(0, f"last_{name}") for name in ("position", "velocity"))
        return StepStart(position, velocity, self._engine.last_staggered(0))

    def contacts(self) -> PairContacts:
        """Return the contacts between grains of the last step, those that carry a correction."""
        last_position = self._engine.grains(0, "last_position")
        return pair_contacts(self.scene, last_position, self._engine.corrections(0))

    def wall_contacts(self) -> WallContacts:
        """Return the contacts with the walls of the last step, one entry a grain."""
        return wall_contacts(self.scene, self._engine.corrections(0))

    def state(self) -> State:
        """Return the exact state, from which `restore` continues with the same bits."""
        return self._engine.state(0)

    def restore(self, state: State) -> None:
        """Continue from a state of this scene.

        Raises
        ------
        SceneError
            It is a state of other grains, or none: the message names field, grain and value.
        """
        require_state(state, self.scene.n)
        self._stepped = False
        self._engine.load(0, state)

    def save(self, path: str | Path) -> None:
        """Save the exact state and the scene to a checkpoint, an .npz file, at once and whole.

        Raises
        ------
        SceneError
            It cannot be written there; as an `OutputError`, if a run does so.
        """
        path = Path(path)
        with lock_checkpoint(path):
            write_checkpoint(path, Checkpoint(self.scene, self.state(), None, RunStatistics()))

    @classmethod
    def load(cls, path: str | Path, device: str = "cpu", threads: int | None = None) -> Self:
        """Continue from a checkpoint, of `save` or of a run, with the same bits.

        Parameters
        ----------
        path : str or Path
            The checkpoint.
        device, threads
            See `Simulation`; not those that wrote the checkpoint, the result is the same for any.

        Raises
        ------
        SceneError
            The checkpoint cannot be read.
        """
        kept = read_checkpoint(Path(path))
        simulation = cls(kept.scene, device, threads)
        simulation.restore(kept.state)
        return simulation
