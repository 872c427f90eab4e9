"""Steps on which sweeps converge too slowly, and which the host solves.

Accelerated sweeps come first. If their residual falls so slowly that a few factorizations cost less, or is
too large after the last sweep, the step ends as SLOW (stopping.py), and the host computes the corrections
(warpgrains/solver/exact.py). Velocities are then recomputed from these, and sweeps continue until they meet
the tolerance, mostly none. If the host finds no better corrections, the sweeps continue from where they were,
and the host is not asked again in this step.

The way in which corrections were found does not matter: a contact that is not listed and that the final
velocities do not violate is satisfied without a correction (MODEL.md, eq. 10). So the check of the list
(verlet.py) starts again from these velocities.
"""

import warp as wp

from .access import at, put
from .record import Phase, Scene


@wp.func
def take_corrected_velocity(s: Scene, i: int):
    """Start from the velocity that the host's corrections make, if they are better than those before."""
    if s.control.phase == Phase.CORRECTED:
        put(s.grains.next_velocity, i, at(s.grains.recomputed_velocity, i))
