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


@wp.func
def take_corrected_velocity(s: Scene, i: int):
    """Start from the velocity that the host's corrections make, if they are better than those before."""
    if s.control.resuming == 0:
        put(s.grains.next_velocity, i, at(s.grains.rebuilt_velocity, i))
