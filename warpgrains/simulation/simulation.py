"""`Simulation`: one scene with its runs, recordings, checkpoints and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Self

from warpgrains.described import documented
from warpgrains.drawing.kinds import require_drawing
from warpgrains.drawing.views import size_of
from warpgrains.errors import InputError, requiring
from warpgrains.pictures.shots import Painter
from warpgrains.scene import checks
from warpgrains.simulation.checkpoint import (
    Checkpoint,
    lock_checkpoint,
    read_checkpoint,
    write_checkpoint,
)
from warpgrains.simulation.options import OPTIONS, RunOptions, steps_of
from warpgrains.simulation.run import Observer, OpenRun, carry_out, require_observer
from warpgrains.simulation.stepper import Stepper, continued
from warpgrains.simulation.until import Question
from warpgrains.solver.statistics import RunStatistics, Summary

if TYPE_CHECKING:
    from warpgrains.pictures.still import Picture
    from warpgrains.view.page import Page


_WRITTEN = ("record", "fps", "color_by", "forces", "draw_as", "size", "frame", "checkpoint", "every")


class Simulation(Stepper):
    """A simulation of one scene on one device.

    Python threads may advance different simulations at the same time. Advancing the same simulation from two
    threads at once raises `SimulationError`.

    Parameters
    ----------
    scene : Scene
        A scene, a scene file, or the name of a shipped scene, see `Scene.load`.
    device : str
        A Warp device, "cpu" or "cuda:0".
    threads : int, optional
        Largest number of OS threads on a CPU; by default, it follows from the number of contacts. Fewer are
        used while synchronization costs more than they gain. The result does not depend on it.
    **overrides
        Fields of the scene to change, such as order="color" or tolerance=1e-8.

    Raises
    ------
    InputError
        The scene does not exist, the device is unknown, the number of threads is not positive, or an
        override is invalid.
    SimulationError
        The scene does not fit in memory.

    Notes
    -----
    Copies (also by `copy.copy`) and unpickled simulations have separate memory. They continue from the exact
    state with the same bits, as after `load`; `last_start` needs a step first.

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

    @documented(option for name, option in OPTIONS.items() if name in _WRITTEN)
    def run(
        self,
        steps: int | None = None,
        duration: float | None = None,
        until: str | Question | None = None,
        record: str | Path | None = None,
        fps: float = RunOptions.fps,
        color_by: str = RunOptions.color_by,
        forces: bool = RunOptions.forces,
        draw_as: str = RunOptions.draw_as,
        size: str | None = None,
        frame: str | None = None,
        checkpoint: str | Path | None = None,
        every: int = RunOptions.every,
        observer: Observer | None = None,
        progress: bool = False,
    ) -> Summary:
        """Advance by many time steps.

        Parameters
        ----------
        steps : int, optional
            Number of steps; or
        duration : float, optional
            simulated time [s]; by default the scene's duration.
        until : str or callable, optional
            End criterion of the run: "rest", or a callable. Every 10 steps the callable receives the
            simulation and returns True to stop, see `warpgrains.simulation.until.criterion`.
        {fields}
        observer : object, optional
            Object that measures during the run, such as a `warpgrains.analysis.Series`.
            ``observe(simulation)`` is called at multiples of its ``every`` steps, ``flush()`` before a
            checkpoint and at the end. It may read the simulation, but neither advance nor change it.
            Checkpoints do not hold it: `run --resume` continues without it.
        progress : bool
            Whether to show a progress bar on standard error.

        Raises
        ------
        InputError
            An argument is invalid, or the recording or the checkpoint cannot be written. It is an
            `OutputError` if another run writes it at the same time.
        SimulationError
            A step failed, another thread advances this simulation, or a callback changes it.

        Warns
        -----
        UserWarning
            The output cannot have `fps` frames per second, grains cannot fit, or the run ended before its end
            criterion was met.

        Notes
        -----
        A frame within a step shows positions on the straight path of that step. If an output is a symbolic
        link, its target is written.
        """
        options = RunOptions(
            steps=steps_of(self.scene, steps, duration),
            record=None if record is None else checks.path("record", record),
            fps=fps,
            color_by=color_by,
            forces=forces,
            draw_as=draw_as,
            size=size,
            frame=frame,
            checkpoint=None if checkpoint is None else checks.path("checkpoint", checkpoint),
            every=every,
            until=until if isinstance(until, str) else None,
        )
        if checkpoint is not None and callable(until):
            raise InputError(
                "until is a function, which a checkpoint cannot hold: use a text such as 'rest,speed=0.01'"
            )
        if observer is not None:
            require_observer(observer)
        with self._use.held():
            run = OpenRun(self.scene, options, RunStatistics(), self.steps, until, observer)
            with run.opened():
                carry_out(self, run, progress)
        return run.statistics.summary(options.record)

    def view(self, port: int = 8080) -> Page:
        """Play the simulation from its present state in a page of this machine's browser.

        A notebook shows the page.

        The page advances the simulation until ``close()`` of the returned object is called; its ``url`` is
        the address.

        Raises
        ------
        InputError
            viser is not installed, or the port is invalid.
        """
        checks.whole_number("port", port, most=65535)
        with requiring("view", "view"):
            from warpgrains.view.page import Page
        from warpgrains.view.players import Live

        return Page(Live(self), port).start()

    @documented([OPTIONS[name] for name in ("color_by", "forces", "size", "frame")])
    def plot(
        self,
        color_by: str = RunOptions.color_by,
        forces: bool = RunOptions.forces,
        size: str | None = None,
        frame: str | None = None,
    ) -> Picture:
        """Return a picture of the present state. Notebooks show it.

        Parameters
        ----------
        {fields}

        Raises
        ------
        InputError
            The coloring is unknown, the size or the frame is invalid, or Matplotlib is not installed.
        """
        require_drawing("plot")
        from warpgrains.pictures.still import Picture

        painter = Painter(self.scene, color_by, forces, frame=frame)
        pixels = None if size is None else size_of("size", size)
        return Picture(painter.setting, painter.shot_of(self), pixels)

    def save(self, path: str | Path) -> None:
        """Save the exact state and the scene to a checkpoint, an .npz file, atomically.

        Raises
        ------
        InputError
            The checkpoint cannot be written. It is an `OutputError` if a run writes it.
        """
        path = Path(checks.path("path", path))
        with lock_checkpoint(path):
            write_checkpoint(path, Checkpoint(self.scene, self.state(), None, RunStatistics()))

    @classmethod
    def load(cls, path: str | Path, device: str = "cpu", threads: int | None = None) -> Self:
        """Continue from a checkpoint of `save` or of a run, with the same bits.

        Parameters
        ----------
        path : str or Path
            The checkpoint.
        device, threads
            See `Simulation`. They may differ from those that wrote the checkpoint; the result is the same.

        Raises
        ------
        InputError
            The checkpoint cannot be read.
        """
        kept = read_checkpoint(Path(checks.path("path", path)))
        return continued(cls, kept.scene, kept.state, device, threads)
