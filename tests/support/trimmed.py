"""Numbers of examples of long tests, which the variable WARPGRAINS_EXAMPLES limits, as in CI."""

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
    """Return values as parameters of a test, of which those after the first `count` are slow."""
    marks = chain([()] * count, repeat(pytest.mark.slow))
    return [pytest.param(value, marks=own) for value, own in zip(values, marks, strict=False)]


def few_or_many(few: int, many: int, **options: int) -> pytest.MarkDecorator:
    """Parametrize `how`, settings of hypothesis: `few` fixed examples, and, if slow, `many` random ones."""
    common = {"deadline": None, "suppress_health_check": list(HealthCheck), "database": None, **options}
    long = settings(max_examples=trimmed(many), **common)
    cases = [
        pytest.param(settings(max_examples=few, derandomize=True, **common), id="few"),
        pytest.param(long, id="many", marks=pytest.mark.slow),
    ]
    return pytest.mark.parametrize("how", cases)
