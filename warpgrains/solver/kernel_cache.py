"""Compile a scene's kernels ahead of its first step, so that a user knows what takes so long."""

import sys
from pathlib import Path

import warp as wp

from warpgrains.scene.scene import Scene
from warpgrains.solver.grains import variant_of

CPU_BLOCK = 1  # threads in which Warp compiles a kernel for a CPU


def load_kernels(scene: Scene, device_name: str) -> None:
    """Load the kernels of a scene for which a `Simulation` has been made; say so if they must be compiled."""
    module, device = variant_of(scene).module, wp.get_device(device_name)
    block = CPU_BLOCK if device.is_cpu else module.options["block_dim"]
    if not (Path(wp.config.kernel_cache_dir) / module.get_module_identifier(block)).is_dir():
        print("compiling kernels for such a scene, this first time only ...", file=sys.stderr, flush=True)
    module.load(device, block)
