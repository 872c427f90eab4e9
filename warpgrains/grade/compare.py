"""Answers held against one another: the same but for rounding, or the first thing that differs.

A correct homework may sum in another order. Each contact that acts then changes velocities, corrections and
zeta by some `_ROUNDINGS` eps times the largest speed, which may be that of a gap, R_out / dt; contacts are
inelastic, so later ones pass this on without enlarging it. So after some calls over some contacts,

    velocities, corrections, zeta   differ by at most   _ROUNDINGS eps speed contacts calls
    positions                       by dt times that, and _ROUNDINGS eps R_out

and what differs by more is something else. Calls begin where the reference is: nothing adds up over steps.

A step may take one iteration less where iterMax ends it, because the text leaves it open whether iteration 0
counts, and another number where zeta is the tolerance but for rounding. What both have done is then compared.
"""

from typing import NamedTuple

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.grade.child import Answer
from warpgrains.grade.ended import FIELDS
from warpgrains.grade.probes import Probe

_ROUNDINGS = 32
_EPS = float(np.finfo(np.float64).eps)
_UPDATE_ORDER = ("dvContacts", "dvBoundary", "vx", "vy", "x", "y", "r", "m")


class Difference(NamedTuple):
    """What differs first: `quantity`, such as "vx[3]", at a step, and the iteration and contact if known."""

    scene: str
    step: int
    iteration: int | None
    contact: str | None
    quantity: str
    expected: float
    found: float

    def __str__(self) -> str:
        place = [f"scene {self.scene}", f"step {self.step}"]
        place += [] if self.iteration is None else [f"iteration {self.iteration}"]
        place += [] if self.contact is None else [self.contact]
        expected, found = _told_apart(self.expected, self.found)
        return f"{', '.join(place)}: {self.quantity} is {found}, expected {expected}"


def difference(probe: Probe, expected: Answer, found: Answer, strict: bool = False) -> Difference | None:
    """Return the first thing in which an answer differs from that of the reference; strict: in any bit."""
    return None if expected == found else _Comparison(probe, expected, found, strict).first()


