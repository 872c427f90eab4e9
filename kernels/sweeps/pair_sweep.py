"""The sweep over pairs: corrections contact by contact, in place (MODEL.md, eqs. 5 to 7, 13 and 23).

One loop serves all methods, by static flags. A plain sweep visits all pairs, one at a time, and starts from
their corrections. A sweep `ahead` visits the working set, four pairs at a time. It starts from the
extrapolated corrections y, over-relaxes without friction, and sums the change of phi (momentum.py). With
friction, a visit corrects the normal velocity and then the slip velocity. These velocities are independent in
a contact of discs, except for Coulomb's bound, so one visit solves the contact exactly. With rolling
friction, a visit finally corrects the rolling speed.

Plain sweeps monitor the grains of large corrections (verlet.py) after each block of pairs. A processor cannot
predict whether a correction is large, so a test after each pair would cost as much as the correction.
"""

import warp as wp

from .. import law
from ..access import at, bodies_of, checked, contact_at, larger, lowest_bit
from ..contacts import EQUAL_RIMS
from ..record import Scene, has_weights
from ..search.verlet import least_monitored_correction, monitor
from ..types import ContactsByRef, Correction, Vectors
from .lanes import FOUR, end_of_fours, lanes, records
from .momentum import ENOUGH, relaxation_factor

f64 = wp.float64
BLOCK = wp.constant(64)  # pairs that a thread corrects before it monitors the grains of large corrections
KEPT = wp.constant(2 * BLOCK + 8)  # velocities per thread: two per pair, and a gap wider than a cache line
NONE, ONE = wp.constant(wp.uint64(0)), wp.constant(wp.uint64(1))


@wp.func_native(
    checked("""
#if defined(__CUDA_ARCH__)
    return velocity.data[i];
#else
    return kept.data[k];
#endif
""")
)
def kept_velocity(kept: Vectors, k: int, velocity: Vectors, i: int) -> wp.vec2d:
    """Return the velocity that grain i had just after the correction of its pair: kept[k] on a CPU.

    On a GPU, it is velocity[i], because no other pair of the set changes grain i.
    """
    ...


