"""Fixtures that several test files share."""

import ctypes
from collections.abc import Callable

import pytest
from c_reference import Reference, build

from warpgrains import Scene
from warpgrains.reports import State


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
