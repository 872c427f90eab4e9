"""Random radii: the distributions that `grains.radius` of the layout "random" accepts."""

from collections.abc import Callable, Iterable
from numbers import Real
from typing import Any

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError

Draw = Callable[[int], FloatArray]
"""A function that draws the given number of radii [m]."""

DISTRIBUTIONS = {
    "uniform": ("smallest", "largest"),
    "normal": ("mean", "deviation", "smallest", "largest"),
    "lognormal": ("mean", "deviation", "smallest", "largest"),
    "power": ("exponent", "smallest", "largest"),
    "values": ("values", "fractions"),
}
"""Names of the distributions, each with the keys of its table.

The number density of "power" is proportional to r^-exponent. `mean` and `deviation` are those of r itself,
not of log r. A normal or lognormal radius is drawn again unless it lies between `smallest` and `largest`, by
default 0.1 and 10 times the mean. `fractions` are by number, and equal by default.
"""
OF_MEAN = {"smallest": 0.1, "largest": 10.0}
LEAST_KEPT = 1e-3  # smallest accepted fraction of draws between the bounds


def listed_radii(radius: Any) -> FloatArray | None:
    """Return listed radii [m], an array or a list; None for a number, a table, or a pair of bounds."""
    is_array = isinstance(radius, np.ndarray) and radius.ndim > 0
    if not is_array and (not isinstance(radius, list | tuple) or len(radius) == 2):
        return None
    if len(radius) == 0:
        raise InputError("grains.radius is an empty list: it must hold at least one radius")
    return checks.positive_per_grain("grains.radius", radius, len(radius))


def drawn_radii(radius: Any, generator: np.random.Generator) -> tuple[Draw, float]:
    """Check `grains.radius`; return a function that draws such radii, and their upper bound [m].

    `radius` is a number, the smallest and the largest radius, or a table with a distribution.
    """
    if not isinstance(radius, dict):
        if isinstance(radius, str) or not isinstance(radius, Iterable | Real):
            told = "a number, the smallest and the largest, or a table with a distribution"
            raise InputError(f"grains.radius is {checks.shown(radius)}: it must be {told}")
        low, high = checks.vector("grains.radius", radius if np.iterable(radius) else (radius, radius))
        return _uniform(checks.positive("grains.radius", low), high, generator), high
    if "distribution" not in radius:
        raise InputError(f"grains.radius.distribution is missing: give one of {', '.join(DISTRIBUTIONS)}")
    name = checks.one_of("grains.radius.distribution", radius["distribution"], DISTRIBUTIONS)
    for key in radius:
        checks.one_of(f"key of grains.radius, {name},", key, ("distribution", *DISTRIBUTIONS[name]))
    given = {key: value for key, value in radius.items() if key != "distribution"}
    if name == "values":
        return _values(given, generator)
    numbers = {key: checks.positive(f"grains.radius.{key}", value) for key, value in given.items()}
    if "mean" in numbers:
        numbers = {key: share * numbers["mean"] for key, share in OF_MEAN.items()} | numbers
    for key in DISTRIBUTIONS[name]:
        if key not in numbers:
            raise InputError(f"grains.radius.{key} is missing: a {name} distribution needs it")
    low, high = numbers.pop("smallest"), numbers.pop("largest")
    if name == "uniform":
        return _uniform(low, high, generator), high
    if low >= high:
        raise InputError(f"grains.radius is from {low} to {high} m: the smallest radius comes first")
    if name == "power":
        return lambda count: _power(generator.random(count), numbers["exponent"], low, high), high
    draw: Callable[..., FloatArray] = getattr(generator, name)
    return _bounded(draw, _parameters(name, **numbers), low, high), high


def _uniform(low: float, high: float, generator: np.random.Generator) -> Draw:
    if low > high:
        raise InputError(f"grains.radius is ({low}, {high}) m: the smallest radius comes first")
    return lambda count: low + (high - low) * generator.random(count)


def _power(share: FloatArray, exponent: float, low: float, high: float) -> FloatArray:
    """Return the quantiles of the radius [m] at `share`, for a density proportional to r^-exponent."""
    k = 1.0 - exponent
    if abs(k) < 1e-9:
        return np.asarray(low * (high / low) ** share)
    return np.asarray(low * (1.0 + share * ((high / low) ** k - 1.0)) ** (1.0 / k))


def _parameters(name: str, mean: float, deviation: float) -> tuple[float, float]:
    """Return the parameters of NumPy's generator for a given mean and standard deviation of the radius."""
    if name == "normal":
        return mean, deviation
    variance = np.log1p((deviation / mean) ** 2)
    return float(np.log(mean) - 0.5 * variance), float(np.sqrt(variance))


def _bounded(
    draw: Callable[..., FloatArray], parameters: tuple[float, float], low: float, high: float
) -> Draw:
    """Return a function that draws radii [m], and draws those outside [low, high] again.

    It calls `draw` with the parameters of a distribution and a count.
    """

    def drawn(count: int) -> FloatArray:
        radius, bad = draw(*parameters, count), np.arange(count)
        rounds = 0
        while (bad := bad[(radius[bad] < low) | (radius[bad] > high)]).size:
            radius[bad] = draw(*parameters, len(bad))
            rounds += 1
            if rounds > 1.0 / LEAST_KEPT:
                raise InputError(
                    f"grains.radius: less than {LEAST_KEPT:.1%} of the radii drawn"
                    f" are between {low} and {high} m"
                )
        return radius

    return drawn


def _values(given: dict[str, Any], generator: np.random.Generator) -> tuple[Draw, float]:
    values = given.get("values")
    if not isinstance(values, list | tuple) or len(values) == 0:
        raise InputError(f"grains.radius.values is {values!r}: it must be a list of radii")
    radii = checks.positive_per_grain("grains.radius.values", values, len(values), "value")
    fractions = given.get("fractions", [1.0] * len(radii))
    share = checks.positive_per_grain("grains.radius.fractions", fractions, len(radii), "value")
    return lambda count: generator.choice(radii, count, p=share / share.sum()), float(radii.max())
