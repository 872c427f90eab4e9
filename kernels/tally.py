"""What is added up of the steps of a scene: `warpgrains.reports.Tally`, on the device."""

import warp as wp

from .data import ITERATIONS, OVERLAP, RESIDUAL, ZETA
from .record import REBUILDS, REDOS, SceneRecord

f64 = wp.float64
STEPS, SUM, MOST, UNCONVERGED, WORST_OVERLAP, ALL_REBUILDS, ALL_REDOS = (wp.constant(k) for k in range(7))


@wp.func
def add_step(s: SceneRecord):
    """Count one step."""
    report = s.progress.report
    iterations = report[ITERATIONS]
    error = report[ZETA]
    if s.stop.on_residual != 0:
        error = report[RESIDUAL]
    s.tally[STEPS] = s.tally[STEPS] + f64(1.0)
    s.tally[SUM] = s.tally[SUM] + iterations
    s.tally[MOST] = wp.max(s.tally[MOST], iterations)
    if not (error <= s.stop.tolerance):
        s.tally[UNCONVERGED] = s.tally[UNCONVERGED] + f64(1.0)
    s.tally[WORST_OVERLAP] = wp.max(s.tally[WORST_OVERLAP], report[OVERLAP])
    s.tally[ALL_REBUILDS] = s.tally[ALL_REBUILDS] + f64(s.flag[REBUILDS])
    s.tally[ALL_REDOS] = s.tally[ALL_REDOS] + f64(s.flag[REDOS])
