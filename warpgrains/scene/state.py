"""States: all that the steps after them depend on, and whether something read from a file is one.

A state of other grains would lead the kernels out of their arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.errors import SceneError
from warpgrains.scene import checks
from warpgrains.scene.geometry import require_distinct
from warpgrains.scene.walls import body_of

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Corrections:
    """Accumulated corrections: all that the warm start of the next step needs.

    Attributes
    ----------
    pair : ndarray
        Grains i < j of the pairs that carry a correction, in lexicographic order, shape (m, 2).
    pair_correction : ndarray
        Their corrections dv_c [m/s], shape (m,).
    wall : ndarray
        Grain and wall (0 outer, 1 inner, 2, 3, ... those of `Scene.walls`) of the contacts with walls that
        carry one, in lexicographic order, shape (k, 2).
    wall_correction : ndarray
        Their corrections, > 0 [m/s], shape (k,).
    pair_friction, wall_friction : ndarray or None
        Their tangential corrections dv_t [m/s], shapes (m,) and (k,), along the normal turned by a quarter to
        the left; None without friction.

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
    """What is listed as a candidate contact, and what is known of how long it will do (kernels/verlet.py).

    Colors depend on what is listed, so a run in color order continues with the same bits only from these.

    Attributes
    ----------
    pair, wall : ndarray
        Listed pairs i < j, shape (m, 2), and grains and walls, shape (k, 2), in lexicographic order; the
        circles of the annulus are one, 0.
    skin, recent_deviation : ndarray
        Of every grain [m], [m/s], shape (n,).
    reference_position, reference_velocity : ndarray
        Of every grain when the list was built [m], [m/s], shape (n, 2).
    frame, scalar : ndarray
        The vectors and the numbers of `kernels.types.VerletNumbers`, shapes (3, 2) and (7,).
    """

    pair: IntArray
    wall: IntArray
    skin: FloatArray = field(metadata={"stored": "reach"})
    recent_deviation: FloatArray = field(metadata={"stored": "recent"})
    reference_position: FloatArray = field(metadata={"stored": "built_position"})
    reference_velocity: FloatArray = field(metadata={"stored": "built_velocity"})
    frame: FloatArray
    scalar: FloatArray


@dataclass(frozen=True, eq=False)
class State:
    """The exact state between two steps: all that the following steps depend on.

    Attributes
    ----------
    steps : int
        Steps done since the start.
    position, velocity : ndarray
        [m] and [m/s], shape (n, 2). A velocity is that with which the last step moved its grain.
    corrections : Corrections
        What the contacts carry.
    lists : VerletList or None
        What was listed; without it, a run in color order continues with an order of its own.
    staggered : bool
        Whether velocities are half a step behind positions: those of the middle of the last step, as after
        any step of the leapfrog scheme, which goes on from them by a whole kick, and from others by half of
        one. The text's scheme takes them as they are.
    spin, angle : ndarray or None
        Angular velocities [rad/s], and angles by which grains have turned since the start [rad], shape (n,);
        None without friction.

    Examples
    --------
    >>> state = simulation.state()
    >>> state.steps, state.position.shape, len(state.corrections.pair), state.staggered
    (400, (15, 2), 15, False)
    >>> other = wg.Simulation(simulation.scene)
    >>> other.restore(state)  # and goes on with the same bits
    """

    steps: int
    position: FloatArray
    velocity: FloatArray
    corrections: Corrections
    lists: VerletList | None = None
    staggered: bool = False
    spin: FloatArray | None = None
    angle: FloatArray | None = None


def first_state(scene: Scene) -> State:
    """Return the state at the start of a scene."""
    nobody, nothing = np.zeros((0, 2), np.int32), np.zeros(0)
    corrections = Corrections(nobody, nothing, nobody, nothing)
    if not scene.has_friction:
        return State(0, scene.position, scene.velocity, corrections)
    return State(0, scene.position, scene.velocity, corrections, spin=scene.spin, angle=np.zeros(scene.n))


