"""What is added up of the steps of a scene; `warpgrains.solver.statistics` tells how each number is."""

import warp as wp

from .record import UNPROVED, Scene
from .stopping import has_converged


@wp.func
def add_step(s: Scene):
    """Count one step, and ask for a search for a proof that it has no solution where that is worth it."""
    done = s.step
    total = s.statistics
    total.steps = total.steps + 1
    total.iterations = total.iterations + wp.int64(done.iterations)
    total.iterations_max = wp.max(total.iterations_max, done.iterations)
    total.residual = wp.max(total.residual, done.residual)
    total.overlap = wp.max(total.overlap, done.overlap)
    total.rebuilds = total.rebuilds + wp.int64(done.rebuilds)
    total.redos = total.redos + wp.int64(done.redos)
    if not has_converged(s):
        total.unconverged = total.unconverged + 1
        s.to_search = s.to_search - done.iterations
        if s.to_search <= 0:
            s.step.outcome = UNPROVED
    s.statistics = total
