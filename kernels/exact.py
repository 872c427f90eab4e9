"""Steps that sweeps do not converge: when the host is asked to solve one, and how its answer is taken up.

Accelerated sweeps come first. Where their residual falls too slowly for what a few factorizations cost, or is
too large after the last of them, the step is left as SLOW, and the host makes its corrections anew
(warpgrains/solver/exact.py). Velocities are then rebuilt from these, and sweeps go on as long as they are of
use, mostly not at all. Where the host declines, because it has found no better corrections, the sweeps go on
as if it had not been asked, and it is not asked again in this step.

On which way corrections were found is no matter: a contact that is not listed and that the final velocities
do not violate is satisfied without a correction (MODEL.md, eq. 10). So the check of the list (verlet.py)
starts anew with these velocities.
"""

import warp as wp

from .access import at, put
from .record import Scene
from .restart import REBUILD_EVERY, decide_ahead
from .stopping import gathered

f64 = wp.float64
HALF_WAY = wp.constant(REBUILD_EVERY // 2)


@wp.func
def is_trend_due(iterations: int) -> bool:
    """Whether the residual is compared with the last one: half-way to the first rebuild, and at each."""
    return iterations == HALF_WAY or iterations % REBUILD_EVERY == 0


@wp.func
def decide_exactly(s: Scene):
    """Decide what follows on a sweep; the residual is also measured half-way to the first rebuild."""
    decide_ahead(s)
    if s.step.iterations == HALF_WAY:
        s.control.measuring = 1


@wp.func
def stop_when_slow(s: Scene):
    """Extrapolate the decay of the residual; if the sweeps left cost more than the host's part, stop."""
    if s.control.declined != 0 or not is_trend_due(s.step.iterations):
        return
    if s.step.iterations > HALF_WAY:
        fallen = wp.log(s.momentum.state.residual / s.step.residual)
        left = wp.log(s.step.residual / s.stopping.tolerance)
        sweeps = wp.min(s.step.iterations - HALF_WAY, REBUILD_EVERY)
        if left * f64(sweeps) > fallen * f64(s.stopping.patience):
            s.control.iterating = 0
            s.control.unfinished = 0
    s.momentum.state.residual = s.step.residual


@wp.func
def take_corrected_velocity(s: Scene, i: int):
    """Go on from the velocity that the host's corrections make, if it has found better ones."""
    if s.control.declined == 0:
        put(s.grains.next_velocity, i, at(s.grains.rebuilt_velocity, i))


@wp.func
def go_on(s: Scene):
    """Sweep on where the host has not come to the tolerance."""
    s.step.residual = gathered(s.partial.residual)
    s.momentum.state.residual = s.step.residual
    left = s.step.residual > s.stopping.tolerance and s.step.iterations < s.stopping.max_iterations
    s.control.iterating = 1 if left and s.control.halted == 0 else 0
    s.control.unfinished = s.control.iterating
    s.control.looking = 1
    s.control.measuring = 0
    s.control.rebuilding = 0
    s.control.rejected = 0
