"""How much a long test does, and how many cases it has: all, or what WARPGRAINS_EXAMPLES leaves, as in CI."""

import os

import pytest
from hypothesis import HealthCheck, settings


def trimmed(many: int) -> int:
    """Return so many examples, or fewer."""
    return min(many, int(os.environ.get("WARPGRAINS_EXAMPLES", many)))


def few_or_many(few: int, many: int, **options: int) -> pytest.MarkDecorator:
    """Give a test the settings `how` of hypothesis: few examples, always the same; many others if slow."""
    common = {"deadline": None, "suppress_health_check": list(HealthCheck), "database": None, **options}
    long = settings(max_examples=trimmed(many), **common)
    cases = [
        pytest.param(settings(max_examples=few, derandomize=True, **common), id="few"),
        pytest.param(long, id="many", marks=pytest.mark.slow),
    ]
    return pytest.mark.parametrize("how", cases)
