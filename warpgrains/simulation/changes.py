"""Changes of a scene while its simulation continues."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.errors import InputError
from warpgrains.scene import checks
from warpgrains.scene.annulus import INNER, OUTER
from warpgrains.scene.compatibility import require_clear, require_inside, require_size
from warpgrains.scene.fields import FIELDS, SceneChanges
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import Corrections, State, first_state
from warpgrains.scene.wall import Wall

OF_START = {"position", "velocity", "radius", "mass", "spin", "time"}
OF_LISTS = {"dt", "scheme", "order", "method", "wall", "drag", "spin_drag"}
"""Fields by which contacts are listed, sorted and solved; shares of corrections depend on both drags."""


class Change(NamedTuple):
    """A changed scene, and what becomes of its walls and contacts."""

    scene: Scene
    staying: list[int]
    """Walls that are where they were; contacts with the other ones are dropped."""
    keeps_list: bool
    """Whether all stay and move as before, so that the list of contacts holds."""
    driven: FloatArray | None
    """Coordinates and speeds of the walls, see `State.driven`."""
    is_local: bool
    """Whether only parameters change, but for the list."""

    def state_after(self, state: State) -> State:
        """Return the state from which the simulation continues."""
        if self.keeps_list:
            return replace(state, driven=self.driven)
        corrections = _at_walls(state.corrections, self.staying)
        return replace(state, driven=self.driven, lists=None, corrections=corrections)


def change_of(
    before: Scene, fields: SceneChanges, steps: int, position: FloatArray, driven: FloatArray | None
) -> Change:
    """Return the change of fields after some steps; InputError for fields of the start or walls on grains."""
    now = before.time_after(steps)
    scene = _changed(before, fields, steps)
    if driven is not None and scene.wall_numbers != before.wall_numbers:
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
        one if at is None else one.with_walls_at(at[:, 0]) for one, at in ((before, driven), (scene, places))
    )
    staying = [number for number in put.wall_numbers if _stays(number, was, put, now)]
    if driven is not None and places is not None:  # contacts of the last step are at walls as driven then
        jumped = np.array(put.wall_numbers)[(driven != places).any(axis=1)]
        staying = [number for number in staying if number not in jumped]
    _require_room(put, staying, position, now)
    all_stay = staying == was.wall_numbers == put.wall_numbers
    keeps_list = (
        all_stay
        and (scene.period == before.period).all()
        and all(map(_move_alike, scene.walls, before.walls))
        and scene.bodies.two_circles == before.bodies.two_circles
        and (scene.dt == before.dt or not scene.has_moving_walls)
    )
    return Change(scene, staying, keeps_list, places, all_stay and OF_LISTS.isdisjoint(fields))


def _changed(before: Scene, fields: SceneChanges, steps: int) -> Scene:
    """Return the scene with other fields, whose time continues and whose walls begin to move now."""
    for name in fields:
        checks.one_of("field of a scene", name, FIELDS)
        if name in OF_START:
            raise InputError(
                f"change: {name} is that of the start; make a scene by `present_scene.replace({name}=...)`"
            )
    now = before.time_after(steps)
    given = before.with_sides({"text": before.text_after(fields), **fields}, now)
    if "walls" in given:
        given["walls"] = [wall.starting(now) for wall in given["walls"]]
    dt = checks.positive("dt", fields.get("dt", before.dt))
    if dt != before.dt:
        given["time"] = now - steps * dt
    scene = before.unchecked(spin=np.zeros(before.n)).with_settings(**given)  # grains have other spins by now
    return scene.unchecked(spin=before.spin) if scene.has_friction else scene


def _driven(scene: Scene, before: Scene, driven: FloatArray, is_resized: bool) -> FloatArray | None:
    """Return coordinates and speeds of the walls: as before where the shape is, else those of a start."""
    places, drives = first_state(scene).driven, dict(zip(scene.numbered_walls, scene.drives, strict=True))
    for number, row, was in zip(scene.wall_numbers, [] if places is None else places, driven, strict=True):
        one, other = _wall(before, number), _wall(scene, number)
        if isinstance(one, Wall) and isinstance(other, Wall):
            continues = drives[number].inverse_mass > 0.0 and one.shape == other.shape
        else:
            continues = not (number == OUTER and is_resized)
        if continues:
            row[:] = was
    return places


def _stays(number: int, was: Scene, put: Scene, now: float) -> bool:
    """Return whether a wall is at the same place now [s] in two scenes."""
    if number not in was.wall_numbers:
        return False
    one, other = _wall(was, number), _wall(put, number)
    if isinstance(one, Wall) and isinstance(other, Wall):
        return one is other or one.at(now).shape == other.at(now).shape
    return one == other


def _wall(scene: Scene, number: int) -> float | Wall:
    """Return the radius of a circle, or a wall inside."""
    return ({OUTER: scene.radius_out, INNER: scene.radius_in} | scene.numbered_walls)[number]


def _move_alike(wall: Wall, other: Wall) -> bool:
    return wall is other or (wall.motion_numbers == other.motion_numbers and wall.shape == other.shape)


def _require_room(scene: Scene, staying: list[int], position: FloatArray, now: float) -> None:
    """Raise InputError unless all grains are outside of the walls that are new or elsewhere."""
    moved = [number for number in scene.wall_numbers if number not in staying]
    if scene.domain or any(number <= INNER for number in moved):
        require_size(scene)
        require_inside(scene, position)
    require_clear(scene, moved, position, now)


def _at_walls(corrections: Corrections, numbers: list[int]) -> Corrections:
    """Return the corrections without those of contacts with other walls."""
    kept = np.isin(corrections.wall[:, 1], numbers)
    own = {name: array for name, array in vars(corrections).items() if name[:4] == "wall"}
    return replace(corrections, **{name: array[kept] for name, array in own.items() if array is not None})
