"""States of a simulation between two steps, and their validation.

A state determines all following steps. A state that is read from a file is checked completely, because wrong
indices would let the kernels access memory outside their arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.geometry import require_distinct
from warpgrains.scene.walls import OUTER

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Corrections:
    """Accumulated corrections of the contacts, from which the next step starts (warm start).

    Attributes
    ----------
    pair : ndarray
        Grains i < j of the pairs that carry a correction, in lexicographic order, shape (m, 2).
    pair_correction : ndarray
        Corrections dv_c of these pairs [m/s], shape (m,).
    wall : ndarray
        Grain and wall (0 outer, 1 inner, 2, 3, ... those of `Scene.walls`) of the wall contacts that
        carry a correction, in lexicographic order, shape (k, 2).
    wall_correction : ndarray
        Corrections of the wall contacts, > 0 [m/s], shape (k,).
    pair_friction, wall_friction : ndarray or None
        Tangential corrections dv_t of pairs and wall contacts [m/s], shapes (m,) and (k,), along the normal
        rotated by 90 degrees to the left; None without friction.

    Examples
    --------
    >>> kept = simulation.state().corrections
    >>> kept.pair.shape, kept.pair_correction.shape, kept.wall.shape, kept.wall_correction.shape
    ((15, 2), (15,), (10, 2), (10,))
    """

    pair: IntArray
    pair_correction: FloatArray
    wall: IntArray
    wall_correction: FloatArray
    pair_friction: FloatArray | None = None
    wall_friction: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class VerletList:
    """Listed pairs and walls, and the data that decide when the list must be rebuilt (kernels/verlet.py).

    Colors depend on the list, so a run in color order needs it to continue with the same bits.

    Attributes
    ----------
    pair, wall : ndarray
        Listed pairs i < j, shape (m, 2), and listed (grain, wall), shape (k, 2), in lexicographic order. Both
        circles of the annulus are wall 0 here.
    skin, recent_deviation : ndarray
        Skin [m] and recent deviation [m/s] of every grain, and wall if one is driven, shape (n,).
    reference_position, reference_velocity : ndarray
        Position [m] and velocity [m/s] of these when the list was built, shape (n, 2).
    frame_shift : ndarray
        Path of the frame since the list was built [m], shape (2,).
    base_skin, frame_skin : float
        Base of the skins, and the path that the list allows the frame [m].
    elapsed, lifetime : float
        Time since the list was built, and that for which it was built [s].
    """

    pair: IntArray
    wall: IntArray
    skin: FloatArray
    recent_deviation: FloatArray
    reference_position: FloatArray
    reference_velocity: FloatArray
    frame_shift: FloatArray
    base_skin: float
    frame_skin: float
    elapsed: float
    lifetime: float


VERLET_NUMBERS = ("base_skin", "frame_skin", "elapsed", "lifetime")


@dataclass(frozen=True, eq=False)
class State:
    """The exact state between two steps, which determines all following steps.

    Attributes
    ----------
    steps : int
        Steps done since the start.
    position, velocity : ndarray
        Positions [m] and velocities [m/s], shape (n, 2). The last step moved grains with the velocities.
    corrections : Corrections
        Corrections of the contacts.
    lists : VerletList or None
        The Verlet list. Without it, a run in color order continues with another order of contacts.
    staggered : bool
        Whether velocities are half a step behind positions, as after any step of the leapfrog scheme. That
        scheme continues with a full kick if they are, else with half a kick. The text's scheme makes no
        difference.
    spin, angle : ndarray or None
        Angular velocities [rad/s] and rotations since the start [rad], shape (n,); None without friction.
    driven : ndarray or None
        Coordinate [m] and speed [m/s] of every wall, shape (walls, 2), if a force drives one; else None. The
        first wall is the outer circle, whose coordinate is its radius, followed by the inner one, if there is
        one, and those of `Scene.walls`, whose coordinate is the way that they have moved.
    last_staggered : bool
        `staggered` before the last step.
    last_scene : Scene or None
        Scene of the last step, which its contacts and their forces refer to; None if it is the scene of the
        state. They differ after `Simulation.change`, until the next step.

    Examples
    --------
    >>> state = simulation.state()
    >>> state.steps, state.position.shape, len(state.corrections.pair), state.staggered
    (400, (15, 2), 15, False)
    >>> other = wg.Simulation(simulation.scene)
    >>> other.restore(state)  # and continues with the same bits
    """

    steps: int
    position: FloatArray
    velocity: FloatArray
    corrections: Corrections
    lists: VerletList | None = None
    staggered: bool = False
    spin: FloatArray | None = None
    angle: FloatArray | None = None
    driven: FloatArray | None = None
    last_staggered: bool = False
    last_scene: Scene | None = None


def first_state(scene: Scene) -> State:
    """Return the initial state of a scene."""
    nobody, nothing = np.zeros((0, 2), np.int32), np.zeros(0)
    corrections = Corrections(nobody, nothing, nobody, nothing)
    state = State(0, scene.position, scene.velocity, corrections)
    if scene.has_friction:
        state = replace(state, spin=scene.spin_at_start, angle=np.zeros(scene.n))
    if scene.has_driven_walls:
        driven = np.zeros((len(scene.bodies), 2))
        driven[OUTER, 0] = scene.radius_out
        state = replace(state, driven=driven)
    return state


def require_state(state: State, scene: Scene) -> None:
    """Raise InputError unless a simulation of `scene` can continue from `state`."""
    n, walls = scene.n, scene.wall_numbers
    _require_kind("state", state, State)
    checks.whole_number("steps", state.steps, least=0)
    for name in ("staggered", "last_staggered"):
        checks.boolean(name, getattr(state, name))
    for name in ("position", "velocity"):
        _require_array(name, getattr(state, name), np.float64, (n, 2))
        checks.require_finite(f"{name} of the state, that", getattr(state, name))
    require_distinct("position of the state, that", state.position)
    for name in ("spin", "angle"):
        if getattr(state, name) is not None:
            _require_array(name, getattr(state, name), np.float64, (n,))
            checks.require_finite(f"{name} of the state, that", getattr(state, name))
    bodies = n + _require_driven(state.driven, scene)
    _require_corrections(state.corrections, n, walls)
    if state.lists is not None:
        _require_lists(state.lists, n, walls, bodies)
        _require_listed(state.corrections, state.lists, scene)
    if state.last_scene is not None:
        require_state(replace(state, lists=None, last_scene=None), state.last_scene)


def _require_driven(driven: Any, scene: Scene) -> int:
    """Return the number of walls that have a speed; raise InputError unless the state has that of each."""
    if not scene.has_driven_walls:
        if driven is not None:
            raise InputError("driven of the state is given, and no force drives a wall of the scene")
        return 0
    walls = len(scene.bodies)
    _require_array("driven", driven, np.float64, (walls, 2))
    if not np.isfinite(driven).all():
        raise InputError(f"driven of the state is {driven.tolist()}: it must be finite")
    checks.positive("radius of the outer wall in the state", driven[OUTER, 0])
    return walls


def _require_corrections(corrections: Corrections, n: int, walls: Sequence[int]) -> None:
    _require_kind("corrections", corrections, Corrections)
    _require_pairs("pair", corrections.pair, n)
    _require_array("pair_correction", corrections.pair_correction, np.float64, (len(corrections.pair),))
    _require_walls("wall", corrections.wall, n, walls)
    _require_array("wall_correction", corrections.wall_correction, np.float64, (len(corrections.wall),))
    for name, other in (("pair", "and"), ("wall", "at wall")):
        value = getattr(corrections, f"{name}_correction")
        bad = ~(np.isfinite(value) & (value >= 0.0))
        if bad.any():
            i, j = getattr(corrections, name)[bad][0].tolist()
            of = f"that of grain{'s' * (name == 'pair')} {i} {other} {j} is {value[bad][0].item()}"
            raise InputError(f"{name}_correction of the state, {of}: it must be 0 or more")
        tangential = getattr(corrections, f"{name}_friction")
        if tangential is not None:
            _require_array(f"{name}_friction", tangential, np.float64, value.shape)
            checks.require_finite(f"{name}_friction of the state, that", tangential)


def _require_lists(lists: VerletList, n: int, walls: Sequence[int], bodies: int) -> None:
    _require_kind("lists", lists, VerletList)
    _require_pairs("listed pair", lists.pair, n)
    _require_walls("listed wall", lists.wall, n, walls)
    shapes: dict[str, tuple[int, ...]] = {"frame_shift": (2,)}
    shapes |= dict.fromkeys(("skin", "recent_deviation"), (bodies,))
    shapes |= dict.fromkeys(("reference_position", "reference_velocity"), (bodies, 2))
    for name, shape in shapes.items():
        _require_array(name, getattr(lists, name), np.float64, shape)
        if np.isnan(getattr(lists, name)).any():
            raise InputError(f"{name} of the state holds NaN")
    for name in VERLET_NUMBERS:
        value = getattr(lists, name)
        if not (isinstance(value, float) and value >= 0.0):
            raise InputError(f"{name} of the state is {checks.shown(value)}: it must be a number, 0 or more")


def _require_listed(corrections: Corrections, lists: VerletList, scene: Scene) -> None:
    n, bodies = scene.n, scene.bodies
    pairs = np.isin(_keys(corrections.pair, n), _keys(lists.pair, n))
    body, listed = (bodies.of(of.wall[:, 1]) for of in (corrections, lists))
    walls = np.isin(corrections.wall[:, 0] + n * body, lists.wall[:, 0] + n * listed)
    if not (pairs.all() and walls.all()):
        raise InputError("a contact of the state carries a correction but is not in the list of contacts")


def _require_pairs(name: str, pair: IntArray, n: int) -> None:
    _require_array(name, pair, np.int32, (_length(pair), 2))
    i, j = pair.T
    if not ((i >= 0) & (i < j) & (j < n)).all():
        raise InputError(f"{name} of the state must name grains i < j below {n}")
    _require_ascending(name, _keys(pair, n), n * n)


def _require_walls(name: str, wall: IntArray, n: int, walls: Sequence[int]) -> None:
    _require_array(name, wall, np.int32, (_length(wall), 2))
    grain, number = wall.T
    if not ((grain >= 0) & (grain < n) & np.isin(number, walls)).all():
        raise InputError(f"{name} of the state must name a grain below {n} and a wall of the scene")
    most = max(walls) + 1
    _require_ascending(name, grain.astype(np.int64) * most + number, n * most)


def _require_ascending(name: str, values: np.ndarray[Any, Any], end: int) -> None:
    """Raise InputError unless values ascend strictly within [0, end)."""
    bounded = np.concatenate([[-1], values, [end]])
    if not (np.diff(bounded) > 0).all():
        raise InputError(f"{name} of the state must be in ascending order")


def _length(array: Any) -> int:
    return len(array) if isinstance(array, np.ndarray) and array.ndim > 0 else 0


def _require_kind(name: str, record: Any, kind: type) -> None:
    if not isinstance(record, kind):
        raise InputError(f"{name} is a {type(record).__name__}: it must be a {kind.__name__}")


def _require_array(name: str, array: Any, dtype: type, shape: tuple[int, ...]) -> None:
    if not isinstance(array, np.ndarray) or isinstance(array, np.ma.MaskedArray):
        raise InputError(f"{name} of the state is a {type(array).__name__}: it must be an array")
    if array.dtype != dtype or array.shape != shape:
        found, wanted = f"{array.dtype} {array.shape}", f"{np.dtype(dtype)} {shape}"
        raise InputError(f"{name} of the state is {found}: it must be {wanted}")


def _keys(pair: IntArray, n: int) -> np.ndarray[Any, Any]:
    """Number all pairs of n grains in lexicographic order, shape (m,)."""
    i, j = pair.astype(np.int64).T
    return i * n + j
