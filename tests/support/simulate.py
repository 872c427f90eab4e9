"""The ways to simulate a scene that must all give the same bits."""

from dataclasses import dataclass

import pytest

from warpgrains import Scene, Simulation

WAYS = [
    pytest.param((1, True, 1), id="1 thread"),
    pytest.param((2, True, 10), id="2 threads", marks=pytest.mark.slow),
    pytest.param((1, False, 5), id="1 thread, a list every step", marks=pytest.mark.slow),
    pytest.param((2, False, 10), id="2 threads, a list every step", marks=pytest.mark.slow),
]


@dataclass(frozen=True)
class Simulate:
    """A way to simulate a scene; all but the first are tested for a share of the steps."""

    threads: int
    use_again: bool
    share: int

    def __call__(self, scene: Scene) -> Simulation:
        return Simulation(scene, threads=self.threads)

    def of(self, steps: int) -> int:
        return steps // self.share
