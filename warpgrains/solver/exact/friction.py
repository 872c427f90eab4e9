"""The host's part of the method "exact" with friction: it chooses contacts, and accepts or rejects answers.

path.py finds an answer for given contacts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpgrains.base.arrays import Indices
from warpgrains.kernels.record import HostRequest, Phase
from warpgrains.kernels.types import PoseOf
from warpgrains.solver.exact.listed import ListedContacts
from warpgrains.solver.exact.path import Answer, Contacts, FrictionStep

if TYPE_CHECKING:
    from warpgrains.solver.records import SceneRecords

ASKED = 0.9  # requested residual, in tolerances; leaves a margin for rounding in the kernels
NEAR = 0.1  # clearance up to which contacts are included at first, in mean corrections of active contacts
EXACT_BUDGET = 500.0  # default of `Scene.exact_budget`


class PathSolver:
    """Host solver for the steps with friction of scene k of `records`; path.py finds the answers.

    Before `max_iterations`, an answer replaces the corrections of the sweeps only if it meets the tolerance;
    after it, also if its residual is smaller than that of the sweeps.
    """

    def __init__(self, records: SceneRecords, k: int):
        self._records, self._k = records, k
        self._best: Answer | None = None
        self._bodies: Indices = np.empty((2, 0), int)  # of the contacts of the best answer; -1 - w at wall w
        self._work = 0  # in the present step

    @property
    def _tangential(self) -> list[str]:
        """Names of the corrections other than dv: "dvt", and "dvr" with rolling friction."""
        return ["dvt"] + ["dvr"] * self._records.scenes[self._k].has_rolling_friction

    def solve(self) -> None:
        """Replace the corrections of the step if better ones are found, and let the kernels continue.

        If the contacts are those of an earlier call in this step, its answer is used again.
        """
        scene, record = self._records.scenes[self._k], self._records.host[self._k]
        listed, state = ListedContacts(self._records, self._k), record["step"]
        contacts, tolerance = Contacts.of(listed.constraints), ASKED * scene.tolerance
        if state["host_request"] == HostRequest.EARLY:
            self._best, self._work = None, 0
        bodies = np.stack(
            [contacts.first, np.append(listed.constraints.second, -1 - listed.constraints.wall[:, 1])]
        )
        best, is_known = self._best, np.array_equal(bodies, self._bodies)
        if best is None or not is_known:
            entries = self._with_rolling(contacts, listed.constraints.wall)
            best = self._best = self._answer(listed, entries, tolerance)
            self._bodies = bodies
            self._work += best.work
            state["factorizations"] += best.factorizations
        is_last, is_solved = state["iterations"] >= scene.max_iterations, best.residual <= tolerance
        is_better = is_solved or (is_last and best.factorizations > 0 and best.residual < state["residual"])
        if is_better:
            listed.write("dv", best.dv)
            for name, values in zip(self._tangential, best.dvt.reshape(-1, len(best.dv)), strict=True):
                listed.write(name, values)
        state["host_request"] = HostRequest.NEVER if is_last or is_solved else HostRequest.AT_LAST
        record["control"]["phase"], record["control"]["resuming"] = Phase.ANSWERED, not is_better

    def _with_rolling(self, contacts: Contacts, wall: Indices) -> Contacts:
        """Return the contacts; with rolling friction, they are followed by an entry for the rolling of each.

        `wall` holds grain and wall of the contacts with walls, which follow the k pairs, shape (m - k, 2).
        """
        scene = self._records.scenes[self._k]
        if not scene.has_rolling_friction:
            return contacts
        rolling, pose = (self._records.array(self._k, f"walls.{name}") for name in ("rolling", "pose"))
        spin = rolling[:, 1].copy()
        if len(pose) > 0:
            spin[1:] += pose[:, PoseOf.ANGULAR_VELOCITY]
        body = scene.bodies.of_walls[wall[:, 1]]
        pairs = len(contacts.first) - len(wall)
        mu = np.append(np.full(pairs, scene.rolling_friction), rolling[body, 0])
        surface = np.append(np.zeros(pairs), scene.radius[wall[:, 0]] * spin[body])
        return contacts.with_rolling(mu, surface, scene.radius)

    def _answer(self, listed: ListedContacts, contacts: Contacts, tolerance: float) -> Answer:
        """Return the answer found from the sweeps' corrections; `contacts` are `listed` and those of rolling.

        At first only active contacts and those that nearly close (`NEAR`) are included, then also those that
        an answer closes. The residual is inf if the tolerance is missed and grains move so fast that they
        cannot fit.
        """
        scene, constraints = self._records.scenes[self._k], listed.constraints
        mass, walls = constraints.mass, len(constraints.body) - scene.n
        inertia = np.column_stack([mass, mass, np.append(0.5 * scene.rim_mass, np.ones(walls))])
        inertia[scene.n :, 1] = 1.0
        free, rim, velocity = (
            self._records.array(self._k, f"grains.{name}")
            for name in ("free_velocity", "free_rim", "next_velocity")
        )
        free = np.column_stack([free[constraints.body], np.append(rim, np.zeros(walls))])
        velocity = velocity[constraints.body]
        dv = np.maximum(0.0, listed.read("dv"))
        dvt = np.concatenate([np.where(dv > 0.0, listed.read(name), 0.0) for name in self._tangential])
        near, reach = dv > 0.0, NEAR * dv.sum() / max(1, np.count_nonzero(dv))
        closing = constraints.normal_speed(velocity) - constraints.gap_rate
        exact_budget = EXACT_BUDGET if scene.exact_budget is None else scene.exact_budget
        left = exact_budget * scene.max_iterations * len(dv) - self._work
        work, factorizations = 0, 0
        while True:
            near = near | (closing > -reach)
            every = np.tile(near, len(self._tangential))
            step = FrictionStep(contacts.only(every), inertia, free, walls)
            answer = step.solve(np.append(dv, dv)[: len(every)][every], dvt[every], tolerance, left - work)
            dv[near], dvt[every] = answer.dv[: np.count_nonzero(near)], answer.dvt
            work, factorizations = work + answer.work, factorizations + answer.factorizations
            velocity = step.velocity(answer)
            sliding = constraints.sliding(scene.dt * velocity)
            closing = sliding.normal_speed(velocity) - sliding.gap_rate
            residual = max(answer.residual, closing[~near].max(initial=0.0))
            if residual <= tolerance or answer.residual > tolerance:
                if residual > tolerance and np.abs(velocity).max(initial=0.0) > 2.0 * scene.reach / scene.dt:
                    residual = np.inf  # no answer: grains cannot fit, and some leave the domain
                return Answer(dv, dvt, residual, factorizations, work)
