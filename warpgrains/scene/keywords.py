"""Keywords of `Scene.replace` and `Simulation.change`, so that type checkers find wrong ones.

They repeat the names and types of `SceneFields`, because a type checker derives no TypedDict from a class.
"""

from collections.abc import Mapping, Sequence
from typing import Any, TypedDict

from numpy.typing import ArrayLike

from warpgrains.arrays import FloatArray
from warpgrains.scene.obstacle import Obstacle


class SceneChanges(TypedDict, total=False):
    """Some fields of a scene."""

    position: ArrayLike
    velocity: ArrayLike | None
    radius: ArrayLike
    mass: ArrayLike
    spin: ArrayLike | None
    radius_in: float
    radius_out: float
    wall: str
    pressure: float | None
    wall_mass: float | None
    angular_velocity_out: float
    angular_velocity_in: float
    walls: Sequence[Obstacle | Mapping[str, Any]]
    gravity: Sequence[float] | FloatArray | Mapping[str, Any]
    drag: float
    spin_drag: float
    friction: float
    wall_friction: float | None
    time: float
    dt: float
    duration: float
    scheme: str
    tolerance: float
    max_iterations: int
    order: str
    method: str
    stop: str
    on_unconverged: str
    name: str
    text: str
