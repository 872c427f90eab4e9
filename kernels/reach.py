"""How far a new list of candidates must reach (see watch.py for what it is then good for)."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .data import (
    DRIFT,
    ELAPSED,
    FRAME_REACH,
    FRAME_SHIFT,
    FRAME_VELOCITY,
    HORIZON,
    INFLUENCE,
    ITERATIONS,
    MEAN_VELOCITY,
    SLACK,
    SPREAD,
    Grains,
    Progress,
    Watch,
)
from .stage import kernels_of
from .variant import Variant

f64 = wp.float64
FORESEEN, FOUND_OUT = wp.constant(f64(1.2)), wp.constant(f64(1.6))  # reach over need, before and after a miss
NARROWEST, WIDEST = wp.constant(f64(0.02)), wp.constant(f64(0.2))  # slack, in radii
LONGEST = wp.constant(f64(64.0))  # steps that a list is built for at most


@cache
def stages(variant: Variant) -> SimpleNamespace:
    """Compile-time selection of the stages for one kind of scene."""

    @wp.func
    def adapt_slack(watch: Watch, progress: Progress, radius: f64, dt: f64):
        """Widen the slack [m] after a list that did not last, narrow it after one that did."""
        steps = watch.scalar[ELAPSED] / dt
        if progress.report[ITERATIONS] == f64(0.0) and steps < f64(4.5):
            watch.scalar[SLACK] = wp.min(f64(1.25) * watch.scalar[SLACK], WIDEST * radius)
        elif steps > f64(20.5):
            watch.scalar[SLACK] = wp.max(f64(0.7) * watch.scalar[SLACK], NARROWEST * radius)

    @wp.func
    def renew(i: int, grains: Grains, watch: Watch, progress: Progress, dt: f64):
        """Choose w_i, and reach_i: the slack, and somewhat more than what this step, or the last, has needed.

        A step that is solved again keeps its w_i and its peaks; otherwise w_i is what the grain has now.
        """
        u = watch.frame[FRAME_VELOCITY]
        needed = watch.recent[i]
        margin = FORESEEN
        w = grains.next_velocity[i]
        if progress.report[ITERATIONS] > f64(0.0):
            margin = FOUND_OUT
            needed = wp.max(needed, wp.sqrt(watch.peak[i]) + watch.scalar[DRIFT])
            w = watch.built_velocity[i] + u
        watch.recent[i] = needed
        watch.reach[i] = watch.scalar[SLACK] + margin * dt * needed
        watch.built_position[i] = grains.position[i]
        watch.built_velocity[i] = w

    @wp.func
    def clear(watch: Watch):
        """Start the frame and the sums anew."""
        zero = wp.vec2d(f64(0.0), f64(0.0))
        watch.frame[FRAME_SHIFT] = zero
        watch.frame[MEAN_VELOCITY] = zero
        watch.scalar[ELAPSED] = f64(0.0)
        watch.scalar[INFLUENCE] = f64(0.0)
        watch.scalar[SPREAD] = f64(0.0)

    @wp.func
    def find_mean(i: int, watch: Watch):
        """Mean of the w_i."""
        n = watch.reach.shape[0]
        wp.atomic_add(watch.frame, MEAN_VELOCITY, watch.built_velocity[i] / f64(n))

    @wp.func
    def find_spread(i: int, watch: Watch):
        """Largest |w_i - mean|."""
        w = watch.built_velocity[i]
        wp.atomic_max(watch.scalar, SPREAD, wp.length(w - watch.frame[MEAN_VELOCITY]))

    @wp.func
    def find_horizon(watch: Watch, room: f64, acceleration: f64, dt: f64):
        """As many steps as let no grain come further than `room` [m] beside the others, at least one.

        The frame's reach lets it fall for as long with the gravity's `acceleration` [m/s2].
        """
        steps = wp.clamp(wp.floor(room / (dt * watch.scalar[SPREAD])), f64(1.0), LONGEST)
        horizon = steps * dt
        watch.scalar[HORIZON] = horizon
        watch.scalar[FRAME_REACH] = watch.scalar[SLACK] + f64(1.2) * acceleration * horizon * (
            f64(0.5) * horizon + dt
        )

    return SimpleNamespace(
        adapt_slack=adapt_slack,
        renew=renew,
        clear=clear,
        find_mean=find_mean,
        find_spread=find_spread,
        find_horizon=find_horizon,
    )


@cache
def kernels(variant: Variant) -> SimpleNamespace:
    """Kernels of the stages that are launched."""
    own = stages(variant)
    return kernels_of(
        variant.module,
        own.adapt_slack,
        own.renew,
        own.clear,
        own.find_mean,
        own.find_spread,
        own.find_horizon,
    )
