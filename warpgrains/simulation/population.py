"""Grains that are added to a simulation, or removed from it, between two steps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.base.errors import InputError
from warpgrains.packings.separate import separate
from warpgrains.scene.compatibility import allowed_overlap, require_clear, require_size
from warpgrains.scene.fields import OF_GRAINS, SceneFields, checked_grains
from warpgrains.scene.scene import Scene
from warpgrains.scene.scheme import at_positions, before_positions
from warpgrains.scene.state import Corrections, State
from warpgrains.simulation.changes import at_walls
from warpgrains.simulation.pour import poured
from warpgrains.space.geometry import overlapping_pairs

if TYPE_CHECKING:
    from collections.abc import Mapping

NOBODY = {name: np.zeros((0, 2) if name in ("position", "velocity") else 0) for name in OF_GRAINS}


class Population:
    """The grains of a simulation between two steps. Its methods return populations with fewer or more grains.

    Attributes
    ----------
    scene : Scene
        The scene. After grains were added or removed, it starts with the present positions of all grains.
    state : State
        The state from which the simulation continues. Contacts of grains that are removed are dropped.
    """

    def __init__(self, scene: Scene, state: State) -> None:
        self.scene, self.state = scene, state

    @property
    def id(self) -> IndexArray:
        """Numbers of birth, ascending, shape (n,)."""
        return np.arange(self.scene.n) if self.state.id is None else self.state.id

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self.scene.time_after(self.state.steps)

    @property
    def born(self) -> int:
        """Number of births so far."""
        return self.scene.n if self.state.id is None else self.state.born

    def without(self, which: ArrayLike) -> Self:
        """Return the population without grains of these numbers of birth; InputError for unknown ones."""
        numbers = np.atleast_1d(np.asarray(which))
        if numbers.ndim > 1 or (numbers.size and numbers.dtype.kind not in "iu"):
            raise InputError(f"which is {checks.shown(which)}: it must be numbers of `Simulation.id`")
        gone, count = np.unique(numbers.astype(np.int64), return_counts=True)
        if (count > 1).any():
            raise InputError(f"which has grain {gone[count > 1][0]} twice")
        if (unknown := gone[~np.isin(gone, self.id)]).size:
            is_gone = 0 <= unknown[0] < self.born
            told = "it was removed" if is_gone else "it does not exist"
            raise InputError(f"which has grain {unknown[0]}: {told}; Simulation.id lists the grains")
        if len(gone) == 0:
            return self
        if len(gone) == self.scene.n:
            raise InputError("which has all grains: a simulation must keep at least one")
        return self._of(np.flatnonzero(~np.isin(self.id, gone)), NOBODY)

    def with_more(self, is_separated: bool, **grains: Any) -> Self:
        """Return the population with new grains appended: `grains` are fields of a scene, such as `position`.

        If the new grains overlap grains or walls, all grains are moved apart if `is_separated`; else
        InputError. InputError also if a new grain is beyond a wall.
        """
        more = checked_grains(SceneFields(**grains))
        if more["spin"].any() and not self.scene.has_friction:
            grain = checks.first_bad("spin", more["spin"], more["spin"] != 0.0)
            raise InputError(f"{grain}: grains rotate only with friction; give friction")
        found = self._of(np.arange(self.scene.n), more)
        if overlap := found._overlap(self.scene.n):
            if not is_separated:
                raise InputError(overlap)
            return found._separated()
        return found

    def with_poured(
        self, count: int, radius: Any, density: float, region: Any, velocity: Any, seed: int
    ) -> Self:
        """Return the population with up to `count` grains added at random places, see `Simulation.pour`."""
        grains = poured(self.now, count, radius, density, region, (seed, self.born))
        if (found := len(grains["radius"])) == 0:
            return self
        return self.with_more(is_separated=False, velocity=np.tile(velocity, (found, 1)), **grains)

    def _of(self, kept: IndexArray, more: Mapping[str, FloatArray]) -> Self:
        """Return the population of some present grains, followed by new grains.

        `kept` are the ascending indices of the present ones, and `more` has arrays of the new ones by field.
        """
        before, state, added = self.scene, self.state, len(more["position"])

        def grown(array: FloatArray | None, new: FloatArray) -> FloatArray | None:
            return None if array is None else np.concatenate([array[kept], new])

        now = self.time
        velocity, spin = state.velocity, np.zeros(before.n) if state.spin is None else state.spin
        if state.staggered:
            velocity, spin = at_positions(before, velocity, spin, now)
        own = {"position": state.position, "velocity": velocity, "spin": spin}
        own |= {"radius": before.radius, "mass": before.mass}
        grains = {name: np.concatenate([own[name][kept], more[name]]) for name in OF_GRAINS}
        scene = _with_grains(before, grains)
        velocity, spin = grains["velocity"], grains["spin"]
        if state.staggered:
            velocity, spin = before_positions(scene, velocity, spin, now)
        new = slice(len(kept), None)
        base = [wall.image.of if wall.image else number for number, wall in enumerate(scene.walls)]
        walls = {wall.image or number: number for number, wall in enumerate(scene.walls)}
        stay = {k: walls[key] for k, wall in enumerate(before.walls) if (key := wall.image or k) in walls}
        own_state = replace(
            state,
            position=grains["position"],
            velocity=np.concatenate([state.velocity[kept], velocity[new]]),
            spin=grown(state.spin, spin[new]),
            angle=grown(state.angle, np.zeros(added)),
            driven=None if state.driven is None else state.driven[base],
            corrections=at_walls(_of_grains(state.corrections, kept, before.n), stay),
            lists=None,
            id=np.concatenate([self.id[kept], self.born + np.arange(added)]),
            born=self.born + added,
            last_scene=None if state.last_scene is None else _with_grains(state.last_scene, grains),
        )
        return type(self)(scene, own_state)

    @property
    def now(self) -> Scene:
        """The scene that starts at the present time, with grains and walls at their present places."""
        walls = None if self.state.driven is None else self.state.driven[:, 0]
        return self.scene.placed(walls, self.time, position=self.state.position)

    def _overlap(self, first: int) -> str | None:
        """Return a message if a grain from index `first` on overlaps too deeply, else None.

        The message is about the deepest overlap of more than `allowed_overlap`. InputError if one of these
        grains is beyond a wall.
        """
        scene = self.now
        grains = {name: getattr(scene, name)[first:] for name in ("position", "radius")}
        place, radius = grains["position"], grains["radius"]
        require_size(scene)
        require_clear(scene, range(len(scene.walls)), place, radius, scene.time, of="added grain")
        deepest, grain, other = allowed_overlap(scene), -1, ""
        for i, j in overlapping_pairs(scene.position, scene.radius, scene.period):
            pair = np.stack([i, j], axis=1)[j >= first]
            with np.errstate(invalid="ignore"):  # if two centers coincide, only the normal is NaN
                depth = -scene.pair_frames(scene.position, pair)[1]
            if depth.max(initial=0.0) > deepest:
                k = int(depth.argmax())
                deepest, grain, at = depth[k], pair[k, 1] - first, int(pair[k, 0])
                other = f"grain {self.id[at]}" if at < first else f"added grain {at - first}"
        for number, name in enumerate(scene.wall_names):
            depth = -scene.side(number, place, radius, time=scene.time).gap
            if depth.max() > deepest:
                deepest, grain, other = depth.max(), int(depth.argmax()), name
        if grain < 0:
            return None
        x, y = place[grain].tolist()
        return (
            f"position of added grain {grain} is ({x}, {y}): it overlaps {other} by {deepest:.1e} m;"
            " separate=True moves grains apart"
        )

    def _separated(self) -> Self:
        """Return the population with grains moved apart until none overlap."""
        place = separate(self.now).scene.position
        state = replace(self.state, position=place)
        if state.last_scene is not None:
            state = replace(state, last_scene=state.last_scene.placed(None, position=place))
        return type(self)(self.scene.placed(None, position=place), state)


def _with_grains(scene: Scene, grains: dict[str, FloatArray]) -> Scene:
    """Return the scene with `grains`, arrays by field; InputError if walls or settings contradict them."""
    spin = grains["spin"] if scene.has_friction else np.zeros(len(grains["spin"]))
    return scene.changed(grains | {"spin": spin, "text": scene.text_after(OF_GRAINS)}, scene.time)


def _of_grains(corrections: Corrections, kept: IndexArray, n: int) -> Corrections:
    """Return the corrections after all of n grains are removed but those with the ascending indices `kept`.

    Grains have their new indices. The contacts of removed grains are dropped.
    """
    new = np.full(n, -1, np.int32)
    new[kept] = np.arange(len(kept))
    pair = new[corrections.pair]
    wall = np.stack([new[corrections.wall[:, 0]], corrections.wall[:, 1]], axis=1)
    stays = {"pair": (pair >= 0).all(axis=1), "wall": wall[:, 0] >= 0}
    own = vars(corrections) | {"pair": pair, "wall": wall}
    kept_of: dict[str, Any] = {
        name: None if own[name] is None else own[name][stays[name[:4]]] for name in own
    }
    return Corrections(**kept_of)