def sweeping_pairs(
    count: int, weighted: bool, friction: bool, resists_rolling: bool, ahead: bool
) -> wp.Function:
    """Return the function `(scene, contacts, begin, end, kept)` that corrects pairs, `count` at a time.

    It returns a triple (largest change of a correction [m/s], both sums of momentum.py, 0 in a plain sweep),
    and a mask of the pairs with a large change, the last pair in the lowest bit. Only a plain sweep has a
    mask; it also saves the velocities of the pairs in `kept_velocity`, from index `kept` on. `weighted`:
    masses differ. `ahead`: the sweep is accelerated.
    """
    several = lanes(count, weighted, friction, resists_rolling, keep=not ahead)
    vector, pair_changes, pair_shares = records(count)
    numbers_at, set_numbers = several.numbers_at, several.set_numbers
    sum_of, product_of, larger_of = several.sum_of, several.product_of, several.larger_of
    approach, gap_rates, slip, push = several.approach, several.gap_rates, several.slip, several.push
    roll = several.roll

    @wp.func
    def bounded(correction: Correction, c: int, beta: f64, speed: vector, inverse_k: vector, bound: vector):
        """Correct dv_t or dv_r of pairs by speed * inverse_k, clamped so that it is at most `bound` in size.

        Returns the changes, and their terms of both sums of momentum.py, as vectors with a number for each
        pair.
        """
        x = numbers_at(correction.now, c)
        y, step, change, wide = x, vector(), vector(), vector()
        if wp.static(ahead):
            step = beta * (x - numbers_at(correction.last, c))
            y = x + step
            set_numbers(correction.last, c, x)
        for k in range(wp.static(count)):
            change[k] = law.tangential_change(inverse_k[k] * speed[k], y[k], bound[k])
            if wp.static(ahead):
                wide[k] = change[k] / inverse_k[k]
        set_numbers(correction.now, c, y + change)
        return change, product_of(wide, change), product_of(wide, step + change)

    @wp.func
    def sweep(s: Scene, contacts: ContactsByRef, begin: int, end: int, kept: int):
        velocity = s.grains.next_velocity  # assigned one by one: a tuple is read again for every pair
        rim = s.grains.next_rim
        pairs = contacts.contact
        dvs = contacts.dv.now
        last_dvs = contacts.dv.last
        dvts = contacts.dvt
        dvrs = contacts.dvr
        roll_weights = contacts.roll_weights
        weights = contacts.weights
        rim_weights = contacts.rim_weights
        masses = s.working.mass
        kept_v = s.partial.kept_velocity
        beta, mu, omega = s.momentum.beta, f64(s.friction), f64(1.0)
        mu_r = f64(s.rolling_friction)
        if wp.static(ahead and not friction):
            omega = relaxation_factor(s)
        large, half, one = least_monitored_correction(s), f64(0.5), f64(1.0)
        mass, inverse_kt = vector(half), vector(EQUAL_RIMS[0])  # by unit mass where all are equal
        shares = pair_shares()
        shares.rim_i = vector(one)
        shares.rim_j = vector(one)
        zeta, cost, slope, bits = vector(), vector(), vector(), wp.uint64(0)
        c = int(begin)
        while c < end:
            slot = kept + 2 * (c - begin)
            if wp.static(weighted):
                for k in range(wp.static(count)):
                    share = at(weights, c + k)
                    shares.i[k] = share[0]
                    shares.j[k] = share[1]
                    if wp.static(ahead):
                        mass[k] = at(masses, c + k)
                    if wp.static(friction):
                        rims = at(rim_weights, c + k)
                        inverse_kt[k] = rims[0]
                        shares.rim_i[k] = rims[1]
                        shares.rim_j[k] = rims[2]
            x = numbers_at(dvs, c)
            y, step = x, vector()
            if wp.static(ahead):
                step = beta * (x - numbers_at(last_dvs, c))
                y = x + step
            gap_rate, vn = gap_rates(pairs, c), approach(velocity, pairs, c)
            excess = vn - gap_rate
            dv, dvt, dvr = vector(), vector(), vector()
            for k in range(wp.static(count)):
                if wp.static(ahead and not friction):
                    dv[k] = law.normal_change(omega * excess[k], y[k], f64(0.0))
                else:
                    dv[k] = law.normal_change(vn[k], y[k], gap_rate[k])
            change = wp.abs(dv)
            if wp.static(friction):
                vt = slip(velocity, rim, pairs, c)
                dvt, size, rise = bounded(dvts, c, beta, vt, inverse_kt, mu * (y + dv))
                change = larger_of(change, wp.abs(dvt))
                if wp.static(ahead):
                    cost = sum_of(cost, product_of(mass, sum_of(product_of(dv, dv), size)))
                    slope = sum_of(slope, product_of(mass, rise))
            elif wp.static(ahead):
                gain = product_of(dv, excess - half * dv)
                cost = sum_of(cost, product_of(mass, product_of(gap_rate, step) - ENOUGH * gain))
            if wp.static(resists_rolling):
                bound, inverse_kr = mu_r * (y + dv), vector()
                if (
                    wp.static(ahead) or bound[0] > f64(0.0) or at(dvrs.now, c) != f64(0.0)
                ):  # otherwise dvr = 0
                    for k in range(wp.static(count)):
                        own = at(roll_weights, c + k)
                        shares.part[k] = own[0]
                        inverse_kr[k] = own[1]
                    vr = roll(rim, pairs, c, dvt, shares)
                    dvr, size_r, rise_r = bounded(dvrs, c, beta, vr, inverse_kr, bound)
                    change = larger_of(change, wp.abs(dvr))
                    if wp.static(ahead):
                        cost = sum_of(cost, product_of(mass, size_r))
                        slope = sum_of(slope, product_of(mass, rise_r))
            changes = pair_changes()
            changes.dv = dv
            changes.dvt = dvt
            changes.dvr = dvr
            push(velocity, rim, pairs, c, changes, shares, kept_v, slot)
            set_numbers(dvs, c, y + dv)
            zeta = larger_of(zeta, change)
            if wp.static(ahead):
                set_numbers(last_dvs, c, x)
                slope = sum_of(slope, product_of(mass, product_of(dv, step + dv)))
            else:
                bits = (bits << ONE) | wp.where(change[0] > large, ONE, NONE)
            c += wp.static(count)
        total = wp.vec3d()
        for k in range(wp.static(count)):
            total = wp.vec3d(larger(total[0], zeta[k]), total[1] + cost[k], total[2] - slope[k])
        return total, bits

    return sweep


