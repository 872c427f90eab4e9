"""Comparison of answers with the reference: equal up to rounding, or the first difference.

A correct homework may compute sums in another order. Each active contact then changes velocities, corrections
and zeta by up to `_ROUNDINGS` eps times the largest speed, which may be that of a gap, R_out / dt. Contacts
are inelastic, so later contacts do not amplify this error. A call with several contacts and iterations
therefore differs by at most

    velocities, corrections, zeta   _ROUNDINGS eps speed contacts iterations
    positions                       dt times this, plus _ROUNDINGS eps R_out

and any larger difference is a mistake. Every call starts from the reference's state, so that errors do not
accumulate over steps.

The text does not say whether iteration 0 counts for iterMax. A homework is therefore compared with the
reference at iterMax or at iterMax - 1 (grader.py). In no probe is zeta so near the tolerance that rounding
decides on one more iteration.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from warpgrains.grade.probes import Probe
from warpgrains.grade.sandbox import FIELDS, Answer
from warpgrains.grade.words import Words

DOUBLE, FLOAT = (float(np.finfo(kind).eps) for kind in (np.float64, np.float32))
"""Relative rounding errors of double and float."""

_ROUNDINGS = 32
_ORDER = ("dvContacts", "dvBoundary", "vx", "vy", "x", "y", "r", "m")  # corrections cause the rest


class Difference(NamedTuple):
    """The first difference of an answer from the reference, in a `quantity` such as "vx[3]"."""

    probe: Probe
    quantity: Words
    expected: float
    found: float
    iteration: int | None = None
    """Iteration in which zeta differs, from 0; None for other quantities."""
    contact: Words | None = None
    """Contact that changes the quantity, such as "pair (0, 1)"; None if unknown."""

    def words(self) -> Words:
        """Return a sentence with the place, the quantity, and its expected and actual value."""
        place = self.probe.place(self.iteration, self.contact)
        expected, found = _distinct_digits(self.expected, self.found)
        values = {"place": place, "quantity": self.quantity, "found": found, "expected": expected}
        return Words("{place}: {quantity} is {found}, expected {expected}", **values)


def difference(probe: Probe, expected: Answer, found: Answer, eps: float = DOUBLE) -> Difference | None:
    """Return the first difference of `found` from `expected`; None if they agree.

    Differences within the bounds of this module, for a rounding error `eps`, do not count. If `eps` is 0, all
    bits must agree.
    """
    with np.errstate(invalid="ignore"):
        return None if expected == found else _Comparison(probe, expected, found, eps).first()


class _Comparison:
    """Comparison of the answer `found` to a probe with the expected one, within the bounds of this module.

    `eps` is the relative rounding error of a number.
    """

    def __init__(self, probe: Probe, expected: Answer, found: Answer, eps: float):
        self._probe, self._expected, self._found = probe, expected, found
        call, n = probe.call, probe.call.n
        numbers = np.concatenate(
            [call.state[2 * n : 4 * n], expected.state[2 * n : 4 * n], expected.state[6 * n :]]
        )
        largest = float(np.abs(numbers[np.isfinite(numbers)]).max(initial=call.radius_out / call.dt))
        acting = n + np.count_nonzero(expected.state[6 * n :])
        rounding = _ROUNDINGS * eps
        self._speed = rounding * largest * acting * max(1, expected.calls)
        self._length = call.dt * self._speed + rounding * call.radius_out

    def first(self) -> Difference | None:
        iteration = self._probe.call.iteration
        if iteration >= 0:
            first = self._first_in("state", _ORDER)
            if first or iteration == 0:  # where zeta is undefined
                return first
            return self._of_zeta(self._expected.zeta, self._found.zeta, iteration)
        first = self._first_before_end()
        if first or self._found.calls == self._expected.calls:
            return first or self._first_in("state", _ORDER)
        calls = Words("number of calls of femGrainsContactIterate")
        return Difference(self._probe, calls, self._expected.calls, self._found.calls)

    def _of_zeta(self, expected: float, found: float, iteration: int) -> Difference | None:
        same = _same(np.float64(expected), np.float64(found), self._speed)
        return None if same else Difference(self._probe, Words("zeta", "zeta"), expected, found, iteration)

    def _first_before_end(self) -> Difference | None:
        """Return the first difference during femGrainsUpdate, before its final state; None without one.

        It compares the state before the iterations, and iter, dt and zeta of each iteration.
        """
        if self._found.calls == 0:
            return None
        first = self._first_in("before", FIELDS[:4])
        if first:
            return first
        both = zip(self._expected.record, self._found.record, strict=False)
        for k, ((right, dt, zeta), (iteration, with_dt, returned)) in enumerate(both):
            if (iteration > 0) != (right > 0):
                quantity = Words("iter in call {call} of femGrainsContactIterate", call=k + 1)
                return Difference(self._probe, quantity, right, iteration)
            if with_dt != dt:
                quantity = Words("dt in call {call} of femGrainsContactIterate", call=k + 1)
                return Difference(self._probe, quantity, dt, with_dt)
            first = self._of_zeta(zeta, returned, k) if right > 0 else None
            if first:
                return first
        return None

    def _first_in(self, attribute: str, names: Sequence[str]) -> Difference | None:
        """Return the first difference in the arrays `names` (of `FIELDS`) of both answers; None without one.

        `attribute` is the attribute of `Answer` that holds the arrays: "before" or "state".
        """
        n = self._probe.call.n
        all_expected, all_found = getattr(self._expected, attribute), getattr(self._found, attribute)
        for name in names:
            k = FIELDS.index(name)
            part = slice(k * n, (k + 1) * n if k < 7 else None)
            expected, found = all_expected[part], all_found[part]
            wrong = np.flatnonzero(~_same(expected, found, self._length if k < 2 else self._speed))
            if wrong.size:
                i = int(wrong[0])
                entry = f"{name}[{i}]"
                quantity = Words(entry, entry)
                if attribute == "before":
                    quantity = Words("{entry} before the iterations", entry=entry)
                contact = self._contact(name, i)
                return Difference(self._probe, quantity, expected[i], found[i], contact=contact)
        return None

    def _contact(self, name: str, index: int) -> Words | None:
        """Return the contact that explains a difference in entry `index` of the array `name`.

        An entry of a correction belongs to one contact. An entry of a grain is changed by all of its
        contacts: after femGrainsContactIterate, return the first active one, or the grain if there is none.
        After femGrainsUpdate, return None for an entry of a grain.
        """
        n, state = self._probe.call.n, self._expected.state
        i, j = np.triu_indices(n, 1)
        if name == "dvContacts":
            return Words("pair ({i}, {j})", i=i[index], j=j[index])
        if name != "dvBoundary" and self._probe.call.iteration < 0:
            return None
        acting = np.flatnonzero(((i == index) | (j == index)) & (state[7 * n :] != 0.0))
        if name != "dvBoundary" and acting.size:
            return Words("pair ({i}, {j})", i=i[acting[0]], j=j[acting[0]])
        wall = state[6 * n + index] or (self._found.state[6 * n + index] if name == "dvBoundary" else 0.0)
        if name != "dvBoundary" and not wall:
            return Words("grain {i}", i=index)
        return Words("grain {i} at the inner wall" if wall < 0.0 else "grain {i} at the outer wall", i=index)


def _same(expected: Any, found: Any, most: float) -> Any:
    near = np.abs(expected - found) <= most
    return near | (expected == found) | (np.isnan(expected) & np.isnan(found))


def _distinct_digits(one: float, other: float) -> tuple[str, str]:
    """Return two numbers with the fewest digits that distinguish them."""
    for digits in range(4, 18):
        words = f"{one:.{digits}g}", f"{other:.{digits}g}"
        if words[0] != words[1]:
            break
    return words
