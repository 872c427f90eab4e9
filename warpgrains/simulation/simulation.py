"""`Simulation`: one scene on a device, with its runs, recordings, checkpoints and pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self, Unpack, cast

from numpy.typing import ArrayLike

from warpgrains.analysis.snapshot import snapshot_of
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.base.described import documented, fields_in_help
from warpgrains.base.errors import InputError, SimulationError, requiring
from warpgrains.base.shown import Shown, number_of
from warpgrains.base.turns import NOTHING, READ, ExclusiveUse
from warpgrains.base.warp_start import find_device
from warpgrains.drawing.kinds import STILL
from warpgrains.drawing.looks import LOOKS, Look, Looks, with_style
from warpgrains.drawing.painter import Painter
from warpgrains.scene.compatibility import warn_of_start, warn_of_state_overlaps
from warpgrains.scene.fields import SceneChanges
from warpgrains.scene.scene import Scene, SceneLike, as_scene
from warpgrains.scene.sources import Inflow, Outflow, steps_to_exchange
from warpgrains.scene.state import OF_POPULATION, State, first_state, require_state
from warpgrains.simulation.changes import change_of
from warpgrains.simulation.checkpoint import (
    Checkpoint,
    lock_checkpoint,
    read_checkpoint,
    write_checkpoint,
)
from warpgrains.simulation.exchange import exchanged
from warpgrains.simulation.options import OPTIONS, Outputs, RunOptions, steps_of
from warpgrains.simulation.population import Population
from warpgrains.simulation.run import Observer, ResumedRun, SceneRun, require_observer
from warpgrains.simulation.until import EndCriterion, Question
from warpgrains.solver.advance import OnProgress, advance
from warpgrains.solver.engine import Engine
from warpgrains.solver.failures import infeasible_grains
from warpgrains.solver.last_steps import LastSteps
from warpgrains.solver.loaded_scene import LoadedScene
from warpgrains.solver.loading import change_scene
from warpgrains.solver.sizes import Sizes
from warpgrains.solver.statistics import StepHistory, StepReport, Summary
from warpgrains.solver.tuning import threads_for

if TYPE_CHECKING:
    import warp

    from warpgrains.analysis.series import Measuring, Series
    from warpgrains.pictures.still import Picture
    from warpgrains.view.page import Page


@fields_in_help
class StepStart(NamedTuple):
    """Positions and velocities at the start of a step.

    Examples
    --------
    >>> start = simulation.last_start()
    >>> moved = simulation.position - start.position
    >>> bool(np.allclose(moved, simulation.scene.dt * simulation.velocity))
    True
    """

    position: FloatArray
    """Centers [m], shape (n, 2); read-only."""
    velocity: FloatArray
    """[m/s], shape (n, 2); read-only."""
    staggered: bool
    """True if the velocities are those of the middle of the previous step, see `State`."""
    spin: FloatArray | None = None
    """[rad/s], shape (n,); None without friction."""


class Simulation(LoadedScene, Shown):
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
    state : State, optional
        State of the scene from which to continue, by default its start.
    **overrides
        Fields of the scene to change, such as order="color" or tolerance=1e-8.

    Raises
    ------
    InputError
        The scene does not exist, the device is unknown, the number of threads is not positive, an override is
        invalid, or the state is not one of the scene.
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

    def __init__(
        self,
        scene: SceneLike,
        device: str = "cpu",
        threads: int | None = None,
        state: State | None = None,
        **overrides: Unpack[SceneChanges],
    ):
        scene = as_scene("scene", scene)
        scene = scene.replace(**overrides) if overrides else scene
        if threads is not None:
            checks.thread_count("threads", threads)
        if state is not None:
            require_state(state, scene)
        self._open(scene, find_device(device), threads, first_state(scene) if state is None else state)
        if state is None:
            warn_of_start([scene])
        else:
            warn_of_state_overlaps(state, scene)

    @classmethod
    def of_state(cls, scene: Scene, state: State, device: str = "cpu", threads: int | None = None) -> Self:
        """Return a simulation that continues from a valid state, without a warning of overlaps."""
        self = cls.__new__(cls)
        self._open(scene, find_device(device), threads, state)
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self).of_state, (self.scene, self.state(), self._device.alias, self._threads_wanted)

    def _open(self, scene: Scene, device: warp.Device, threads: int | None, state: State) -> None:
        self._device, self._threads_wanted = device, threads
        self._use, self.failures_to_search = ExclusiveUse("simulation"), 1
        self._begin(scene, state)

    def _begin(self, scene: Scene, state: State) -> None:
        self._threads = threads_for(scene, self._device, self._threads_wanted)
        sizes = Sizes.first([scene], self._threads, self._device)
        self._engine = Engine([scene], self._device, sizes)
        LoadedScene.__init__(self, self._engine.records, 0)
        self.replace_state(state)

    def summary(self) -> dict[str, str]:
        """Return the values that represent the simulation on one line, as text by name."""
        return {
            self.scene.name: f"of {number_of(self.scene.n, 'grain')}",
            "steps": f"{self.steps}",
            "time": f"{self.time:g} s",
        }

    @property
    def is_compiled(self) -> bool:
        """True if the kernels are compiled; else the first step compiles them, which takes some seconds."""
        return self._engine.is_compiled

    def compile(self) -> None:
        """Compile and load the kernels now instead of during the first step."""
        self._engine.load_kernels()

    def step(self, history: bool = False) -> StepReport:
        """Advance by one time step.

        Parameters
        ----------
        history : bool
            Whether to report zeta and residual of every iteration. The result is the same; the step
            takes about twice as long.

        Raises
        ------
        InputError
            `history` is not a bool.
        SimulationError
            A number is no longer finite; or the step has not converged and the scene's `on_unconverged` is
            "raise" (the state is then that before the step); or a history of `max_iterations` does not fit in
            memory; or another thread advances this simulation.
        """
        if not isinstance(history, bool):
            given = checks.shown(history)
            raise InputError(f"history is {given}: it must be True or False; advance(5) takes several steps")
        with self._use.held():
            self._exchange()
            report = self._advance(1, history=history).report(0)
            if not history:
                return report
            whole = (self._records.array(0, f"{name}_history") for name in StepHistory._fields)
            kept = (array[: report.iterations].copy() for array in whole)
            return replace(report, history=StepHistory(*kept))

    def advance(
        self,
        steps: int,
        on_progress: OnProgress | None = None,
        most_unconverged: int = checks.LARGEST_WHOLE_NUMBER,
    ) -> Summary:
        """Advance by many time steps without outputs or callbacks between them.

        Parameters
        ----------
        steps : int
            0 or more.
        on_progress : callable, optional
            Called occasionally with the number of steps done since its last call.
        most_unconverged : int
            Number of unconverged steps after which to stop early; by default none.

        Raises
        ------
        InputError
            An argument is invalid.
        SimulationError
            A step failed as in `step`, after which the earlier steps remain done; or another thread advances
            this simulation.
        """
        steps = checks.whole_number("steps", steps, least=0)
        if on_progress is not None:
            checks.function("on_progress", on_progress)
        most = checks.whole_number("most_unconverged", most_unconverged)
        with self._use.held():
            done = Summary()
            while True:
                left = steps - done.steps
                if left and self.scene.exchanges_grains:
                    self._exchange()
                    left = min(left, steps_to_exchange(self.scene, self.steps))
                last = self._advance(left, on_progress, most_unconverged=most - done.unconverged).summary(0)
                if last.steps == steps:
                    return last
                done.add(last)
                if last.steps < left or done.steps == steps or done.unconverged >= most:
                    return done

    def _advance(
        self,
        steps: int,
        on_progress: OnProgress | None = None,
        history: bool = False,
        most_unconverged: int = checks.LARGEST_WHOLE_NUMBER,
    ) -> LastSteps:
        self._records.keep_history(0, self.scene.max_iterations if history else 0)
        self._engine.submit([steps], most_unconverged)
        with self._use.held(allowed=NOTHING):
            advance([self._engine], self._threads, on_progress)
        last_steps = self._engine.last_steps
        if last_steps.errors:
            raise last_steps.errors[0]
        return last_steps

    def infeasible_grains(self) -> tuple[int, ...]:
        """Return the grains that cannot fit, if it is proved that the last step has no solution; else ().

        An empty tuple proves nothing. A search takes about 5 ms, and 16 us for every grain.

        Raises
        ------
        SimulationError
            No step has been taken since the start, or since `restore`.
        """
        self._require_step()
        return infeasible_grains(self._records, 0)

    def change(self, **fields: Unpack[SceneChanges]) -> None:
        """Change some fields of the scene, such as drag=0.1, and continue from the present state.

        Contacts and forces remain those of the last step until the next step. Only contacts with walls that
        the change moves are dropped at once; so are tangential forces and spins if friction is turned off.

        Time continues: after a change of `dt`, `scene.time` is the present time less `steps` new steps. New
        walls without `start_time` begin to move now. A driven wall keeps place and speed if its ends are as
        in `scene`, the outer wall if `radius_out` is not given; else it begins at rest at its given place.

        Raises
        ------
        InputError
            A value is invalid, a field is one of the start, such as `position`, or a new wall is where a
            grain is.
        """
        with self._use.held():
            change = change_of(self.scene, fields, self.steps, self.position, self.driven)
            if change.is_local and self._engine.fits(0, change.scene):
                change_scene(self._records, 0, change.scene, change.keeps_list)
                return
            state = change.state_after(self.state())
            if state.last_scene is None:
                state = replace(state, last_scene=self.scene)
            require_state(state, change.scene)
            self._begin(change.scene, state)

    def add(
        self,
        *,
        position: ArrayLike,
        radius: ArrayLike,
        mass: ArrayLike,
        velocity: ArrayLike | None = None,
        spin: ArrayLike | None = None,
        separate: bool = False,
    ) -> IndexArray:
        """Add grains at the end of every array, and continue from the present state.

        The next step starts from the corrections of all contacts so far, as after `change`. In the order
        "color" it visits contacts in another order. `scene` then has all grains as they are now.

        Parameters
        ----------
        position : array_like
            Centers [m], shape (m, 2).
        radius, mass : array_like
            [m] and [kg], shape (m,), or one number for all added grains.
        velocity : array_like, optional
            Present velocities [m/s], shape (m, 2); by default the grains rest.
        spin : array_like, optional
            Present angular velocities [rad/s], shape (m,), or one number for all; by default 0.
        separate : bool
            Whether to move grains apart if an added one overlaps another grain or a wall, as
            `warpgrains.separate` does; this may also move grains that were there before.

        Returns
        -------
        Numbers of birth of the added grains, see `id`, shape (m,).

        Raises
        ------
        InputError
            A value is invalid, or a grain does not fit: it is beyond a wall, or overlaps another grain or a
            wall. Messages number added grains from 0. The state is then as before.
        SimulationError
            Grains cannot be moved apart, or a callback of a run adds grains.

        Examples
        --------
        >>> other = wg.Simulation(simulation.scene, state=simulation.state())
        >>> other.add(position=[(0.0, 1.5)], radius=0.1, mass=0.1)
        array([15])
        >>> other.remove([0, 3])
        >>> other.id
        array([ 1,  2,  4,  5,  6,  7,  8,  9, 10, 11, 12, 13, 14, 15])
        """
        more = {"position": position, "radius": radius, "mass": mass, "velocity": velocity, "spin": spin}
        is_separated = checks.boolean("separate", separate)
        with self._use.held():
            n = self.scene.n
            self._populate(Population(self.scene, self.state()).with_more(is_separated, **more))
            return self.id[n:]

    def pour(
        self,
        count: int,
        *,
        radius: Any,
        density: float,
        region: Mapping[str, Any] | None = None,
        velocity: tuple[float, float] = (0.0, 0.0),
        seed: int = 0,
    ) -> IndexArray:
        """Add grains at random free places of a region, as `add` does.

        Random places and radii depend on the seed and on the number of births so far. So repeated calls,
        also after `load`, need no other seed. Places and radii do not depend on the number of threads.

        Parameters
        ----------
        count : int
            Number of grains. Fewer are added if a grain finds no room in a thousand tries; the largest are
            placed first.
        radius
            As `grains.radius` of the layout "random" in scene files [m], such as 0.1 or (0.08, 0.12).
        density : float
            Mass by area [kg/m2].
        region : mapping, optional
            Ranges ``x``, ``y`` and ``distance`` [m], in which grains lie; by default the whole domain.
        velocity : tuple of float
            Present velocity of all added grains [m/s].
        seed : int
            Seed of the random numbers.

        Returns
        -------
        Numbers of birth of the added grains, shape (m,), where m is at most `count`.

        Raises
        ------
        InputError
            A value is invalid, or the region is too narrow for the grains even if it is empty.
        SimulationError
            A callback of a run adds grains.

        Examples
        --------
        >>> other = wg.Simulation(simulation.scene, state=simulation.state())
        >>> other.pour(3, radius=(0.05, 0.1), density=10.0, region={"y": (1.0, 2.0)})
        array([15, 16, 17])
        """
        velocity = checks.vector("velocity", velocity)
        seed = checks.whole_number("seed", seed, least=0)
        with self._use.held():
            n, present = self.scene.n, Population(self.scene, self.state())
            found = present.with_poured(count, radius, density, region, velocity, seed)
            if found is not present:
                self._populate(found)
            return self.id[n:]

    def remove(self, which: ArrayLike) -> None:
        """Remove grains and their contacts, and continue from the present state as after `add`.

        Parameters
        ----------
        which : array_like
            Numbers of birth, see `id`, such as ``simulation.id[simulation.position[:, 1] < 0.0]``.

        Raises
        ------
        InputError
            A grain does not exist or is given twice, or none would be left.
        """
        with self._use.held():
            self._populate(Population(self.scene, self.state()).without(which))

    @property
    def inflow(self) -> list[Inflow]:
        """Counts of the grains of each of `Scene.sources` so far; [] without sources."""
        flow = self._records.populations[0]["inflow"]
        return [] if flow is None else [Inflow(*row) for row in flow.tolist()]

    @property
    def outflow(self) -> list[Outflow]:
        """Number and mass of the grains that each of `Scene.sinks` has removed so far; [] without sinks."""
        flow = self._records.populations[0]["outflow"]
        return [] if flow is None else [Outflow(int(grains), mass) for grains, mass in flow.tolist()]

    def _exchange(self) -> None:
        """Exchange grains with sources and sinks, if an exchange is due before the next step."""
        if not self.scene.exchanges_grains or self._records.populations[0]["exchanged"] == self.steps:
            return
        if steps_to_exchange(self.scene, self.steps - 1) > 1:
            return
        found = exchanged(Population(self.scene, self.state()))
        if found.scene is self.scene:
            self._records.populations[0] = {name: getattr(found.state, name) for name in OF_POPULATION}
        else:
            self._populate(found)

    def _populate(self, grains: Population) -> None:
        require_state(grains.state, grains.scene)
        self._begin(grains.scene, grains.state)

    def last_start(self) -> StepStart:
        """Return positions, velocities and spins at the start of the last step.

        Raises
        ------
        SimulationError
            No step has been taken since the start, or since `restore`.
        """
        self._require_step()
        position, velocity = (self._grains(name) for name in ("last_position", "last_velocity"))
        spin = self._grains("last_spin") if self.scene.has_friction else None
        return StepStart(position, velocity, self.last_staggered, spin)

    def _require_step(self) -> None:
        if not self._records.has_stepped(0):
            raise SimulationError("no step has been taken from this state: call step() first")

    def observed(self) -> AbstractContextManager[None]:
        """Return a context in which callbacks of a run can read the simulation, but not change it."""
        return self._use.held(READ, allowed=READ)

    def state(self) -> State:
        """Return the exact state. After `restore`, a simulation continues from it with the same bits."""
        with self._use.held(READ):
            return super().state()

    def restore(self, state: State) -> None:
        """Continue from a state of this scene.

        Raises
        ------
        InputError
            `state` is invalid or belongs to other grains. The message names field, grain and value.
        """
        require_state(state, self.scene)
        with self._use.held():
            self.replace_state(state)
        warn_of_state_overlaps(state, self.scene)

    @documented(OPTIONS[name] for name in Outputs.__annotations__)
    def run(
        self,
        steps: int | None = None,
        duration: float | None = None,
        until: str | Question | EndCriterion | None = None,
        *,
        observer: Observer | None = None,
        progress: bool = False,
        style: str | Path | None = None,
        **outputs: Unpack[Outputs],
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
        observer : object, optional
            Object that measures during the run, such as a `warpgrains.analysis.Series`.
            ``observe(simulation)`` is called at multiples of its ``every`` steps, ``flush()`` before a
            checkpoint and at the end. The observer may read the simulation, but neither advance nor
            change it. Checkpoints do not contain the observer: `resume` continues without it.
        progress : bool
            Whether to show a progress bar on standard error.
        style : str or Path, optional
            TOML file with values for some of the options below; options that are given replace them.
        {fields}

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
        In a frame within a step, positions are interpolated linearly between the ends of the step. If an
        output is a symbolic link, its target is written.
        """
        for name in outputs:
            if name in OPTIONS.keys() - Outputs.__annotations__.keys():
                raise InputError(f"unknown option of a run {name!r}: Simulation.measure measures quantities")
            checks.one_of("option of a run", name, Outputs.__annotations__)
        text, question = (until, None) if isinstance(until, str) else (None, until)
        wanted = steps_of(self.scene, steps, duration)
        options = RunOptions(steps=wanted, until=text, **with_style(cast(dict[str, Any], outputs), style))
        run = SceneRun(self.scene, options, self.steps, question)
        if question is not None and options.checkpoint is not None:
            raise InputError(
                "until is a function, which a checkpoint cannot hold: use a text such as 'rest,speed=0.01'"
            )
        if observer is not None:
            require_observer(observer)
            run.observer = observer
        with self._use.held(), run.opened():
            return run.carry_out(self, progress)

    @classmethod
    def resume(
        cls,
        path: str | Path,
        steps: int | None = None,
        duration: float | None = None,
        *,
        device: str = "cpu",
        threads: int | None = None,
        progress: bool = False,
        checkpoint: str | Path | None = None,
        every: int | None = None,
    ) -> tuple[Self, Summary]:
        """Continue the run of a checkpoint and its outputs, with the bits of a run that was not interrupted.

        Parameters
        ----------
        path : str or Path
            The checkpoint. If `save` has written it, a new run begins, by default to the end of the scene.
        steps : int, optional
            Total number of steps; or
        duration : float, optional
            total simulated time [s]; by default, the run ends as planned.
        device, threads
            See `Simulation`.
        progress : bool
            Whether to show a progress bar on standard error.
        checkpoint : str or Path, optional
            File for the next checkpoints, by default ``path``.
        every : int, optional
            Steps between two checkpoints, and between two rows of a series; by default as before.

        Returns
        -------
        The simulation at the end of the run, and the summary of the whole run.

        Raises
        ------
        InputError
            The checkpoint or an output cannot be read or continued, or the run cannot end there.
        SimulationError
            A step failed.

        Examples
        --------
        >>> summary = wg.Simulation("annulus").run(steps=20, checkpoint="run.npz")
        >>> simulation, summary = wg.Simulation.resume("run.npz", steps=50)
        >>> simulation.steps, summary.steps
        (50, 50)
        """
        given = {"every": every} | ({} if checkpoint is None else {"checkpoint": checkpoint})
        run = ResumedRun(checks.path("path", path), steps, duration, given)
        with run.opened():
            simulation = cls(run.scene, device, threads, run.state)
            return simulation, run.carry_out(simulation, progress)

    def measure(
        self,
        quantities: str | Iterable[str],
        steps: int | None = None,
        duration: float | None = None,
        every: int = 1,
        **how: Unpack[Measuring],
    ) -> Series:
        """Advance by many time steps, and return a series of quantities.

        Parameters
        ----------
        quantities : str or iterable of str
            Names of `analysis.QUANTITIES` or `analysis.GROUPS`, such as "stress_xy" or "force_x:top".
        steps, duration
            See `run`.
        every : int
            Steps between two rows.
        how
            Keywords ``region``, ``mean`` and ``path`` of `analysis.Series`.

        Raises
        ------
        InputError
            An argument is invalid, or the scene cannot have a quantity.
        SimulationError
            A step failed.

        Examples
        --------
        >>> series = wg.Simulation("annulus").measure(["kinetic_energy", "force_y:Outer"], duration=0.1)
        >>> len(series.rows), series.average(after=0.05)["kinetic_energy"].mean > 0.0
        (11, True)
        """
        from warpgrains.analysis.quantities import require_quantities
        from warpgrains.analysis.series import Series

        with Series(quantities, every, **how) as series:
            require_quantities(series.names, self.scene, series.region)
            self.run(steps, duration, observer=series)
        return series

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

    @documented([LOOKS[name] for name in LOOKS if name not in STILL.lacks])
    def plot(self, *, style: str | Path | None = None, **looks: Unpack[Looks]) -> Picture:
        """Return a picture of the present state. Notebooks show it.

        Parameters
        ----------
        style : str or Path, optional
            TOML file with values of the following options; options that are given replace them.
        {fields}

        Raises
        ------
        InputError
            The coloring is unknown, the size or the frame is invalid, or Matplotlib is not installed.
        """
        with requiring("plot"):
            from warpgrains.pictures.still import Picture

        for name in looks:
            checks.one_of("option of a picture", name, LOOKS.keys() - set(STILL.lacks))
        painter = Painter(self.scene, Look(**with_style(looks, style)))
        return Picture(painter, snapshot_of(self, has_contacts=painter.needs_contacts))

    def save(self, path: str | Path) -> None:
        """Save the exact state and the scene to a checkpoint, an .npz file, atomically.

        Raises
        ------
        InputError
            The checkpoint cannot be written. It is an `OutputError` if a run writes it.
        """
        path = Path(checks.path("path", path))
        with lock_checkpoint(path):
            write_checkpoint(path, Checkpoint(self.scene, self.state(), None, Summary()))

    @classmethod
    def load(cls, path: str | Path, device: str = "cpu", threads: int | None = None) -> Self:
        """Return a simulation that continues from a checkpoint of `save` or of a run, with the same bits.

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
        return cls(kept.scene, device, threads, kept.state)
