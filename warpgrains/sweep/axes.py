"""Axes of a sweep: the values that a key takes in its runs.

========================================== ==========================================================
value in the sweep file                    its values
========================================== ==========================================================
[0.1, 0.2, 0.5]                            these values, of any kind except files of radii
{range = [0.0, 1.0], count = 5}            evenly spaced, both ends included
{log_range = [1e-8, 1e-4], count = 5}      evenly spaced logarithms, both ends included
{seeds = 10}                               0, 1, ..., 9
========================================== ==========================================================

The values of a range are the doubles nearest to the decimal numbers; those of a log_range have twelve digits.
A range with ends written as whole numbers holds whole numbers, if all its values are whole.
"""

from collections.abc import Callable
from fractions import Fraction
from typing import Any

from warpgrains.base import checks
from warpgrains.base.errors import InputError

MOST_VALUES = 1_000_000

AxisValues = list[Any]


def axis_values(name: str, axis: Any) -> AxisValues:
    """Return the values of an axis from its entry in a sweep file; InputError names key and value."""
    if isinstance(axis, list):
        values = axis
    elif isinstance(axis, dict):
        values = _generated(name, axis)
    else:
        raise InputError(f"axes.{name} is {axis!r}: it must be a list, a range, a log_range or seeds")
    if not values:
        raise InputError(f"axes.{name} is []: it must have at least one value")
    return values


def _generated(name: str, axis: dict[str, Any]) -> AxisValues:
    for key in axis:
        checks.one_of(f"key in axes.{name}", key, (*KINDS, "count"))
    kind = checks.only_one(f"axes.{name}", axis, KINDS)
    generate, known = KINDS[kind]
    for key in axis:
        checks.one_of(f"key in axes.{name}", key, known)
    for key in known:
        if key not in axis:
            raise InputError(f"axes.{name}.{key} is missing: a {kind} needs it")
    return generate(f"axes.{name}", axis)


def _range(field: str, axis: dict[str, Any]) -> AxisValues:
    _ends(f"{field}.range", axis["range"])
    first, last = (Fraction(str(end)) for end in axis["range"])
    steps = _count(f"{field}.count", axis["count"]) - 1
    (a, c), (b, d) = first.as_integer_ratio(), last.as_integer_ratio()
    values = [(a * d * (steps - k) + b * c * k) / (c * d * steps) for k in range(steps + 1)]
    return _as_integers(axis["range"], values)


def _log_range(field: str, axis: dict[str, Any]) -> AxisValues:
    first, last = _ends(f"{field}.log_range", axis["log_range"])
    if min(first, last) <= 0.0:
        raise InputError(f"{field}.log_range is {axis['log_range']!r}: both ends must be greater than 0")
    steps = _count(f"{field}.count", axis["count"]) - 1
    between = [float(f"{first * (last / first) ** (k / steps):.12g}") for k in range(1, steps)]
    return _as_integers(axis["log_range"], [first, *between, last])


def _seeds(field: str, axis: dict[str, Any]) -> AxisValues:
    return list(range(checks.whole_number(f"{field}.seeds", axis["seeds"], most=MOST_VALUES)))


KINDS: dict[str, tuple[Callable[[str, dict[str, Any]], AxisValues], tuple[str, ...]]] = {
    "range": (_range, ("range", "count")),
    "log_range": (_log_range, ("log_range", "count")),
    "seeds": (_seeds, ("seeds",)),
}


def _ends(field: str, value: Any) -> tuple[float, float]:
    first, last = checks.vector(field, value)
    if first == last:
        raise InputError(f"{field} is {value!r}: its ends must differ")
    return first, last


def _count(field: str, value: Any) -> int:
    return checks.whole_number(field, value, least=2, most=MOST_VALUES)


def _as_integers(ends: list[Any], values: list[float]) -> AxisValues:
    whole = all(isinstance(end, int) for end in ends) and all(value.is_integer() for value in values)
    return [int(value) for value in values] if whole else list(values)
