"""Functions that write states to the arrays of scenes in memory, and read states from these arrays."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.base.arrays import FloatArray, IndexArray, IntArray
from warpgrains.kernels.record import Phase
from warpgrains.scene.state import OF_POPULATION, VERLET_NUMBERS, Corrections, State, VerletList
from warpgrains.solver import tuning
from warpgrains.solver.exact.listed import listed, listed_pairs, listed_walls
from warpgrains.walls.bodies import NONE

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.records import SceneRecords

VERLET = ("skin", "recent_deviation", "reference_position", "reference_velocity")


def corrections_of(records: SceneRecords, k: int) -> Corrections:
    """Return the present corrections of all contacts of scene k that carry one.

    They are those of the last good step or, before `give_up_step`, those of a step that failed.
    """
    (body, index), scene = listed(records, k), records.scenes[k]
    dv = records.array(k, "contacts.dv.now")[index]
    active = np.flatnonzero(dv)
    body, index, dv = body[active], index[active], dv[active]
    is_pair = body[:, 1] < scene.n
    at_wall = np.flatnonzero(~is_pair)
    wall = body[at_wall]
    wall[:, 1], carried = scene.bodies.carried(wall[:, 1] - scene.n, dv[at_wall])
    order = _in_order(wall)
    rough = [records.array(k, f"contacts.{name}.now")[index] for name in _bounded(scene)]
    both = (own[at] for own in rough for at in (is_pair, at_wall[order]))
    return Corrections(body[is_pair], dv[is_pair], wall[order], carried[order], *both)


def _in_order(contact: IntArray) -> IndexArray:
    """Return the indices that put contacts into lexicographic order."""
    return np.lexsort(contact.T[::-1])


def _bounded(scene: Scene) -> dict[str, str]:
    """Return the corrections that friction bounds, as {name in the records: name in `Corrections`}."""
    names = {"dvt": "friction"} if scene.has_friction else {}
    return names | ({"dvr": "rolling"} if scene.has_rolling_friction else {})


def state_of(records: SceneRecords, k: int, has_lists: bool = True) -> State:
    """Return the exact state of scene k.

    Without lists, steps that continue from this state may differ in the last bits.
    """
    scene, record = records.scenes[k], records.host[k]
    names = ("position", "velocity", *(("spin", "angle") if scene.has_friction else ()))
    own: dict[str, Any] = {name: records.array(k, f"grains.{name}")[: scene.n].copy() for name in names}
    if scene.has_driven_walls:
        own["driven"] = driven_walls(records, k)
    for name in ("staggered", "last_staggered"):
        own[name] = bool(record[name])
    own |= {name: copy(value) for name, value in records.populations[k].items()}
    return State(
        int(record["steps"]),
        corrections=corrections_of(records, k),
        lists=_lists_of(records, k) if has_lists else None,
        last_scene=None if records.has_stepped(k) else records.last_scenes[k],
        **own,
    )


def _lists_of(records: SceneRecords, k: int) -> VerletList:
    """Return the Verlet list of scene k: its contacts, and the numbers that bound how long it is valid."""
    wall, _ = listed_walls(records, k)
    wall[:, 1], _ = records.scenes[k].bodies.carried(
        wall[:, 1], np.zeros(len(wall))
    )  # annulus -> outer circle
    numbers = records.host[k]["verlet"]
    own: dict[str, Any] = {name: records.array(k, f"verlet.{name}").copy() for name in VERLET}
    own |= {name: float(numbers[name]) for name in VERLET_NUMBERS}
    own["frame_shift"] = numbers["frame_shift"].copy()
    return VerletList(listed_pairs(records, k)[0], wall[_in_order(wall)], **own)


def driven_walls(records: SceneRecords, k: int) -> FloatArray:
    """Return coordinate [m] and speed [m/s] of every wall of scene k, shape (walls, 2).

    A force must drive at least one wall of the scene; walls that no force drives keep the speed 0.
    """
    scene = records.scenes[k]
    arrays = (records.array(k, f"grains.{name}")[scene.n :, 0] for name in ("position", "velocity"))
    return np.stack([array[scene.bodies.of_walls] for array in arrays], axis=1)


def scene_with_walls(records: SceneRecords, k: int) -> Scene:
    """Return scene k with its driven walls at their present positions."""
    scene = records.scenes[k]
    return scene.placed(driven_walls(records, k)[:, 0]) if scene.has_driven_walls else scene


def load_state(records: SceneRecords, k: int, state: State) -> None:
    """Write a state to the arrays of scene k, which continues from this state."""
    scene, record, lists, corrections = records.scenes[k], records.host[k], state.lists, state.corrections
    if lists is None:
        _write_list(records, k, corrections.pair, corrections.wall, corrections)
        _forget_list(records, k)
    else:
        _write_list(records, k, lists.pair, lists.wall, corrections)
        for name in VERLET:
            records.array(k, f"verlet.{name}")[:] = getattr(lists, name)
        for name in ("frame_shift", *VERLET_NUMBERS):
            record["verlet"][name] = getattr(lists, name)
    if scene.has_friction:
        for name in ("spin", "angle"):
            own = getattr(state, name)
            records.array(k, f"grains.{name}")[:] = 0.0 if own is None else own
    records.array(k, "grains.velocity")[: scene.n] = state.velocity
    for name in ("position", "last_position"):
        records.array(k, f"grains.{name}")[: scene.n] = state.position
    if state.driven is not None:
        for name, column in (("position", 0), ("last_position", 0), ("velocity", 1)):
            of_bodies = records.array(k, f"grains.{name}")[scene.n :]
            of_bodies[:] = 0.0
            of_bodies[scene.bodies.of_walls, 0] = state.driven[:, column]
        _place_outer_circle(records, k)
    record["control"] = 0
    record["control"]["unordered"] = 1
    for name in ("staggered", "last_staggered"):
        record[name] = getattr(state, name)
    record["steps"] = records.loaded_steps[k] = state.steps
    records.last_scenes[k] = state.last_scene
    records.populations[k] = {name: getattr(state, name) for name in OF_POPULATION}


def change_scene(records: SceneRecords, k: int, scene: Scene, keeps_list: bool) -> None:
    """Replace scene k by a scene with other parameters; without `keeps_list`, the next step makes a new list.

    The grains, their contact masses, and the positions of walls must be the same.
    """
    if records.has_stepped(k) or records.last_scenes[k] is None:
        records.last_scenes[k] = records.scenes[k]
    records.scenes[k], records.loaded_steps[k] = scene, records.host["steps"][k]
    records.write_parameters(slice(k, k + 1))
    if scene.has_driven_walls:
        _place_outer_circle(records, k)
    if not keeps_list:
        _forget_list(records, k)


def _place_outer_circle(records: SceneRecords, k: int) -> None:
    """Write the radius of the outer circle to the record of scene k.

    The radius is the coordinate of body 0, the annulus. Without an outer wall, both become the very large
    radius of `scene.bodies.circles`.
    """
    scene, annulus = records.scenes[k], records.host[k]["walls"]["annulus"]
    coordinate = records.array(k, "grains.position")[scene.n : scene.n + 1, 0]
    if scene.bodies.walls[0] == NONE:
        coordinate[:] = scene.bodies.circles[1]
    annulus["radius_out"] = coordinate.item()


def _forget_list(records: SceneRecords, k: int) -> None:
    """Invalidate the list, so that the next step requests a new one."""
    records.array(k, "verlet.skin")[:] = tuning.NO_SKIN
    records.array(k, "verlet.recent_deviation")[:] = 0.0
    for name in ("frame_shift", *VERLET_NUMBERS):
        records.host[k]["verlet"][name] = 0.0
    records.host[k]["verlet"]["base_skin"] = tuning.first_skin(records.scenes[k])


def _write_list(
    records: SceneRecords, k: int, pair: IntArray, wall: IntArray, corrections: Corrections
) -> None:
    """Write listed contacts and their corrections to the arrays of scene k.

    `pair` holds grains i < j in lexicographic order, `wall` grain and wall of contacts with walls, shape (m,
    2).
    """
    count, scene = len(pair) + len(wall), records.scenes[k]
    of_walls = scene.bodies.of_walls
    wall = wall[_in_order(np.stack([wall[:, 0], of_walls[wall[:, 1]]], axis=1))]
    records.reserve_contacts(k, count)
    records.host[k]["contacts"]["count"] = len(pair), 0, len(wall)  # the step divides the pairs into sets
    if count == 0:
        for rows in ("start", "old_start"):
            records.array(k, f"neighbors.{rows}")[:] = 0
        return

    def in_bodies(pair: IntArray, wall: IntArray) -> IntArray:
        body = scene.n + of_walls[wall[:, 1]]
        return np.concatenate([pair, np.stack([wall[:, 0], body], axis=1)])

    key = np.array([scene.n + len(scene.bodies), 1])
    body, carrying = in_bodies(pair, wall), in_bodies(corrections.pair, corrections.wall)
    order = np.lexsort(body.T[::-1])
    place = order[np.searchsorted((body @ key)[order], carrying @ key)]
    sign = scene.bodies.sign(corrections.wall[:, 1])
    dv = np.zeros(count)
    dv[place] = np.concatenate([corrections.pair_correction, sign * corrections.wall_correction])
    values = {"dv": dv}
    for name, kept in _bounded(scene).items():
        values[name], own = np.zeros(count), [getattr(corrections, f"{of}_{kept}") for of in ("pair", "wall")]
        if all(one is not None for one in own):
            values[name][place] = np.concatenate(own)
    for name, value in values.items():
        for moment in ("now", "start"):
            records.array(k, f"contacts.{name}.{moment}")[:count] = value
        records.array(k, f"contacts.{name}.saved")[:count] = value[order, np.newaxis]
    contact = records.array(k, "contacts.contact")[:count]
    contact["i"], contact["j"] = 2 * body.T
    for age in ("", "old_"):
        records.array(k, f"neighbors.{age}start")[:] = np.searchsorted(body[order, 0], np.arange(scene.n + 1))
        records.array(k, f"neighbors.{age}neighbor")[:count] = body[order, 1]
    records.array(k, "neighbors.sweep_index")[:count] = order
    records.array(k, "neighbors.old_index")[:count] = np.arange(count)


def give_up_step(records: SceneRecords, k: int) -> None:
    """Undo an unfinished step: restore the corrections at its start.

    If the step waited for memory for a new list, its search may have overwritten rows of the old list, so
    these are restored, too, and the next step searches again.
    """
    record = records.host[k]
    count, control = record["contacts"]["count"], record["control"]
    listed = int(count["pairs"] + count["walls"])
    for name in ("dv", "dvt", "dvr"):
        now, start = (records.array(k, f"contacts.{name}.{moment}") for moment in ("now", "start"))
        now[:listed] = start[:listed]
    if control["phase"] == Phase.LIST_FULL:
        for rows, count in (("start", records.scenes[k].n + 1), ("neighbor", listed)):
            records.array(k, f"neighbors.{rows}")[:count] = records.array(k, f"neighbors.old_{rows}")[:count]
        record["control"] = 0
        records.array(k, "verlet.skin")[:] = tuning.NO_SKIN
    control["phase"] = Phase.ENDED
