"""Snapshots of simulations and states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import TYPE_CHECKING, Any, Protocol, overload

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.scene.snapshot import Snapshot, Snapshots
from warpgrains.solver.forces import contacts_at, start_of_step

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.state import State
    from warpgrains.solver.loaded_scene import LoadedScene


class HasState(Protocol):
    """Protocol of objects that have a scene and return a state, such as a `Simulation`."""

    @property
    def scene(self) -> Scene:
        """Scene of the state."""

    def state(self) -> State:
        """Return the present state."""


@overload
def snapshot(of: Snapshot | HasState) -> Snapshot: ...
@overload
def snapshot(of: Scene, state: State) -> Snapshot: ...
def snapshot(of: Any, state: State | None = None) -> Snapshot:
    """Return grains and contacts of a simulation at present, or of a state of a scene.

    Parameters
    ----------
    of : Simulation, Scene or Snapshot
        A simulation; a scene, together with a state of it; or a snapshot, which is returned.
    state : State, optional
        State of the scene, for example from `Batch.state`.

    Raises
    ------
    InputError
        `of` is none of these, or a scene without a state.

    Examples
    --------
    >>> now = analysis.snapshot(simulation.scene, simulation.state())
    >>> analysis.kinetic_energy(now) == analysis.kinetic_energy(simulation)
    True
    """
    if isinstance(of, Snapshot):
        return of
    if state is not None and (hasattr(of, "scene") or not hasattr(state, "last_scene")):
        raise InputError(
            f"snapshot takes a Scene and a State, not a {type(of).__name__} and a {type(state).__name__}"
        )
    if state is None and not (hasattr(of, "scene") and hasattr(of, "state")):
        told = "Simulation(scene), analysis.snapshot(scene, state) or Recording(path).frame(number)"
        raise InputError(f"{checks.shown(of)} is a {type(of).__name__}: give {told}")
    if state is None:
        scene, state = of.scene, getattr(of, "measured_state", of.state)()
    else:
        scene = of
    start, start_scene = start_of_step(scene, state)
    contacts, walls = contacts_at(start, start_scene, state)
    places = None if state.driven is None else state.driven[:, 0]
    now = Snapshot(
        scene=scene.placed(places),
        steps=state.steps,
        time=scene.time_after(state.steps),
        position=state.position,
        velocity=state.velocity,
        spin=np.zeros(scene.n) if state.spin is None else state.spin,
        angle=np.zeros(scene.n) if state.angle is None else state.angle,
        start=start,
        start_scene=start_scene,
        start_staggered=state.last_staggered,
        pair=contacts.pair,
        force=contacts.force,
        wall=walls.wall,
        wall_force=walls.force,
        tangential_force=contacts.tangential_force,
        wall_tangential_force=walls.tangential_force,
        places=places,
        births=state.id,
        inflow=state.inflow,
        outflow=state.outflow,
    )
    vars(now).update(normal=contacts.normal, wall_normal=walls.normal)  # found once, with the forces
    return now


class OfRuns(Protocol):
    """A function that returns a number for a simulation or snapshot, and shape (m,) for m `Snapshots`."""

    @overload
    def __call__(self, of: Snapshots) -> FloatArray: ...
    @overload
    def __call__(self, of: Snapshot | HasState) -> float: ...


def of_runs(function: Callable[[Snapshots], FloatArray]) -> OfRuns:
    """Let a function of `Snapshots` also take a simulation or a snapshot.

    It then raises NoAreaError if the result is NaN because the container is unknown.
    """

    @wraps(function)
    def either(of: Any) -> Any:
        if isinstance(of, Snapshots):
            return function(of)
        now = snapshot(of)
        value = function(now.grains).item()
        if np.isnan(value):
            now.container.require_known(takes_region=False)
        return value

    return either


def snapshot_of(now: LoadedScene, left: float = 0.0, has_contacts: bool = True) -> Snapshot:
    """Return a snapshot, for an output, at `left` [s] before the end of the last step of a simulation.

    Within a step, grains move in a straight line and turn with the velocities at its end (eqs. 3, 24).
    Without contacts, a snapshot takes little time.
    """
    driven = now.driven
    if has_contacts:
        end = snapshot(now)
    else:
        places = None if driven is None else driven[:, 0]
        scene, position, velocity = now.scene.placed(places), now.position, now.velocity
        end = Snapshot(
            scene=scene,
            steps=now.steps,
            time=now.time,
            position=position,
            velocity=velocity,
            spin=now.spin,
            angle=now.angle,
            start=position - scene.dt * velocity,
            start_scene=scene,
            start_staggered=now.last_staggered,
            places=places,
            births=now.id,
        )
    if left == 0.0:
        return end
    places = None if driven is None else driven[:, 0] - left * driven[:, 1]
    return replace(
        end,
        scene=now.scene.placed(places),
        time=end.time - left,
        position=end.position - left * end.velocity,
        angle=end.angle - left * end.spin,
        places=places,
    )
