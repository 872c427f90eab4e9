"""States of a simulation between two steps, and their validation.

A state determines all following steps. A state that is read from a file is checked completely, because wrong
indices would let the kernels access memory outside their arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import BoolArray, FloatArray, IndexArray, IntArray
from warpgrains.base.errors import InputError
from warpgrains.space.geometry import require_distinct
from warpgrains.walls.rim import Rim

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
        Grain and number in `Scene.walls` of the wall contacts that carry a correction, in lexicographic
        order, shape (k, 2).
    wall_correction : ndarray
        Corrections of the wall contacts, > 0 [m/s], shape (k,).
    pair_friction, wall_friction : ndarray or None
        Tangential corrections dv_t of pairs and wall contacts [m/s], shapes (m,) and (k,), along the normal
        rotated by 90 degrees to the left; None without friction.
    pair_rolling, wall_rolling : ndarray or None
        Rolling corrections dv_r of pairs and wall contacts [m/s], shapes (m,) and (k,), against the rotation
        of i relative to j or the wall; None without rolling friction.

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
    pair_rolling: FloatArray | None = None
    wall_rolling: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class VerletList:
    """The Verlet list of grains and walls, and the data for its expiry (kernels/search/verlet.py).

    Colors depend on the list, so a run in color order needs it to continue with the same bits. Where both
    circles of an annulus are one body on the device (bodies.py), `wall` names the outer one. Bodies are the
    grains and, if a force drives a wall, the bodies of walls.
    """

    pair: IntArray
    wall: IntArray
    skin: FloatArray  # [m], shape (bodies,)
    recent_deviation: FloatArray  # [m/s], shape (bodies,)
    reference_position: FloatArray  # when the list was built [m], shape (bodies, 2)
    reference_velocity: FloatArray  # [m/s], shape (bodies, 2)
    frame_shift: FloatArray  # path of the frame since the list was built [m], shape (2,)
    base_skin: float  # [m]
    frame_skin: float  # path that the list allows the frame [m]
    elapsed: float  # since the list was built [s]
    lifetime: float  # time for which the list was built [s]


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
        scheme continues with a full kick if True, else with half a kick. The text's scheme does not use it.
    spin, angle : ndarray or None
        Angular velocities [rad/s] and rotations since the start [rad], shape (n,); None without friction.
    driven : ndarray or None
        Coordinate [m] and speed [m/s] of each of `Scene.walls`, shape (walls, 2), if a force drives one; else
        None. The coordinate is the displacement of a wall, or the radius of the outer circle.
    last_staggered : bool
        `staggered` before the last step.
    id : ndarray or None
        Numbers of birth of the grains, ascending int64, shape (n,). None stands for 0, 1, ..., n - 1, before
        `Simulation.add` or `remove`.
    born : int
        Number of births so far, above all numbers of `id`; 0 if `id` is None.
    inflow : ndarray or None
        Numbers of grains of each source so far, with the columns of `Inflow`, int64, shape (sources, 4);
        None in a scene without sources and sinks.
    outflow : ndarray or None
        Number of grains and mass [kg] that each sink has taken so far, shape (sinks, 2); None if `inflow` is.
    exchanged : int
        Number of steps at the last exchange of grains by sources and sinks; -1 before the first exchange.
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
    id: IndexArray | None = None
    born: int = 0
    inflow: IndexArray | None = None
    outflow: FloatArray | None = None
    exchanged: int = -1
    last_scene: Scene | None = None


def first_state(scene: Scene) -> State:
    """Return the initial state of a scene."""
    nobody, nothing = np.zeros((0, 2), np.int32), np.zeros(0)
    corrections = Corrections(nobody, nothing, nobody, nothing)
    state = State(0, scene.position, scene.velocity, corrections)
    if scene.has_friction:
        state = replace(state, spin=scene.spin, angle=np.zeros(scene.n))
    if scene.has_driven_walls:
        state = replace(state, driven=np.array([(wall.coordinate, 0.0) for wall in scene.walls]))
    if scene.exchanges_grains:
        inflow = np.zeros((len(scene.sources), 4), np.int64)
        inflow[:, 0] = [source.due(scene.time) * (source.begin < scene.time) for source in scene.sources]
        state = replace(state, inflow=inflow, outflow=np.zeros((len(scene.sinks), 2)))
    return state


OF_POPULATION = ("id", "born", "inflow", "outflow", "exchanged")
"""Fields of a state that only the exchange of grains changes."""
MOST_BORN = 2**63 - 1
_BOUNDS: dict[str, Callable[[FloatArray], BoolArray]] = {
    "finite": np.isfinite,
    "finite and 0 or more": lambda array: np.isfinite(array) & (array >= 0.0),
    "a number": lambda array: ~np.isnan(array),
}
_ARRAYS = {
    "position": ("grain", (2,), "finite"),
    "velocity": ("grain", (2,), "finite"),
    "spin": ("grain", (), "finite"),
    "angle": ("grain", (), "finite"),
    "driven": ("wall", (2,), "finite"),
    "pair_correction": ("pair", (), "finite and 0 or more"),
    "wall_correction": ("contact", (), "finite and 0 or more"),
    "pair_friction": ("pair", (), "finite"),
    "wall_friction": ("contact", (), "finite"),
    "pair_rolling": ("pair", (), "finite"),
    "wall_rolling": ("contact", (), "finite"),
    "skin": ("body", (), "a number"),
    "recent_deviation": ("body", (), "a number"),
    "reference_position": ("body", (2,), "a number"),
    "reference_velocity": ("body", (2,), "a number"),
    "frame_shift": ("component", (), "a number"),
}
"""Float64 arrays of states and their records, by name: (kind of row, shape of a row, valid values).

