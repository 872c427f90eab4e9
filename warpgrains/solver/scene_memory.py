"""One scene in memory: a state written to it, and what it has come to read from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.kernels.record import RunStatistics as Sums
from warpgrains.kernels.record import StepState
from warpgrains.scene.state import Corrections, State, VerletList
from warpgrains.solver import tuning
from warpgrains.solver.statistics import RunStatistics, StepHistory, StepReport

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.records import SceneRecords

STEP = tuple(StepState.vars)  # names of its fields
SUMS = tuple(Sums.vars)
VERLET = ("skin", "recent_deviation", "reference_position", "reference_velocity")


class SceneMemory:
    """One scene of some records.

    Parameters
    ----------
    records : SceneRecords
    k : int
        Its place among them.
    scene : Scene

    Attributes
    ----------
    record : np.void
        The record itself, a view.
    """

    def __init__(self, records: SceneRecords, k: int, scene: Scene):
        self._records, self._k, self._scene = records, k, scene
        self.record = records.host[k]  # a view

    def array(self, name: str) -> np.ndarray[Any, Any]:
        """Return an array of the record, such as "grains.position"; valid until the list grows."""
        return self._records.array(self._k, name)

    @property
    def pairs(self) -> int:
        """How many pairs are listed."""
        return self.record["contacts"]["count"]["pairs"].item()

    @property
    def walls(self) -> int:
        """How many grains are listed at the walls."""
        return self.record["contacts"]["count"]["walls"].item()

    def listed_pairs(self) -> IntArray:
        """Return the listed pairs in lexicographic order, shape (m, 2)."""
        first = np.repeat(np.arange(self._scene.n, dtype=np.int32), np.diff(self.array("neighbors.start")))
        return np.stack([first, self.array("neighbors.neighbor")[: len(first)]], axis=1)

    def corrections(self) -> Corrections:
        """Return what the contacts carry after the last good step."""
        dv = self.array("contacts.pair_dv")[self.array("workspace.sweep_index")[: self.pairs]]
        active = dv != 0.0
        return Corrections(self.listed_pairs()[active], dv[active], self.wall_correction())

    def wall_correction(self) -> FloatArray:
        """Return what the grains carry at the walls [m/s], shape (n,)."""
        return self._records.wall_corrections(np.array([self._k]))[0]

    def state(self, steps: int) -> State:
        """Return the exact state, after so many steps."""
        numbers = self._records.verlet_numbers(self._k).copy()
        lists = VerletList(
            pair=self.listed_pairs(),
            wall=np.sort(self.array("contacts.walls")["i"][: self.walls]),
            **{name: self.array(f"verlet.{name}").copy() for name in VERLET},
            frame=numbers[:6].reshape(3, 2),
            scalar=numbers[6:],
        )
        position, velocity = self.array("grains.position").copy(), self.array("grains.velocity").copy()
        return State(steps, position, velocity, self.corrections(), lists, self.moment("staggered"))

    def moment(self, name: str) -> bool:
        """Return a flag of the record's scheme, such as "last_staggered"."""
        return bool(self.record["scheme"][name])

    def load(self, state: State) -> None:
        """Continue from a state."""
        lists, corrections = state.lists, state.corrections
        if lists is None:
            wall = np.flatnonzero(corrections.wall_correction).astype(np.int32)
            self._list(corrections.pair, wall, corrections)
            self._forget_list()
        else:
            self._list(lists.pair, lists.wall, corrections)
            for name in VERLET:
                self.array(f"verlet.{name}")[:] = getattr(lists, name)
            self._records.verlet_numbers(self._k)[:] = np.concatenate([lists.frame.ravel(), lists.scalar])
        for name in ("radius", "mass", "contact_mass"):
            self.array(f"grains.{name}")[:] = getattr(self._scene, name)
        self.array("grains.velocity")[:] = state.velocity
        for name in ("position", "last_position"):
            self.array(f"grains.{name}")[:] = state.position
        record = self.record
        record["control"] = 0
        record["control"]["unordered"] = lists is not None
        record["scheme"]["staggered"] = state.staggered

    def _forget_list(self) -> None:
        """Let the next step ask for a list: no skin suffices."""
        self.array("verlet.skin")[:] = tuning.NO_SKIN
        self.array("verlet.recent_deviation")[:] = 0.0
        self._records.verlet_numbers(self._k)[:] = 0.0
        self.record["verlet"]["numbers"]["base_skin"] = tuning.first_skin(self._scene)

    def _list(self, pair: IntArray, wall: IntArray, corrections: Corrections) -> None:
        """List pairs, in lexicographic order, and walls, as of before they were put in sweeping order."""
        for rows in ("neighbors", "workspace.old"):
            self.array(f"{rows}.start")[:] = 0
        if len(pair) > 0:
            self._list_pairs(pair, corrections)
        walls = self.array("contacts.walls")[: len(wall)]
        walls["i"], walls["dv"] = wall, corrections.wall_correction[wall]
        self.array("contacts.wall_dv_start")[: len(wall)] = walls["dv"]
        self.array("dealt.first_segment")[:] = 0
        self.record["contacts"]["count"] = len(pair), 0, len(wall)

    def _list_pairs(self, pair: IntArray, corrections: Corrections) -> None:
        self._records.make_room(self._k, len(pair))
        dv, key = np.zeros(len(pair)), np.array([self._scene.n, 1])
        dv[np.searchsorted(pair @ key, corrections.pair @ key)] = corrections.pair_correction
        for rows in ("neighbors", "workspace.old"):
            self.array(f"{rows}.start")[:] = np.searchsorted(pair[:, 0], np.arange(self._scene.n + 1))
            self.array(f"{rows}.neighbor")[: len(pair)] = pair[:, 1]
        for name in ("contacts.pair_dv", "contacts.pair_dv_start"):
            self.array(name)[: len(pair)] = dv
        self.array("workspace.old_pair_dv")[: len(pair)] = dv[:, None]
        for name in ("sweep_index", "old_index", "old_place"):
            self.array(f"workspace.{name}")[: len(pair)] = np.arange(len(pair))

    def give_up_step(self) -> None:
        """Take back what an unfinished step did; the next one makes a list anew if this one was about to."""
        self.record["control"]["corrected"] = 0
        self.array("contacts.pair_dv")[: self.pairs] = self.array("contacts.pair_dv_start")[: self.pairs]
        walls = self.array("contacts.walls")[: self.walls]
        walls["dv"] = self.array("contacts.wall_dv_start")[: self.walls]
        if self.record["control"]["unlisted"] or self.record["control"]["recoloring"]:
            self.record["control"] = 0
            self.array("verlet.skin")[:] = tuning.NO_SKIN

    def report(self, infeasible: tuple[int, ...]) -> StepReport:
        """Return what the last step did; `infeasible` are the grains that are proved not to fit."""
        step = dict(zip(STEP, self.record["step"].tolist(), strict=True))
        return StepReport(
            iterations=step["iterations"],
            zeta=step["zeta"],
            residual=step["residual"],
            gap_error=self._gap_error(step["residual"]),
            converged=bool(step["converged"]),
            infeasible=infeasible,
            contacts=step["active"],
            candidates=self.pairs + self.walls,
            overlap=step["overlap"],
            rebuilds=step["rebuilds"],
            redos=step["redos"],
            factorizations=step["factorizations"],
            history=self._history(step["iterations"]),
        )

    def _history(self, iterations: int) -> StepHistory | None:
        """Return what the iterations of the last step came to, where that was kept."""
        zeta, residual = (self.array(f"history.{name}") for name in StepHistory._fields)
        return StepHistory(zeta[:iterations].copy(), residual[:iterations].copy()) if len(zeta) else None

    def statistics(self) -> RunStatistics:
        """Return what the device has added up."""
        sums = dict(zip(SUMS, self.record["statistics"].item(), strict=True))
        return RunStatistics(**sums, gap_error=self._gap_error(sums["residual"]))

    def _gap_error(self, residual: float) -> float:
        """Return dt * residual in smallest radii."""
        return self._scene.dt * residual / self._scene.smallest_radius
