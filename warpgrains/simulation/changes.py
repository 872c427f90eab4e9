"""Changes of a scene while its simulation continues."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.scene.compatibility import require_clear, require_size
from warpgrains.scene.fields import FIELDS, SceneChanges
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import Corrections, State, first_state
from warpgrains.walls.rim import Rim
from warpgrains.walls.wall import Wall

OF_START = {"position", "velocity", "radius", "mass", "spin", "time", "sources", "sinks"}
OF_LISTS = {"dt", "scheme", "order", "method", "wall", "drag", "spin_drag"}
"""Fields that determine how contacts are listed, sorted and solved. Shares of corrections need both drags."""


class Change(NamedTuple):
    """A changed scene, and what becomes of its walls and contacts."""

    scene: Scene
    staying: dict[int, int]
    """Index in the changed `Scene.walls` of each wall that stays in place, by its index before the change.

    Contacts of other walls are dropped.
    """
    keeps_list: bool
    """True if the Verlet list of contacts stays valid, because all walls keep their places and motions."""
    driven: FloatArray | None
    """Coordinates and speeds of the walls, as in `State.driven`; None if no force drives a wall."""
    is_local: bool
    """True if all walls keep their places and numbers, and no field of `OF_LISTS` changes."""

    def state_after(self, state: State) -> State:
        """Return the state from which the simulation continues, given the state before the change."""
        if self.keeps_list:
            return replace(state, driven=self.driven)
        corrections = at_walls(state.corrections, self.staying)
        return replace(state, driven=self.driven, lists=None, corrections=corrections)


def change_of(
    before: Scene, fields: SceneChanges, steps: int, position: FloatArray, driven: FloatArray | None
) -> Change:
    """Return the change of `fields` after `steps` steps, when grains are at `position` [m], shape (n, 2).

    `driven` are the coordinates and speeds of walls then, see `State.driven`. InputError if a field describes
    the start, or a new wall is where a grain is.
    """
    now = before.time_after(steps)
    scene = _changed(before, fields, steps)
    if driven is not None and scene.wall_names != before.wall_names:
        raise InputError(
            "change: no wall can be added or removed while a force drives one; make a scene by"
            " `present_scene.replace(walls=...)`"
        )
    if scene.has_driven_walls != before.has_driven_walls:
        raise InputError(
            "change: a pressure or a force can be changed, but not given to a wall or taken away; make a"
            " scene by `present_scene.replace`"
        )
    places = None if driven is None else _driven(scene, before, driven, "radius_out" in fields)
    was, put = (
        one if at is None else one.placed(at[:, 0]) for one, at in ((before, driven), (scene, places))
    )
    staying = _staying(was, put, now)
    if driven is not None and places is not None:  # its contacts were with the wall at its old place
        jumped = {*np.flatnonzero((driven != places).any(axis=1)).tolist()}
        staying = {old: new for old, new in staying.items() if new not in jumped}
    require_size(put)
    require_clear(put, {*range(len(put.walls))} - {*staying.values()}, position, put.radius, now)
    all_stay = all(old == new for old, new in staying.items())
    all_stay = all_stay and len(staying) == len(was.walls) == len(put.walls)
    keeps_list = (
        all_stay
        and scene.period == before.period
        and all(map(_move_alike, scene.walls, before.walls))
        and scene.bodies.two_circles == before.bodies.two_circles
        and (scene.dt == before.dt or not scene.has_moving_walls)
    )
    return Change(scene, staying, keeps_list, places, all_stay and OF_LISTS.isdisjoint(fields))


def _changed(before: Scene, fields: SceneChanges, steps: int) -> Scene:
    """Return the scene with `fields` changed after `steps` steps; InputError if one describes the start.

    Time continues; walls without `start_time` begin to move now.
    """
    for name in fields:
        checks.one_of("field of a scene", name, FIELDS)
        if name in OF_START:
            raise InputError(
                f"change: {name} is that of the start; make a scene by `present_scene.replace({name}=...)`"
            )
    now = before.time_after(steps)
    given: dict[str, Any] = {"text": before.text_after(fields), **fields}
    dt = checks.positive("dt", fields.get("dt", before.dt))
    if dt != before.dt:
        given["time"] = now - steps * dt
    at_rest = before.placed(None, spin=np.zeros(before.n))  # spins of the start need no check
    scene = at_rest.changed(given, now)
    return scene.placed(None, spin=before.spin) if scene.has_friction else scene


def _driven(scene: Scene, before: Scene, driven: FloatArray, is_resized: bool) -> FloatArray | None:
    """Return coordinates and speeds of the walls after a change, see `State.driven`.

    A wall keeps its row of `driven` if its shape does not change. Other walls have the values of a start.
    None if no force drives a wall. `is_resized` is True if the outer circle was given a new radius.
    """
    places = first_state(scene).driven
    if places is None:
        return None
    for row, was, wall, old, drive in zip(
        places, driven, scene.walls, before.walls, scene.drives, strict=True
    ):
        is_other = wall.shape != old.shape or (isinstance(wall, Rim) and is_resized)
        if drive.inverse_mass > 0.0 and not is_other:
            row[:] = was
    return places


def _staying(was: Scene, put: Scene, now: float) -> dict[int, int]:
    """Return the walls with equal shape and place in both scenes at time `now` [s].

    The result maps the index of a wall in `was.walls` to its index in `put.walls`.
    """
    if was.walls is put.walls:
        return {number: number for number in range(len(was.walls))}
    found: dict[int, int] = {}
    olds: dict[tuple[float, ...], list[int]] = {}
    for number, wall in enumerate(was.walls):
        olds.setdefault(wall.at(now).shape, []).append(number)
    for number, wall in enumerate(put.walls):
        alike = olds.get(wall.at(now).shape, [])
        if alike:
            found[alike.pop(0)] = number
    return found


def _move_alike(wall: Wall, other: Wall) -> bool:
    return wall is other or (wall.motion_numbers == other.motion_numbers and wall.shape == other.shape)


def at_walls(corrections: Corrections, numbers: dict[int, int]) -> Corrections:
    """Return corrections in which walls are renumbered: `numbers` maps old to new numbers.

    Contacts of walls without a new number are dropped.
    """
    new = np.full(max([-1, *corrections.wall[:, 1].tolist(), *numbers]) + 1, -1, np.int32)
    new[[*numbers]] = [*numbers.values()]
    wall = np.stack([corrections.wall[:, 0], new[corrections.wall[:, 1]]], axis=1)
    kept = np.lexsort(wall.T[::-1])
    kept = kept[wall[kept, 1] >= 0]
    own = {name: array for name, array in vars(corrections).items() if name[:5] == "wall_"}
    values = {name: array[kept] for name, array in own.items() if array is not None}
    return replace(corrections, wall=wall[kept], **values)
