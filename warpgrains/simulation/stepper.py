"""A scene on a device, advanced step by step: `Simulation` without files and pictures."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar, Unpack
from warnings import warn

from warpgrains.analysis.energy import TOLERANCES
from warpgrains.arrays import FloatArray
from warpgrains.described import fields_in_help
from warpgrains.errors import SimulationError
from warpgrains.scene import checks
from warpgrains.scene.fields import SceneChanges
from warpgrains.scene.scene import Scene, SceneLike, as_scene
from warpgrains.scene.state import State, first_state, require_state
from warpgrains.shown import Shown, number_of
from warpgrains.simulation.changes import change_of
from warpgrains.solver.advance import OnProgress, advance
from warpgrains.solver.engine import Engine
from warpgrains.solver.last_steps import LastSteps
from warpgrains.solver.present import PresentState
from warpgrains.solver.statistics import RunStatistics, StepReport
from warpgrains.solver.tuning import threads_for
from warpgrains.turns import NOTHING, READ, ExclusiveUse
from warpgrains.warp_start import find_device

Begun = TypeVar("Begun", bound="Stepper")
LEAST_WARNED = 1e-6  # overlap at the start [smallest radii] below which nobody is warned


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


class Stepper(PresentState, Shown):
    """A scene and its engine. It is the base of `Simulation`, which adds files and pictures."""

    def __init__(
        self,
        scene: SceneLike,
        device: str = "cpu",
        threads: int | None = None,
        **overrides: Unpack[SceneChanges],
    ):
        scene = as_scene("scene", scene)
        scene = scene.replace(**overrides) if overrides else scene
        self._open(scene, device, threads)
        overlap = scene.count_overlaps().largest
        if overlap > max(TOLERANCES * scene.tolerance * scene.dt, LEAST_WARNED * scene.smallest_radius):
            warn(
                f"grains overlap by up to {overlap:.1e} m at the start, which the first step turns into"
                f" {overlap / scene.dt:.1e} m/s: warpgrains.separate, or run --separate, moves them apart",
                stacklevel=2,
            )

    def __reduce__(self) -> tuple[Any, ...]:
        return continued, (type(self), self.scene, self.state(), self._device.alias, self._threads_wanted)

    def _open(self, scene: Scene, device: str, threads: int | None, state: State | None = None) -> None:
        if threads is not None:
            checks.thread_count("threads", threads)
        self._device, self._threads_wanted = find_device(device), threads
        self._use = ExclusiveUse("simulation")
        self._begin(scene, state)

    def _begin(self, scene: Scene, state: State | None) -> None:
        self._threads = threads_for(scene, self._device, self._threads_wanted)
        PresentState.__init__(self, scene, Engine([scene], self._device, self._threads))
        self._engine.load(0, first_state(scene) if state is None else state)

    def summary(self) -> dict[str, str]:
        """Return the line that describes the simulation, by name."""
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
        SimulationError
            A number is no longer finite; or the step has not converged and the scene's `on_unconverged` is
            "raise" (the state is then that before the step); or a history of `max_iterations` does not fit in
            memory; or another thread advances this simulation.
        """
        with self._use.held():
            report = self._advance(1, None, history).report(0)
            return replace(report, history=self._engine.history(0)) if history else report

    def advance(self, steps: int, on_progress: OnProgress | None = None) -> RunStatistics:
        """Advance by many time steps without outputs or callbacks between them.

        Parameters
        ----------
        steps : int
            0 or more.
        on_progress : callable, optional
            Called occasionally with the number of steps done since its last call.

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
        with self._use.held():
            return self._advance(steps, on_progress).statistics(0)

    def _advance(self, steps: int, on_progress: OnProgress | None, history: bool = False) -> LastSteps:
        self._engine.keep_history(0, history)
        self._engine.submit([steps])
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
        return self._engine.infeasible_grains(0)

    def change(self, **fields: Unpack[SceneChanges]) -> None:
        """Change some fields of the scene, such as drag=0.1, and continue from the present state.

        Contacts and forces remain those of the last step until the next one; but those with walls that are
        elsewhere afterwards are dropped at once, and tangential forces and spins if friction is turned off.

        Time goes on: after a change of `dt`, the `time` of the scene is when such steps would have begun. New
        walls without `from_time` begin to move now. A driven wall continues if it has the same ends as in
        `scene`, and the outer one without `radius_out`; else it begins at rest where it is given.

        Raises
        ------
        InputError
            A value is invalid, a field is one of the start, such as `position`, or a new wall is where a
            grain is.
        """
        with self._use.held():
            change = change_of(self.scene, fields, self.steps, self.position, self.driven)
            if change.is_local and self._engine.change(self._index, change.scene, change.keeps_list):
                self.scene = change.scene
                return
            state = change.state_after(self.state())
            if state.last_scene is None:
                state = replace(state, last_scene=self.scene)
            require_state(state, change.scene)
            self._begin(change.scene, state)

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
        return StepStart(position, velocity, self._engine.last_staggered(0), spin)

    def _require_step(self) -> None:
        if not self._engine.has_stepped(0):
            raise SimulationError("no step has been taken from this state: call step() first")

    def observed(self) -> AbstractContextManager[None]:
        """Return the context in which callbacks of a run may read the simulation, but not change it."""
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
            self._engine.load(0, state)


def continued(
    kind: type[Begun], scene: Scene, state: State, device: str = "cpu", threads: int | None = None
) -> Begun:
    """Return a simulation that continues from a state of its scene, for example that of a checkpoint."""
    require_state(state, scene)
    simulation = kind.__new__(kind)
    simulation._open(scene, device, threads, state)
    return simulation
