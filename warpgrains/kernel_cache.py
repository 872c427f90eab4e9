"""Whether a scene's kernels have been compiled on this machine before."""

from pathlib import Path

import warp as wp

from warpgrains.grains import variant_of
from warpgrains.scene import Scene

CPU_BLOCK = 1  # threads in which Warp compiles a kernel for a CPU


def is_compiled(scene: Scene, device: str) -> bool:
    """Return whether Warp's cache holds the kernels of a scene for which a `Simulation` has been made."""
    module = variant_of(scene).module
    block = CPU_BLOCK if wp.get_device(device).is_cpu else module.options["block_dim"]
    return (Path(wp.config.kernel_cache_dir) / module.get_module_identifier(block)).is_dir()
