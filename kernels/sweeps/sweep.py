"""A sweep over a set of contacts, by pair_sweep.py for pairs and wall_sweep.py for contacts with walls."""

from functools import cache

import warp as wp

from ..access import at, larger, named, put
from ..contacts import chunks_of_set, contacts_of, is_wall_set, range_of_set
from ..record import Scene, has_friction, is_accelerated, is_driven
from ..search.verlet import add_unmonitored
from ..team.threads import Team, partial_index, take_max, update_max
from ..types import ContactsByRef
from .momentum import accept_or_reject, limit_momentum
from .pair_sweep import KEPT, sweeping_in_blocks, sweeping_in_fours
from .stopping import end_iteration
from .wall_sweep import sweeping_walls

f64 = wp.float64


@cache
def sweeping(friction: bool, resists_rolling: bool, ahead: bool) -> wp.Function:
    """Return the stage that corrects the contacts of a set; a sweep `ahead` corrects the working set only."""
    sweeping_pairs = sweeping_in_fours if ahead else sweeping_in_blocks
    sweep_pairs = sweeping_pairs(friction, resists_rolling)
    sweep_walls, sweep_driven = (
        sweeping_walls(driven, friction, resists_rolling, ahead) for driven in (False, True)
    )

    @wp.func
    def sweep_range(s: Scene, contacts: ContactsByRef, k: int, begin: int, end: int, kept: int) -> wp.vec3d:
        """Correct contacts [begin, end) of set k; return (largest change [m/s], both sums of momentum.py)."""
        if not is_wall_set(s, k):
            return sweep_pairs(s, contacts, begin, end, kept)
        if is_driven(s):
            return sweep_driven(s, contacts, begin, end)
        return sweep_walls(s, contacts, begin, end)

    @named(f"sweep{'_ahead' * ahead}{'_with_friction' * friction}{'_and_rolling' * resists_rolling}")
    def sweep_set(team: Team, s: Scene, k: int):
        zeta = f64(0.0)
        if wp.static(ahead):
            begin, end = chunks_of_set(s, k)
            first, last = range_of_set(team, s, k, begin, end)
            for chunk in range(first, last):
                bounds = at(s.working.range, chunk)
                total = sweep_range(s, s.working.contacts, k, bounds[0], bounds[1], 0)
                put(s.momentum.contact_sums, chunk, wp.vec2d(total[1], total[2]))
                zeta = larger(zeta, total[0])
        else:
            begin, end = contacts_of(team, s, k)
            kept = KEPT * partial_index(team, s.partial.zeta.shape[0])
            total = sweep_range(s, s.contacts, k, begin, end, kept)
            zeta = total[0]
        update_max(team, s.partial.zeta, zeta)

    return sweep_set


@wp.func
def end_sweep(s: Scene):
    """Count a sweep, choose the momentum of the next accelerated one, and choose the phase that follows."""
    zeta = take_max(s.partial.zeta)
    if is_accelerated(s):
        if has_friction(s):
            limit_momentum(s, zeta)
        else:
            accept_or_reject(s, zeta)
        end_iteration(s, zeta)
    else:
        end_iteration(s, zeta)
        add_unmonitored(s)