class _Comparison:
    def __init__(self, probe: Probe, expected: Answer, found: Answer, strict: bool):
        self._probe, self._expected, self._found = probe, expected, found
        call, n = probe.call, probe.call.n
        speeds = (call.state[2 * n : 4 * n], *(s[2 * n : 4 * n] for s in (expected.state, found.state)))
        changes = (expected.state[6 * n :], found.state[6 * n :])
        numbers = np.concatenate([*speeds, *changes])
        largest = float(np.abs(numbers[np.isfinite(numbers)]).max(initial=call.radius_out / call.dt))
        acting = n + np.count_nonzero(expected.state[6 * n :])
        rounding = 0.0 if strict else _ROUNDINGS * _EPS
        self._speed = rounding * largest * acting * max(1, expected.calls)
        self._length = call.dt * self._speed + rounding * call.radius_out

    def first(self) -> Difference | None:
        probe = self._probe
        if probe.call.iteration >= 0:
            return self._first_of_iteration()
        first = self._first_before_end()
        if self._found.calls == self._expected.calls:
            return first or self._first_in_state(_UPDATE_ORDER)
        what = "calls of femGrainsContactIterate"
        if first or self._may_end_otherwise():
            return first
        return self._tell(what, self._expected.calls, self._found.calls)

    def _may_end_otherwise(self) -> bool:
        """Return whether a step may take another number of iterations than the reference's."""
        call, expected, found = self._probe.call, self._expected, self._found
        if found.calls == expected.calls - 1 == call.max_iterations:
            return True
        shorter, longer = sorted((expected, found), key=lambda answer: answer.calls)
        if shorter.calls < 2 or longer.calls > min(len(longer.record), call.max_iterations + 1):
            return False
        excess = longer.record[shorter.calls - 1 :, 2] - call.tolerance
        return abs(excess[0]) <= self._speed and bool(np.all(excess[:-1] >= -self._speed))

    def _first_of_iteration(self) -> Difference | None:
        first = self._first_in_state(("dvContacts", "dvBoundary"))
        first = first or self._first_in_state(("vx", "vy", "x", "y", "r", "m"))
        if first is None and self._probe.call.iteration > 0:  # zeta of the first iteration is left open
            return self._of_zeta(self._expected.zeta, self._found.zeta, self._probe.call.iteration)
        return first

    def _of_zeta(self, expected: float, found: float, iteration: int) -> Difference | None:
        same = _same(np.array([expected]), np.array([found]), self._speed)[0]
        return None if same else self._tell("zeta", expected, found, iteration)

    def _first_before_end(self) -> Difference | None:
        """Compare what the iterations began with, what they were asked for, and what they returned."""
        n = self._probe.call.n
        if self._found.calls == 0:
            return None
        for k, name in enumerate(("x", "y", "vx", "vy")):
            part = slice(k * n, (k + 1) * n)
            most = self._length if k < 2 else self._speed
            wrong = np.flatnonzero(~_same(self._expected.before[part], self._found.before[part], most))
            if wrong.size:
                i = int(wrong[0])
                values = (self._expected.before[part][i], self._found.before[part][i])
                return self._tell(f"{name}[{i}] before the iterations", *values)
        for k, (of_reference, of_homework) in enumerate(
            zip(self._expected.record, self._found.record, strict=False)
        ):
            (right, dt, zeta), (iteration, with_dt, returned) = of_reference, of_homework
            if (iteration > 0) != (right > 0):
                return self._tell(f"iter in call {k + 1} of femGrainsContactIterate", right, iteration)
            if with_dt != dt:
                return self._tell(f"dt in call {k + 1} of femGrainsContactIterate", dt, with_dt)
            first = self._of_zeta(zeta, returned, k) if right > 0 else None
            if first:
                return first
        return None

    def _first_in_state(self, names: tuple[str, ...]) -> Difference | None:
        n = self._probe.call.n
        for name in names:
            k = FIELDS.index(name)
            part = slice(k * n, (k + 1) * n if k < 7 else None)
            expected, found = self._expected.state[part], self._found.state[part]
            wrong = np.flatnonzero(~_same(expected, found, self._length if k < 2 else self._speed))
            if wrong.size:
                i = int(wrong[0])
                return self._tell(f"{name}[{i}]", expected[i], found[i], contact=self._contact(name, i))
        return None

    def _contact(self, name: str, index: int) -> str | None:
        """Name the contact that an entry belongs to, or the first that acts on the grain."""
        n, state = self._probe.call.n, self._expected.state
        i, j = np.triu_indices(n, 1)
        if name == "dvContacts":
            return f"pair ({i[index]}, {j[index]})"
        if name == "dvBoundary":
            return (
                f"grain {index} at the {_wall(state[6 * n + index] or self._found.state[6 * n + index])} wall"
            )
        if self._probe.call.iteration < 0:
            return None
        acting = np.flatnonzero(((i == index) | (j == index)) & (state[7 * n :] != 0.0))
        if acting.size:
            return f"pair ({i[acting[0]]}, {j[acting[0]]})"
        wall = state[6 * n + index]
        return f"grain {index} at the {_wall(wall)} wall" if wall else f"grain {index}"

    def _tell(
        self,
        quantity: str,
        expected: float,
        found: float,
        iteration: int | None = None,
        contact: str | None = None,
    ) -> Difference:
        probe = self._probe
        if iteration is None and probe.call.iteration >= 0:
            iteration = probe.call.iteration
        return Difference(
            probe.scene, probe.step, iteration, contact, quantity, float(expected), float(found)
        )


def _same(expected: FloatArray, found: FloatArray, most: float) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        near = np.abs(expected - found) <= most
    return near | (expected == found) | (np.isnan(expected) & np.isnan(found))


def _wall(correction: float) -> str:
    return "inner" if correction < 0.0 else "outer"


def _told_apart(one: float, other: float) -> tuple[str, str]:
    """Write two numbers with as few digits as tell them apart."""
    for digits in range(4, 18):
        words = f"{one:.{digits}g}", f"{other:.{digits}g}"
        if words[0] != words[1]:
            break
    return words
