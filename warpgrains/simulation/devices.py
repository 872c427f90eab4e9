"""What runs are executed on: a device by its name, and how many threads of it."""

import warp as wp

from warpgrains.errors import SceneError
from warpgrains.scene.scene import Scene
from warpgrains.solver.tuning import paying_threads


def threads_for(scene: Scene, device: wp.Device, threads: int | None = None) -> int:
    """Return how many threads share a scene on a CPU: so many as are wanted, or else as pay."""
    if device.is_cuda:
        return 1
    return paying_threads(scene) if threads is None else threads


def find_device(name: str) -> wp.Device:
    """Return a Warp device by its name; raise SceneError if there is none."""
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError) as error:
        known = ", ".join(device.alias for device in wp.get_devices())
        raise SceneError(f"device {name!r} is unknown here; choose {known}") from error
