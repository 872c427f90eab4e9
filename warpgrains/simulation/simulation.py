"""Simulation: one scene, run, recorded, saved and shown."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Self

from warpgrains.drawing.frame_times import DEFAULT_RATE
from warpgrains.errors import SceneError, missing_extra
from warpgrains.pictures.kinds import require_drawing
from warpgrains.simulation.checkpoint import (
    Checkpoint,
    lock_checkpoint,
    read_checkpoint,
    write_checkpoint,
)
from warpgrains.simulation.options import RunOptions, steps_of
from warpgrains.simulation.run import Observer, Outputs, run
from warpgrains.simulation.stepper import Stepper
from warpgrains.simulation.until import Question, criterion
from warpgrains.solver.statistics import RunStatistics, Summary

if TYPE_CHECKING:
    from warpgrains.pictures.still import Picture
    from warpgrains.view.page import Page


class Simulation(Stepper):
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

    def run(
        self,
        steps: int | None = None,
        duration: float | None = None,
        until: str | Question | None = None,
        record: str | Path | None = None,
        fps: float = DEFAULT_RATE,
        color_by: str = "speed",
        forces: bool = False,
        draw_as: str = "points",
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
            Wanted frames per second of simulated time [1/s], see `FrameTimes`.
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