@wp.func
def monitor_block(s: Scene, begin: int, end: int, k: int, bits: wp.uint64):
    """Monitor both grains of each pair in [begin, end) whose bit is set in the mask of `sweeping_pairs`.

    Their velocities after the corrections are in `kept_velocity`, from index k on.
    """
    velocity, contact, kept = s.grains.next_velocity, s.contacts.contact, s.partial.kept_velocity
    left = bits
    while left != NONE:
        c = end - 1 - lowest_bit(left)
        left = left & (left - ONE)
        i, j = bodies_of(contact_at(contact, c))
        slot = k + 2 * (c - begin)
        monitor(s, i, kept_velocity(kept, slot, velocity, i))
        monitor(s, j, kept_velocity(kept, slot + 1, velocity, j))


def sweeping_any_pairs(count: int, friction: bool, resists_rolling: bool, ahead: bool) -> wp.Function:
    """Return a function like that of `sweeping_pairs`, which is weighted if the scene has weights."""
    equal, weighted = (
        sweeping_pairs(count, flag, friction, resists_rolling, ahead) for flag in (False, True)
    )

    @wp.func
    def sweep_pairs(s: Scene, contacts: ContactsByRef, begin: int, end: int, kept: int):
        if has_weights(s):
            return weighted(s, contacts, begin, end, kept)
        return equal(s, contacts, begin, end, kept)

    return sweep_pairs


def sweeping_in_fours(friction: bool, resists_rolling: bool) -> wp.Function:
    """Return the function `(scene, contacts, begin, end, kept)` that corrects pairs in an accelerated sweep.

    It returns (largest change of a correction [m/s], both sums of momentum.py).
    """
    fours, ones = (sweeping_any_pairs(count, friction, resists_rolling, ahead=True) for count in (FOUR, 1))

    @wp.func
    def sweep_pairs(s: Scene, contacts: ContactsByRef, begin: int, end: int, kept: int) -> wp.vec3d:
        rest = end_of_fours(begin, end)
        four, _ = fours(s, contacts, begin, rest, kept)
        one, _ = ones(s, contacts, rest, end, kept)
        return wp.vec3d(larger(four[0], one[0]), four[1] + one[1], four[2] + one[2])

    return sweep_pairs


def sweeping_in_blocks(friction: bool, resists_rolling: bool) -> wp.Function:
    """Return the function `(scene, contacts, begin, end, kept)` that corrects pairs in a plain sweep.

    It returns (largest change of a correction [m/s], 0, 0). After each block of pairs, it monitors the grains
    with large corrections. For this, it saves the velocities of the block's pairs in `kept_velocity`, from
    index `kept` on.
    """
    sweep_block = sweeping_any_pairs(1, friction, resists_rolling, ahead=False)

    @wp.func
    def sweep_pairs(s: Scene, contacts: ContactsByRef, begin: int, end: int, kept: int) -> wp.vec3d:
        zeta = f64(0.0)
        c = int(begin)
        while c < end:
            stop = wp.min(c + BLOCK, end)
            total, bits = sweep_block(s, contacts, c, stop, kept)
            zeta = larger(zeta, total[0])
            monitor_block(s, c, stop, kept, bits)
            c = stop
        return wp.vec3d(zeta, f64(0.0), f64(0.0))

    return sweep_pairs
