"""The state arrays of a run on its device."""

import numpy as np
import warp as wp

from warpgrains.kernels.data import Grains, Progress, Watch
from warpgrains.kernels.momentum import Momentum
from warpgrains.kernels.variant import Variant
from warpgrains.scene.scene import Scene


def variant_of(scene: Scene) -> Variant:
    """Tell what a scene needs, so that its kernels hold nothing else."""
    return Variant(
        gravity=any(scene.gravity),
        drag=scene.drag > 0.0,
        inner_wall=scene.radius_in > 0.0,
        distinct_radii=bool(np.any(scene.radius != scene.radius[0])),
        distinct_masses=bool(np.any(scene.mass != scene.mass[0])),
        accelerated=scene.method == "accelerated",
    )


def allocate_grains(scene: Scene, variant: Variant, device: wp.Device) -> Grains:
    """Allocate the state of a scene's grains; positions and velocities are left to `Simulation.restore`."""

    def vectors() -> wp.array:
        return wp.zeros(scene.n, dtype=wp.vec2d, device=device)

    grains = Grains()
    grains.position = vectors()
    grains.velocity = vectors()
    grains.free_velocity = vectors()
    grains.next_velocity = vectors()
    grains.rebuilt_velocity = vectors()
    grains.last_position = vectors()
    radius = scene.radius if variant.distinct_radii else scene.radius[:1]
    mass = scene.mass if variant.distinct_masses else scene.mass[:1]
    grains.radius = wp.array(radius, dtype=wp.float64, device=device)
    grains.mass = wp.array(mass, dtype=wp.float64, device=device)
    return grains


def allocate_watch(grains: int, device: wp.Device) -> Watch:
    """Allocate the watch over a scene's list of contacts; at first no reach suffices."""
    watch = Watch()
    watch.peak = wp.zeros(grains, dtype=wp.float64, device=device)
    watch.limit = wp.zeros(grains, dtype=wp.float64, device=device)
    watch.recent = wp.zeros(grains, dtype=wp.float64, device=device)
    watch.reach = wp.full(grains, -1.0, dtype=wp.float64, device=device)
    watch.built_position = wp.zeros(grains, dtype=wp.vec2d, device=device)
    watch.built_velocity = wp.zeros(grains, dtype=wp.vec2d, device=device)
    watch.frame = wp.zeros(3, dtype=wp.vec2d, device=device)
    watch.scalar = wp.zeros(8, dtype=wp.float64, device=device)
    watch.flag = wp.zeros(4, dtype=wp.int32, device=device)
    return watch


def allocate_progress(slots: int, device: wp.Device) -> Progress:
    """Allocate what the device tells of a step; every CPU worker needs a slot of its own."""
    progress = Progress()
    progress.iterating = wp.zeros(1, dtype=wp.int32, device=device)
    progress.checking = wp.zeros(1, dtype=wp.int32, device=device)
    progress.accepted = wp.zeros(1, dtype=wp.int32, device=device)
    progress.zeta = wp.zeros(slots, dtype=wp.float64, device=device)
    progress.residual = wp.zeros(slots, dtype=wp.float64, device=device)
    progress.overlap = wp.zeros(slots, dtype=wp.float64, device=device)
    progress.carrying = wp.zeros(slots, dtype=wp.int32, device=device)
    progress.report = wp.zeros(6, dtype=wp.float64, device=device)
    return progress


def allocate_momentum(grains: int, variant: Variant, device: wp.Device) -> Momentum:
    """Allocate what the accelerated method keeps; what is per pair grows with the list (`ContactBuffers`)."""
    if not variant.accelerated:
        grains = 0
    momentum = Momentum()
    momentum.pair_last = wp.zeros(0, dtype=wp.float64, device=device)
    momentum.pair_part = wp.zeros(0, dtype=wp.vec2d, device=device)
    momentum.wall_last = wp.zeros(grains, dtype=wp.float64, device=device)
    momentum.wall_part = wp.zeros(grains, dtype=wp.vec2d, device=device)
    momentum.last_velocity = wp.zeros(grains, dtype=wp.vec2d, device=device)
    momentum.grain_part = wp.zeros(grains, dtype=wp.vec3d, device=device)
    momentum.scalar = wp.zeros(3, dtype=wp.float64, device=device)
    momentum.undo = wp.zeros(1, dtype=wp.int32, device=device)
    return momentum
