"""Times of things that are compared: taken in turn, so that a machine's noise hits all of them."""

import sys
from collections.abc import Callable
from time import perf_counter


def seconds(work: Callable[[], object]) -> float:
    """Return how long a call takes."""
    start = perf_counter()
    work()
    return perf_counter() - start


def in_turn(repeats: int, *measure: Callable[[], float]) -> list[list[float]]:
    """Call each function once a round; return the values of each."""
    rounds = [[take() for take in measure] for _ in range(repeats)]
    return [list(values) for values in zip(*rounds, strict=True)]


def say(text: str) -> None:
    """Tell on standard error how far the benchmark is."""
    print(text, file=sys.stderr, flush=True)
