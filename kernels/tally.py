"""What is added up of the steps of a scene: `warpgrains.reports.Tally`, on the device."""

import warp as wp

from .data import ITERATIONS, OVERLAP, RESIDUAL
from .record import REBUILDS, REDOS, TO_SEARCH, SceneRecord
from .step import has_converged

f64 = wp.float64
STEPS, SUM, MOST, UNCONVERGED, WORST_RESIDUAL, WORST_OVERLAP, ALL_REBUILDS, ALL_REDOS = (
    wp.constant(k) for k in range(8)
)


@wp.func
def add_step(s: SceneRecord) -> bool:
    """Count one step. Returns whether a proof is worth a search that it has no solution."""
    report = s.progress.report
    iterations = report[ITERATIONS]
    s.tally[STEPS] = s.tally[STEPS] + f64(1.0)
    s.tally[SUM] = s.tally[SUM] + iterations
    s.tally[MOST] = wp.max(s.tally[MOST], iterations)
    s.tally[WORST_RESIDUAL] = wp.max(s.tally[WORST_RESIDUAL], report[RESIDUAL])
    s.tally[WORST_OVERLAP] = wp.max(s.tally[WORST_OVERLAP], report[OVERLAP])
    s.tally[ALL_REBUILDS] = s.tally[ALL_REBUILDS] + f64(s.flag[REBUILDS])
    s.tally[ALL_REDOS] = s.tally[ALL_REDOS] + f64(s.flag[REDOS])
    if has_converged(s, report[RESIDUAL]):
        return False
    s.tally[UNCONVERGED] = s.tally[UNCONVERGED] + f64(1.0)
    s.flag[TO_SEARCH] = s.flag[TO_SEARCH] - int(iterations)
    return s.flag[TO_SEARCH] <= 0
