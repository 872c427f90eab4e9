"""The part of a scene that grains can touch, which pictures show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpgrains.base.arrays import BoolArray, FloatArray
from warpgrains.space.bounds import Bounds
from warpgrains.walls.line import Line
from warpgrains.walls.rim import Rim

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.walls.wall import Wall

_CELLS = 16384  # approximate number of cells of the grid in `_touched`


def box_of_discs(position: FloatArray, reach: FloatArray) -> Bounds:
    """Return the smallest box around rectangles with these centers and half sides [m], shape (n, 2) each.

    For discs, `reach` may have shape (n, 1).
    """
    return Bounds.around(np.concatenate([position - reach, position + reach]))


def extent_of(scene: Scene) -> Bounds:
    """Return the smallest box about the grains at the start and the walls that they can touch."""
    if scene.bodies.outer is None:
        return _extent_of_box(scene)
    lines = {number: _reached(scene, wall) for number, wall in enumerate(scene.walls)}
    box = box_of_discs(scene.position, scene.radius[:, np.newaxis])
    is_plain = all(isinstance(wall, Rim) for wall in scene.walls)
    for number in lines if is_plain else _touched(scene, box, lines):
        box = box.covering(Bounds.around(np.clip(lines[number], -scene.reach, scene.reach)))
    return box


def _extent_of_box(scene: Scene) -> Bounds:
    """Return the smallest box about the space at the start and the lines, wherever these move in the run.

    In periodic directions, it is the extent of the space.
    """
    sides = [wall for wall in scene.walls if isinstance(wall, Line)]
    corners = scene.space_at(scene.time).outer_box
    reached = np.concatenate([corners, *(_reached(scene, wall) for wall in sides)])
    return Bounds.around(np.where(scene.period.repeats, np.clip(reached, *corners), reached))


def _reached(scene: Scene, wall: Wall) -> FloatArray:
    """Return points along a wall [m], shape (k, 2): at the start and, if it moves, at times of the scene."""
    times = wall.times(scene.time, scene.time + scene.duration) if wall.moves else [scene.time]
    return np.concatenate([wall.at(time).drawn(0.0).first for time in times])


def _touched(scene: Scene, box: Bounds, lines: dict[int, FloatArray]) -> list[int]:
    """Return the numbers of the walls that grains can touch.

    A flood fill on a grid, which begins at the grains, finds the cells that centers can reach. A wall near
    such a cell can be touched. `lines` holds points of each wall [m], by number, and `box` contains all
    grains.
    """
    _, outer = scene.bodies.circle_walls
    for number, line in lines.items():
        box = box if number == outer else box.covering(Bounds.around(line))
    largest, step = float(scene.radius.max()), np.sqrt(box.width * box.height / _CELLS)
    left, bottom, right, top = box.grown(largest + 2.0 * step)
    x, y = np.arange(left, right, step), np.arange(bottom, top, step)
    cells = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    mobile = {k for k, wall in scene.mobile_walls.items() if not isinstance(wall, Rim)}
    with np.errstate(invalid="ignore", divide="ignore"):  # at the centers of circles, normals are undefined
        point = np.zeros(len(cells))
        gaps = {k: scene.side(k, cells, point).gap for k in lines if k not in mobile}
    # no wall lies between neighboring cells if both are farther from it than half their distance
    is_free = np.min([*gaps.values()], axis=0) >= max(scene.smallest_radius - step, 0.71 * step)
    if (up := _direction_up(scene, bool(mobile))) is not None:
        rise = (scene.velocity**2).sum(axis=1) / (2.0 * np.hypot(*scene.gravity_at(0.0)))
        is_free &= cells @ up <= (scene.position @ up + rise).max() + step
    shape = len(y), len(x)
    column, row = np.rint((scene.position - (left, bottom)) / step).astype(int).T
    reached = _flooded(is_free.reshape(shape), row, column)
    if not reached.any():
        return list(lines)
    leaves = reached[[0, -1]].any() or reached[:, [0, -1]].any()
    near = {k: bool((gap[reached.ravel()] <= largest + 1.5 * step).any()) for k, gap in gaps.items()}
    return [k for k in lines if k in mobile or near[k] or (k == outer and leaves)]


def _direction_up(scene: Scene, is_lifted: bool) -> FloatArray | None:
    """Return the unit vector against gravity; None if grains may rise above what their initial energy allows.

    `is_lifted` is True if walls move, which can lift grains.
    """
    is_still = scene.gravity_rate == 0.0 and any(scene.gravity)
    is_lifted = is_lifted or not is_still or scene.has_driven_walls
    is_lifted = is_lifted or any(wall.surface_speed for wall in scene.walls)
    return None if is_lifted else scene.up_at(0.0)


def _flooded(is_free: BoolArray, row: FloatArray, column: FloatArray) -> BoolArray:
    """Return the free cells of a grid that a path of free cells connects with a cell (row[k], column[k])."""
    reached = np.zeros_like(is_free)
    reached[row, column] = is_free[row, column]
    while True:
        grown = reached.copy()
        grown[1:] |= reached[:-1]
        grown[:-1] |= reached[1:]
        grown[:, 1:] |= reached[:, :-1]
        grown[:, :-1] |= reached[:, 1:]
        grown &= is_free
        if (grown == reached).all():
            return reached
        reached = grown
