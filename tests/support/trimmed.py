"""Numbers of examples of long tests, which the environment variable WARPGRAINS_EXAMPLES limits, as in CI."""

import os
from collections.abc import Iterable
from itertools import chain, repeat
from typing import Any

import pytest
from _pytest.mark.structures import ParameterSet
from hypothesis import HealthCheck, settings


def trimmed(many: int) -> int:
    """Return `many`, or WARPGRAINS_EXAMPLES if that is less."""
    return min(many, int(os.environ.get("WARPGRAINS_EXAMPLES", many)))


def first_fast(values: Iterable[Any], count: int) -> list[ParameterSet]:
    """Return values as parameters of a test. All after the first `count` are marked as slow."""
    marks = chain([()] * count, repeat(pytest.mark.slow))
    return [pytest.param(value, marks=own) for value, own in zip(values, marks, strict=False)]


def few_or_many(few: int, many: int, **options: int) -> pytest.MarkDecorator:
    """Return a decorator that gives a test the parameter `how`, settings of hypothesis, with two values.

    With the first, the test has `few` fixed examples. With the second, which is marked as slow, it has `many`
    random ones. `options` are further settings.
    """
    common = {"deadline": None, "suppress_health_check": list(HealthCheck), "database": None, **options}
    long = settings(max_examples=trimmed(many), **common)
    cases = [
        pytest.param(settings(max_examples=few, derandomize=True, **common), id="few"),
        pytest.param(long, id="many", marks=pytest.mark.slow),
    ]
    return pytest.mark.parametrize("how", cases)