An array has a row for each object of its kind, such as "grain". The valid values are a key of `_BOUNDS`.
"""


def require_state(state: State, scene: Scene) -> None:
    """Raise InputError unless a simulation of `scene` can continue from `state`."""
    _require_kind("state", state, State)
    if (state.driven is None) == scene.has_driven_walls:
        given = "missing: a" if state.driven is None else "given: no"
        raise InputError(f"driven of the state is {given} force drives a wall of the scene")
    _require_arrays(state, {"grain": scene.n, "wall": len(scene.walls)})
    checks.whole_number("steps", state.steps, least=0)
    _require_births(state, scene.n)
    _require_flow(state, scene)
    for name in ("staggered", "last_staggered"):
        checks.boolean(name, getattr(state, name))
    require_distinct("position of the state, that", scene.period.wrapped(state.position))
    for wall, (coordinate, _) in zip(scene.walls, [] if state.driven is None else state.driven, strict=False):
        if isinstance(wall, Rim) and wall.inside:
            checks.positive("radius of the outer wall in the state", coordinate)
    kept, lists = state.corrections, state.lists
    _require_contacts("corrections", kept, Corrections, scene)
    _require_arrays(kept, {"pair": len(kept.pair), "contact": len(kept.wall)})
    if lists is not None:
        _require_contacts("lists", lists, VerletList, scene)
        walls = len(scene.bodies) if scene.has_driven_walls else 0
        _require_arrays(lists, {"body": scene.n + walls, "component": 2})
        for name in VERLET_NUMBERS:
            value = getattr(lists, name)
            if not (isinstance(value, float) and value >= 0.0):
                raise InputError(f"{name} of the state is {checks.shown(value)}: it must be 0 or more")
        for index, listed in zip(_indices(kept, scene), _indices(lists, scene), strict=True):
            if not np.isin(index, listed).all():
                raise InputError("a contact of the state carries a correction but is not in its lists")
    if state.last_scene is not None:
        require_state(replace(state, lists=None, last_scene=None), state.last_scene)


def _require_births(state: State, n: int) -> None:
    checks.whole_number("born", state.born, least=0, most=MOST_BORN)
    if state.id is None:
        if state.born:
            raise InputError(f"born of the state is {state.born}: it must be 0 without id")
        return
    _require_array("id", state.id, np.int64, (n,))
    if (np.diff(state.id, prepend=-1, append=state.born) <= 0).any():
        raise InputError(f"id of the state must be in ascending order, from 0 to below born, {state.born}")


def _require_flow(state: State, scene: Scene) -> None:
    checks.whole_number("exchanged", state.exchanged, least=-1, most=state.steps)
    for name, rows, columns, dtype in (
        ("inflow", scene.sources, 4, np.int64),
        ("outflow", scene.sinks, 2, np.float64),
    ):
        array = getattr(state, name)
        if (array is None) == scene.exchanges_grains:
            given = "missing" if array is None else "given"
            has = "has" if array is None else "has no"
            raise InputError(f"{name} of the state is {given}: the scene {has} sources or sinks")
        if array is not None:
            _require_array(name, array, dtype, (len(rows), columns))
            if not (np.isfinite(array) & (array >= 0)).all():
                raise InputError(f"{name} of the state must be finite, and 0 or more")


def _require_arrays(record: Any, counts: dict[str, int]) -> None:
    """Raise InputError unless the float64 arrays of a record have valid shapes and values.

    `counts` holds the number of rows by the kind of row, such as "grain", see `_ARRAYS`. Arrays whose default
    is None may be None.
    """
    for own in fields(record):
        array = getattr(record, own.name)
        if own.name not in _ARRAYS or (array is None and own.default is None):
            continue
        row, shape, bound = _ARRAYS[own.name]
        _require_array(own.name, array, np.float64, (counts[row], *shape))
        holds = _BOUNDS[bound](array)
        if not holds.all():
            bad = np.logical_not(holds.reshape(len(array), -1).all(axis=1))
            where = checks.first_bad(f"{own.name} of the state, that", array, bad, row)
            raise InputError(f"{where}: it must be {bound}")


def _require_contacts(what: str, record: Any, kind: type, scene: Scene) -> None:
    """Raise InputError unless `pair` and `wall` of a record hold valid indices in ascending order.

    `what` is the name of the record in the message, and `kind` the class that it must have.
    """
    _require_kind(what, record, kind)
    for name, most in (("pair", scene.n), ("wall", len(scene.walls))):
        contact = getattr(record, name)
        rows = len(contact) if isinstance(contact, np.ndarray) and contact.ndim > 0 else 0
        _require_array(name, contact, np.int32, (rows, 2))
        i, j = contact.T.astype(np.int64)
        exists = (i < j) & (j < scene.n) if name == "pair" else (j >= 0) & (j < most)
        if not (exists & (i >= 0) & (i < scene.n)).all():
            other = "another one above it" if name == "pair" else "a wall of the scene"
            raise InputError(f"{name} of {what} must name a grain below {scene.n} and {other}")
        if not (np.diff(i * most + j) > 0).all():
            raise InputError(f"{name} of {what} must be in ascending order")


def _indices(record: Corrections | VerletList, scene: Scene) -> tuple[IndexArray, IndexArray]:
    """Return an integer for each pair, unique for (i, j), and for each wall contact, for (grain, body)."""
    (i, j), (grain, wall) = (contact.T.astype(np.int64) for contact in (record.pair, record.wall))
    return i * scene.n + j, grain + scene.n * scene.bodies.of_walls[wall]


def _require_kind(what: str, record: Any, kind: type) -> None:
    if not isinstance(record, kind):
        raise InputError(f"{what} is a {type(record).__name__}: it must be a {kind.__name__}")


def _require_array(name: str, array: Any, dtype: type, shape: tuple[int, ...]) -> None:
    if not isinstance(array, np.ndarray) or isinstance(array, np.ma.MaskedArray):
        raise InputError(f"{name} of the state is a {type(array).__name__}: it must be an array")
    if array.dtype != dtype or array.shape != shape:
        found, wanted = f"{array.dtype} {array.shape}", f"{np.dtype(dtype)} {shape}"
        raise InputError(f"{name} of the state is {found}: it must be {wanted}, as in states of this scene")
