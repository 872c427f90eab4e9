"""One scene in memory: writing a state to it, and reading its state from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.kernels.record import Phase
from warpgrains.scene.state import VERLET_NUMBERS, Corrections, State, VerletList
from warpgrains.scene.walls import OUTER
from warpgrains.solver import tuning
from warpgrains.solver.statistics import StepHistory

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.records import SceneRecords

VERLET = ("skin", "recent_deviation", "reference_position", "reference_velocity")


class SceneMemory:
    """The memory of one scene among some records.

    Parameters
    ----------
    records : SceneRecords
    k : int
        Index of the scene in `records`.
    scene : Scene

    Attributes
    ----------
    record : np.void
        View of the record.
    """

    def __init__(self, records: SceneRecords, k: int, scene: Scene):
        self._records, self._k, self._scene, self._bodies = records, k, scene, scene.bodies
        self.record = records.host[k]  # a view

    def array(self, name: str) -> np.ndarray[Any, Any]:
        """Return an array of the record, such as "grains.position"; it is valid until the list grows."""
        return self._records.array(self._k, name)

    def grains(self, name: str) -> np.ndarray[Any, Any]:
        """Return a view of the entries of grains in an array such as "position"."""
        return self.array(f"grains.{name}")[: self._scene.n]

    def coordinates(self, name: str) -> FloatArray:
        """Return the coordinates of walls [m], or their speeds [m/s], from an array such as "position".

        The shape is (walls,); it is (0,) if none is driven.
        """
        return self.array(f"grains.{name}")[self._scene.n :, 0].copy()

    def driven(self) -> FloatArray:
        """Return coordinates [m] and speeds [m/s] of walls, shape (walls, 2)."""
        return np.stack([self.coordinates(name) for name in ("position", "velocity")], axis=1)

    @property
    def contacts(self) -> int:
        """Number of listed contacts."""
        count = self.record["contacts"]["count"]
        return int(count["pairs"] + count["walls"])

    @property
    def steps(self) -> int:
        """Steps since the start."""
        return int(self.record["steps"])

    @property
    def has_stepped(self) -> bool:
        """True if a step has been taken since a state was loaded."""
        return self.steps != self._loaded_steps

    def _listed(self) -> tuple[IntArray, IntArray]:
        """Return grain and other body of the listed contacts in lexicographic order, and their indices."""
        first = np.repeat(np.arange(self._scene.n, dtype=np.int32), np.diff(self.array("neighbors.start")))
        body = np.stack([first, self.array("neighbors.neighbor")[: len(first)]], axis=1)
        return body, self.array("workspace.sweep_index")[: len(first)]

    def listed_pairs(self) -> tuple[IntArray, IntArray]:
        """Return the listed pairs in lexicographic order, shape (m, 2), and their indices, shape (m,)."""
        body, index = self._listed()
        is_pair = body[:, 1] < self._scene.n
        return body[is_pair], index[is_pair]

    def listed_walls(self) -> tuple[IntArray, IntArray]:
        """Return grains and the device's walls of the listed contacts, shape (m, 2), and their indices."""
        body, index = self._listed()
        is_wall = body[:, 1] >= self._scene.n
        return body[is_wall] - np.array([0, self._scene.n], np.int32), index[is_wall]

    def _listed_sides(self) -> IntArray:
        """Return (grain, wall) of listed wall contacts, shape (m, 2).

        The annulus counts as its outer circle.
        """
        wall = self.listed_walls()[0]
        wall[:, 1], _ = self._bodies.carried(wall[:, 1], np.zeros(len(wall)))
        return wall

    def corrections(self) -> Corrections:
        """Return the corrections that contacts carry now.

        They are those of the last good step or, before `give_up_step`, of the one that failed.
        """
        (pair, at_pair), (wall, at_wall) = self.listed_pairs(), self.listed_walls()
        dv, dv_wall = (self.array("contacts.dv")[index] for index in (at_pair, at_wall))
        active, at_side = dv != 0.0, dv_wall != 0.0
        wall[:, 1], carried_at_wall = self._bodies.carried(wall[:, 1], dv_wall)
        carried = pair[active], dv[active], wall[at_side], carried_at_wall[at_side]
        if not self._scene.has_friction:
            return Corrections(*carried)
        dvt = self.array("contacts.dvt")
        return Corrections(*carried, dvt[at_pair[active]], dvt[at_wall[at_side]])

    def state(self) -> State:
        """Return the exact state."""
        numbers = self.record["verlet"]["numbers"]
        own: dict[str, Any] = {name: self.array(f"verlet.{name}").copy() for name in VERLET}
        own |= {name: float(numbers[name]) for name in VERLET_NUMBERS}
        lists = VerletList(
            self.listed_pairs()[0], self._listed_sides(), frame_shift=numbers["frame_shift"].copy(), **own
        )
        position, velocity = self.grains("position").copy(), self.grains("velocity").copy()
        more: dict[str, Any] = {}
        if self._scene.has_friction:
            more = {name: self.array(f"grains.{name}").copy() for name in ("spin", "angle")}
        if self._scene.has_driven_walls:
            more["driven"] = self.driven()
        for name in ("staggered", "last_staggered"):
            more[name] = bool(self.record["scheme"][name])
        if not self.has_stepped:
            more["last_scene"] = self._last_scene
        return State(self.steps, position, velocity, self.corrections(), lists, **more)

    def load(self, state: State) -> None:
        """Load a state, from which the scene continues."""
        lists, corrections = state.lists, state.corrections
        if lists is None:
            self._list(corrections.pair, corrections.wall, corrections)
            self._forget_list()
        else:
            self._list(lists.pair, lists.wall, corrections)
            for name in VERLET:
                self.array(f"verlet.{name}")[:] = getattr(lists, name)
            for name in ("frame_shift", *VERLET_NUMBERS):
                self.record["verlet"]["numbers"][name] = getattr(lists, name)
        if self._scene.has_friction:
            for name in ("spin", "angle"):
                own = getattr(state, name)
                self.array(f"grains.{name}")[:] = 0.0 if own is None else own
        self.grains("velocity")[:] = state.velocity
        for name in ("position", "last_position"):
            self.grains(name)[:] = state.position
        if state.driven is not None:
            self._load_driven(state.driven)
        record = self.record
        record["control"] = 0
        record["control"]["unordered"] = 1
        for name in ("staggered", "last_staggered"):
            record["scheme"][name] = getattr(state, name)
        record["steps"] = state.steps
        self._loaded_steps, self._last_scene = state.steps, state.last_scene

    def change(self, scene: Scene, keeps_list: bool) -> None:
        """Continue with another scene, whose parameters have been written."""
        if self.has_stepped or self._last_scene is None:
            self._last_scene = self._scene
        self._scene, self._bodies, self._loaded_steps = scene, scene.bodies, self.steps
        if scene.has_driven_walls:
            self.record["walls"]["annulus"]["radius_out"] = self.coordinates("position")[OUTER]
        if not keeps_list:
            self._forget_list()

    def _load_driven(self, driven: FloatArray) -> None:
        """Write coordinates [m] and speeds [m/s] of the walls, shape (walls, 2)."""
        n = self._scene.n
        arrays = {name: self.array(f"grains.{name}") for name in ("position", "last_position", "velocity")}
        for name, array in arrays.items():
            array[n:] = 0.0
            array[n:, 0] = driven[:, int(name == "velocity")]
        self.record["walls"]["annulus"]["radius_out"] = driven[OUTER, 0]

    def _forget_list(self) -> None:
        """Invalidate the list, so that the next step requests a new one."""
        self.array("verlet.skin")[:] = tuning.NO_SKIN
        self.array("verlet.recent_deviation")[:] = 0.0
        self.record["verlet"]["numbers"] = 0.0
        self.record["verlet"]["numbers"]["base_skin"] = tuning.first_skin(self._scene)

    def _list(self, pair: IntArray, wall: IntArray, corrections: Corrections) -> None:
        """Write the list: pairs in lexicographic order and wall contacts, with their corrections."""
        count = len(pair) + len(wall)
        self._records.reserve_contacts(self._k, count)
        self.record["contacts"]["count"] = len(pair), 0, len(wall), 0  # the step puts them into sets
        if count == 0:
            for rows in ("neighbors", "workspace.old"):
                self.array(f"{rows}.start")[:] = 0
            return
        n, key = self._scene.n, np.array([self._scene.n + self._scene.wall_count, 1])
        carrying, body = (self._in_bodies(*of) for of in ((corrections.pair, corrections.wall), (pair, wall)))
        sign = self._bodies.sign(corrections.wall[:, 1])
        dv, order = np.zeros(count), np.lexsort(body.T[::-1])
        place = order[np.searchsorted((body @ key)[order], carrying @ key)]
        dv[place] = np.concatenate([corrections.pair_correction, sign * corrections.wall_correction])
        for name in ("dv", "dv_start"):
            self.array(f"contacts.{name}")[:count] = dv
        if self._scene.has_friction:
            dvt = np.zeros(count)
            if corrections.pair_friction is not None and corrections.wall_friction is not None:
                dvt[place] = np.concatenate([corrections.pair_friction, corrections.wall_friction])
            for name in ("dvt", "dvt_start"):
                self.array(f"contacts.{name}")[:count] = dvt
            self.array("workspace.old_dvt")[:count] = dvt[order, np.newaxis]
        contact = self.array("contacts.contact")[:count]
        contact["i"], contact["j"] = 2 * body.T
        for rows in ("neighbors", "workspace.old"):
            self.array(f"{rows}.start")[:] = np.searchsorted(body[order, 0], np.arange(n + 1))
            self.array(f"{rows}.neighbor")[:count] = body[order, 1]
        self.array("workspace.sweep_index")[:count] = order
        self.array("workspace.old_place")[:count] = np.arange(count)
        self.array("workspace.old_dv")[:count] = dv[order, np.newaxis]

    def _in_bodies(self, pair: IntArray, wall: IntArray) -> IntArray:
        """Return contacts as pairs of bodies of the device, shape (m, 2). Walls are bodies >= n."""
        body = self._scene.n + self._bodies.of(wall[:, 1])
        return np.concatenate([pair, np.stack([wall[:, 0], body], axis=1)])

    def give_up_step(self) -> None:
        """Undo an unfinished step; if it was about to rebuild the list, the next step does so.

        A search that was repeated may have written rows already: those of the list before return.
        """
        for name in ("dv", "dvt"):
            start = self.array(f"contacts.{name}_start")[: self.contacts]
            self.array(f"contacts.{name}")[: self.contacts] = start
        control = self.record["control"]
        if control["phase"] == Phase.FULL:
            for rows, count in (("start", self._scene.n + 1), ("neighbor", self.contacts)):
                self.array(f"neighbors.{rows}")[:count] = self.array(f"workspace.old.{rows}")[:count]
            self.record["control"] = 0
            self.array("verlet.skin")[:] = tuning.NO_SKIN
        control["phase"] = Phase.ENDED

    def history(self) -> StepHistory:
        """Return zeta and residual of the iterations of the last step, which were kept."""
        iterations = self.record["step"]["iterations"]
        zeta, residual = (self.array(f"history.{name}")[:iterations].copy() for name in StepHistory._fields)
        return StepHistory(zeta, residual)
