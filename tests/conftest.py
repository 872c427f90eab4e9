"""Fixtures that several test files share."""

import ctypes
from collections.abc import Callable

import pytest
from simulate import WAYS, Simulate

from warpgrains import Scene
from warpgrains.reference.reference import Reference, build
from warpgrains.scene.state import State
from warpgrains.solver import tuning


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


@pytest.fixture(params=WAYS)
def simulate(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Simulate:
    """Simulate with one thread and with two, using lists for as long as they hold and for one step only."""
    way = Simulate(*request.param)
    if not way.use_again:
        monkeypatch.setattr(tuning, "BASE_SKIN", 1e-12)
    return way