def require_state(state: State, scene: Scene) -> None:
    """Raise SceneError unless a simulation of a scene can continue from a state."""
    n, walls = scene.n, scene.wall_numbers
    _require_kind("state", state, State)
    checks.whole_number("steps", state.steps, least=0)
    checks.truth("staggered", state.staggered)
    for name in ("position", "velocity"):
        _require_array(name, getattr(state, name), np.float64, (n, 2))
        checks.require_finite(f"{name} of the state, that", getattr(state, name))
    require_distinct("position of the state, that", state.position)
    for name in ("spin", "angle"):
        if getattr(state, name) is not None:
            _require_array(name, getattr(state, name), np.float64, (n,))
            checks.require_finite(f"{name} of the state, that", getattr(state, name))
    _require_corrections(state.corrections, n, walls)
    if state.lists is not None:
        _require_lists(state.lists, n, walls)
        _require_listed(state.corrections, state.lists, n, scene.has_two_circles)


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
            raise SceneError(f"{name}_correction of the state, {of}: it must be 0 or more")
        tangential = getattr(corrections, f"{name}_friction")
        if tangential is not None:
            _require_array(f"{name}_friction", tangential, np.float64, value.shape)
            checks.require_finite(f"{name}_friction of the state, that", tangential)


def _require_lists(lists: VerletList, n: int, walls: Sequence[int]) -> None:
    _require_kind("lists", lists, VerletList)
    _require_pairs("listed pair", lists.pair, n)
    _require_walls("listed wall", lists.wall, n, walls)
    shapes = {"frame": (3, 2), "scalar": (7,)}
    shapes |= dict.fromkeys(("skin", "recent_deviation"), (n,))
    shapes |= dict.fromkeys(("reference_position", "reference_velocity"), (n, 2))
    for name, shape in shapes.items():
        _require_array(name, getattr(lists, name), np.float64, shape)
        if np.isnan(getattr(lists, name)).any():
            raise SceneError(f"{name} of the state holds what is no number")


def _require_listed(corrections: Corrections, lists: VerletList, n: int, two_circles: bool) -> None:
    pairs = np.isin(_keys(corrections.pair, n), _keys(lists.pair, n))
    body, listed = (body_of(of.wall[:, 1], two_circles) for of in (corrections, lists))
    walls = np.isin(corrections.wall[:, 0] + n * body, lists.wall[:, 0] + n * listed)
    if not (pairs.all() and walls.all()):
        raise SceneError("a contact of the state carries a correction and is not listed")


def _require_pairs(name: str, pair: IntArray, n: int) -> None:
    _require_array(name, pair, np.int32, (_length(pair), 2))
    i, j = pair.T
    if not ((i >= 0) & (i < j) & (j < n)).all():
        raise SceneError(f"{name} of the state is not of grains i < j of {n}")
    _require_ascending(name, _keys(pair, n), n * n)


def _require_walls(name: str, wall: IntArray, n: int, walls: Sequence[int]) -> None:
    _require_array(name, wall, np.int32, (_length(wall), 2))
    grain, number = wall.T
    if not ((grain >= 0) & (grain < n) & np.isin(number, walls)).all():
        raise SceneError(f"{name} of the state is not of a grain of {n} and a wall that the scene has")
    most = max(walls) + 1
    _require_ascending(name, grain.astype(np.int64) * most + number, n * most)


def _require_ascending(name: str, values: np.ndarray[Any, Any], end: int) -> None:
    """Check that values are ascending in the range from 0 to `end`, exclusive."""
    bounded = np.concatenate([[-1], values, [end]])
    if not (np.diff(bounded) > 0).all():
        raise SceneError(f"{name} of the state is not in ascending order")


def _length(array: Any) -> int:
    return len(array) if isinstance(array, np.ndarray) and array.ndim > 0 else 0


def _require_kind(name: str, record: Any, kind: type) -> None:
    if not isinstance(record, kind):
        raise SceneError(f"{name} is a {type(record).__name__}: it must be a {kind.__name__}")


def _require_array(name: str, array: Any, dtype: type, shape: tuple[int, ...]) -> None:
    if not isinstance(array, np.ndarray) or isinstance(array, np.ma.MaskedArray):
        raise SceneError(f"{name} of the state is a {type(array).__name__}: it must be an array")
    if array.dtype != dtype or array.shape != shape:
        found, wanted = f"{array.dtype} {array.shape}", f"{np.dtype(dtype)} {shape}"
        raise SceneError(f"{name} of the state is {found}: it must be {wanted}")


def _keys(pair: IntArray, n: int) -> np.ndarray[Any, Any]:
    """Number all pairs of n grains in lexicographic order, shape (m,)."""
    i, j = pair.astype(np.int64).T
    return i * n + j
