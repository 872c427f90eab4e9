"""Fixtures that several test files share."""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from warpgrains import Scene, Simulation
from warpgrains.reference.reference import Reference, build
from warpgrains.scene.state import State
from warpgrains.solver import tuning as scales

WAYS = [
    pytest.param((1, True), id="1 thread"),
    pytest.param((2, True), id="2 threads", marks=pytest.mark.slow),
    pytest.param((1, False), id="1 thread, a list every step", marks=pytest.mark.slow),
    pytest.param((2, False), id="2 threads, a list every step", marks=pytest.mark.slow),
]


@pytest.fixture(scope="session")
def c_library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The C reference, built once; without a compiler the tests fail."""
    try:
        return build(tmp_path_factory.mktemp("reference"))
    except RuntimeError as error:
        pytest.fail(str(error), pytrace=False)


@pytest.fixture
def reference(c_library: ctypes.CDLL) -> Callable[..., Reference]:
    """Put a scene into the C reference."""

    def make(scene: Scene, state: State | None = None) -> Reference:
        return Reference(c_library, scene, state)

    return make


@dataclass(frozen=True)
class Simulate:
    """A way to simulate a scene; all but the first are tested for fewer steps."""

    threads: int
    use_again: bool

    def __call__(self, scene: Scene) -> Simulation:
        return Simulation(scene, threads=self.threads)

    def of(self, steps: int) -> int:
        return steps if (self.threads, self.use_again) == (1, True) else steps // 5


@pytest.fixture(params=WAYS)
def simulate(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Simulate:
    """Simulate with one thread and with two, using lists for as long as they hold and for one step only."""
    way = Simulate(*request.param)
    if not way.use_again:
        monkeypatch.setattr(scales, "SLACK", 1e-12)
    return way
