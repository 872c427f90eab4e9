"""Scenes that are computed alone once, for all tests of batches."""

import pytest
from mixed import Alone, alone, mixed_scenes

from warpgrains import Scene


@pytest.fixture(scope="session")
def scenes() -> list[Scene]:
    return mixed_scenes()


@pytest.fixture(scope="session")
def expected(scenes: list[Scene]) -> list[Alone]:
    return [alone(scene) for scene in scenes]
