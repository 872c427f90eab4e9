"""Checks of single values.

Each returns the checked value or raises `InputError` with one line that names the field and the value.

NumPy is imported only if a value is an array: ``--help`` reads the table of options and must stay fast.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from difflib import get_close_matches
from math import isfinite
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

from warpgrains.base.errors import InputError
from warpgrains.base.shown import number_of

if TYPE_CHECKING:
    from warpgrains.base.arrays import BoolArray, FloatArray

LARGEST_WHOLE_NUMBER = 2**31 - 1  # the kernels count in 32 bits
LONGEST_SHOWN = 100  # characters of a value in a message
ABSENT = {
    "stiffness": "grains are rigid",
    "damping": "grains are rigid; drag slows their motion",
}
"""Parameters of other programs that this model does not have, with the reason, for messages."""
MOST_THREADS = 1024  # more than any machine has cores; each thread costs a stack and a start


def shown(value: Any) -> str:
    """Return a value as text for messages, on one line and shortened if it is long."""
    line = " ".join(repr(value).split())
    return line if len(line) <= LONGEST_SHOWN else f"{line[:LONGEST_SHOWN]} ..."


def number(field: str, value: Any) -> float:
    """Return a finite real number as a float; InputError, which names `field`, otherwise."""
    if isinstance(value, bool) or not isinstance(value, float | Real):  # the first of these is faster
        raise InputError(f"{field} is {shown(value)}: it must be a number")
    try:
        converted = float(value)
    except OverflowError:
        converted = float("inf")
    if not isfinite(converted):
        raise InputError(f"{field} is {converted}: it must be finite")
    return converted


def positive(field: str, value: Any) -> float:
    """Return a finite number greater than 0 as a float; InputError, which names `field`, otherwise."""
    converted = number(field, value)
    if converted <= 0.0:
        raise InputError(f"{field} is {converted}: it must be greater than 0")
    return converted


def not_negative(field: str, value: Any) -> float:
    """Return a finite number that is 0 or more as a float; InputError, which names `field`, otherwise."""
    converted = number(field, value)
    if converted < 0.0:
        raise InputError(f"{field} is {converted}: it must be 0 or more")
    return converted


def fraction(field: str, value: Any) -> float:
    """Return a number from 0 to 1, both included, as a float; InputError, which names `field`, otherwise."""
    converted = number(field, value)
    if not 0.0 <= converted <= 1.0:
        raise InputError(f"{field} is {converted}: it must be between 0 and 1")
    return converted


def whole_number(field: str, value: Any, least: int = 1, most: int = LARGEST_WHOLE_NUMBER) -> int:
    """Return an integer from `least` to `most` as an int; InputError, which names `field`, otherwise."""
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise InputError(f"{field} is {shown(value)}: it must be a whole number")
    converted = int(value)
    if not least <= converted <= most:
        found = str(converted) if abs(converted) < 10**30 else "a number of more than 30 digits"
        raise InputError(f"{field} is {found}: it must be between {least} and {most}")
    return converted


def thread_count(field: str, value: Any) -> int:
    """Return a number of threads from 1 to `MOST_THREADS`; InputError, which names `field`, otherwise."""
    return whole_number(field, value, most=MOST_THREADS)


def text(field: str, value: Any) -> str:
    """Return `value` if it is a str; InputError, which names `field`, otherwise."""
    if not isinstance(value, str):
        raise InputError(f"{field} is {shown(value)}: it must be a string")
    return value


def unicode_text(field: str, value: Any) -> str:
    """Return `value` if it is a str that any file can hold; InputError, which names `field`, otherwise."""
    encoded = text(field, value).encode(errors="replace")
    if b"\0" in encoded or encoded.decode() != value:
        raise InputError(f"{field} is {shown(value)}: it must be Unicode text without NUL")
    return value


def path(field: str, value: Any) -> str:
    """Return the name of a file, from a str or a path; InputError, which names `field`, otherwise."""
    if not isinstance(value, str | os.PathLike) or isinstance(name := os.fspath(value), bytes):
        raise InputError(f"{field} is {shown(value)}: it must be the name of a file")
    return name


def function(field: str, value: Any) -> None:
    """Raise InputError, which names `field`, unless `value` is callable."""
    if not callable(value):
        raise InputError(f"{field} is {shown(value)}: it must be a function")


def boolean(field: str, value: Any) -> bool:
    """Return a Python or NumPy bool as a bool; InputError, which names `field`, for any other value."""
    if type(value).__name__ not in ("bool", "bool_"):  # also NumPy's, which is not imported
        raise InputError(f"{field} is {shown(value)}: it must be True or False")
    return bool(value)


def one_of(field: str, value: Any, known: Iterable[str]) -> str:
    """Return `value` if it is one of the names `known`.

    Otherwise raise InputError, which calls the value `field` and proposes the most similar name.
    """
    known = list(known)
    if isinstance(value, str) and value in known:
        return str(value)
    if isinstance(value, str) and value in ABSENT:
        raise InputError(f"unknown {field} {value!r}: there is none, because {ABSENT[value]}")
    nearest = get_close_matches(str(value), known, n=1)
    hint = f"did you mean {nearest[0]!r}? Known" if nearest else "known"
    raise InputError(f"unknown {field} {shown(value)}: {hint}: {', '.join(sorted(filter(None, known)))}")


def only_one(what: str, given: Iterable[str], known: Iterable[str]) -> str:
    """Return the only name that is both given and known; InputError, which names `what`, otherwise."""
    known = list(known)
    found = [name for name in known if name in given]
    if len(found) != 1:
        has = " and ".join(found) or "none"
        raise InputError(f"{what} needs exactly one of {', '.join(known)}: it has {has}")
    return found[0]


def vector(field: str, value: Any) -> tuple[float, float]:
    """Return two finite numbers, from any iterable, as a pair; InputError, which names `field`, otherwise."""
    try:
        components = [] if isinstance(value, str) else list(value)
    except TypeError:
        components = []
    if len(components) != 2:
        raise InputError(f"{field} is {shown(value)}: it must be two numbers")
    return number(f"{field}[0]", components[0]), number(f"{field}[1]", components[1])


def interval(field: str, value: Any) -> tuple[float, float]:
    """Return two lengths [m] as a pair; InputError, which names `field`, unless the first is smaller."""
    low, high = vector(field, value)
    if low >= high:
        raise InputError(f"{field} is ({low}, {high}) m: the smaller one comes first")
    return low, high


def vectors(field: str, value: Any, of: str = "grain") -> FloatArray:
    """Return a read-only copy of finite vectors, shape (n, 2), n >= 1; InputError otherwise.

    Messages name `field`, and call each row `of`.
    """
    array = _floats(field, value, of, 2)
    if array.ndim != 2 or array.shape[1] != 2 or len(array) == 0:
        told = f"it must be (n, 2), such as [[0.5, 0.0]], a row per {of}, at least one"
        raise InputError(f"{field} has shape {array.shape}: {told}")
    require_finite(field, array, of)
    return frozen(array)


def require_finite(field: str, array: FloatArray, of: str = "grain") -> None:
    """Raise InputError unless `array`, shape (n,) or (n, 2), is finite.

    The message names `field` and the first bad row, which it calls `of`.
    """
    import numpy as np

    if not np.isfinite(array).all():
        bad = np.logical_not(np.isfinite(array.reshape(len(array), -1)).all(axis=1))
        raise InputError(f"{first_bad(field, array, bad, of)}: it must be finite")


def per_grain(field: str, value: Any, n: int, of: str = "grain") -> FloatArray:
    """Return finite numbers, from n numbers or one for all, as a read-only array, shape (n,).

    Raises InputError for other values. Messages name `field`, and call each entry `of`.
    """
    import numpy as np

    array = _floats(field, value, of)
    if array.ndim == 0:
        array = np.full(n, number(field, array[()]))
    if array.shape != (n,):
        there = f"there {'is' if n == 1 else 'are'} {number_of(n, of)}"
        raise InputError(f"{field} has shape {array.shape}: {there}, it must be one number or ({n},)")
    require_finite(field, array, of)
    return frozen(array)


def positive_per_grain(field: str, value: Any, n: int, of: str = "grain") -> FloatArray:
    """Return numbers > 0, from n numbers or one for all, as a read-only array, shape (n,).

    Raises InputError for other values. Messages name `field`, and call each entry `of`.
    """
    array = _floats(field, value, of)
    if array.ndim == 0:
        positive(field, array[()])
    array = per_grain(field, array, n, of)
    if (array <= 0.0).any():
        raise InputError(f"{first_bad(field, array, array <= 0.0, of)}: it must be greater than 0")
    return array


def first_bad(field: str, array: FloatArray, bad: BoolArray, of: str = "grain") -> str:
    """Return the start of an error message: the field, the first grain marked in `bad`, and its value.

    Messages call each row of the array `of`.
    """
    number = int(bad.argmax())
    value = array[number].tolist()
    return f"{field} of {of} {number} is {tuple(value) if array.ndim > 1 else value}"


def _floats(field: str, value: Any, of: str, width: int = 1) -> FloatArray:
    """Return a copy of real numbers, an array or nested lists, as float64; InputError otherwise.

    Messages name `field`, and say that each row, which is called `of`, needs `width` numbers.
    """
    import numpy as np

    if np.ma.is_masked(value):
        raise InputError(f"{field} holds masked values: it must hold real numbers")
    try:
        array = np.asarray(value)
    except ValueError:  # lists of several lengths
        array = np.array(None)
    if array.dtype.kind not in "iuf" and array.size > 0:
        if isinstance(value, str) or not isinstance(value, Iterable):
            if width > 1:
                raise InputError(f"{field} is {shown(value)}: it must be an array of shape (n, {width})")
            number(field, value)
        else:
            for k, own in enumerate(value):
                _require_numbers(f"{field} of {of} {k}", own, width)
        raise InputError(f"{field} holds {array.dtype.name} values: it must hold real numbers")
    return np.array(array, dtype=np.float64, order="C")


def _require_numbers(field: str, value: Any, width: int) -> None:
    """Raise InputError unless `value` is a list of `width` real numbers, or one number if `width` is 1."""
    is_list = isinstance(value, Iterable) and not isinstance(value, str)
    parts = list(value) if is_list else [value]
    if len(parts) != width or not all(isinstance(own, Real) and not isinstance(own, bool) for own in parts):
        raise InputError(
            f"{field} is {shown(value)}: it must be {'a number' if width == 1 else 'two numbers'}"
        )


def frozen(array: FloatArray) -> FloatArray:
    """Make an array read-only and return it."""
    array.setflags(write=False)
    return array
