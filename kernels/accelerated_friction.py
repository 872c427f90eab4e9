"""Accelerated sweeps with friction: capped momentum around a sweep of normal and tangential corrections.

With friction a step is no minimization, so that no objective can judge a sweep (eq. 14), and none is
rejected. Without that safeguard, momentum with beta near 1 diverges, and over-relaxation does at any beta. So
sweeps do not go too far here, beta is capped, and momentum stops where the change of a sweep, squared and
summed in the mass metric, has grown: of 80 states of 300 and 1,000 grains with mu from 0.1 to 1, none was
left with more than 1.5 times the residual of 200 plain sweeps, and half with less than 1 / 2.3 of it. It
still stops where it points uphill, in the mass metric of both corrections. Steps that momentum keeps from
converging get on by plain sweeps, so that the cap falls after 500 sweeps.
"""

import warp as wp

from . import law
from .accelerated import correcting_working_sets, in_fours
from .access import at, larger, put, working_first_of, working_normal_of, working_second_of
from .contacts import limits_at, surface_of
from .driven import correct_wall
from .friction import THIRD, rim_weights
from .lanes import lanes
from .momentum import mass_in_phi
from .record import Scene, pair_count

f64 = wp.float64


def sweeping_pairs(count: int, weighted: bool) -> wp.Function:
    """Return the function that corrects pairs of the working set from y, in place, `count` at a time.

    It takes `(scene, begin, end)` and returns the largest change of a correction, the changes squared and
    summed, and the slope.
    """
    several = lanes(count)
    vector, numbers_at, set_numbers = several.vector, several.numbers_at, several.set_numbers
    sum_of, product_of, larger_of = several.sum_of, several.product_of, several.larger_of
    approach, slip, push_and_turn = several.approach, several.slip, several.push_and_turn

    @wp.func
    def weights_of(s: Scene, c: int):
        """Return the parts that grains and rims of i and j take, 1 / K_t, K_t and mu_c."""
        share_i, share_j, mu = vector(), vector(), vector()
        rim_i, rim_j, narrow, wide = vector(), vector(), vector(), vector()
        for k in range(wp.static(count)):
            weight = at(s.working.weights, c + k)
            share_i[k] = weight[0]
            share_j[k] = weight[1]
            mu[k] = weight[2]
            part = at(s.contacts.rim_weights, at(s.working.index, c + k))
            narrow[k] = part[0]
            wide[k] = f64(1.0) / part[0]
            rim_i[k] = part[1]
            rim_j[k] = part[2]
        return share_i, share_j, rim_i, rim_j, narrow, wide, mu

    @wp.func
    def sweep(s: Scene, begin: int, end: int):
        grains, working = s.grains, s.working
        beta, friction = s.momentum.state.beta, f64(s.friction)
        half, one = f64(0.5), f64(1.0)
        share_i, share_j, mu = vector(half), vector(half), vector(half)  # by unit mass where all are equal
        rim_i, rim_j, narrow, wide = vector(one), vector(one), vector(THIRD), vector(f64(3.0))
        zeta, size, slope = vector(), vector(), vector()
        c = int(begin)
        while c < end:
            if wp.static(weighted):
                share_i, share_j, rim_i, rim_j, narrow, wide, mu = weights_of(s, c)
            x, xt = numbers_at(working.dv, c), numbers_at(working.dvt, c)
            ahead = beta * (x - numbers_at(working.last_dv, c))
            ahead_t = beta * (xt - numbers_at(working.last_dvt, c))
            y, yt = x + ahead, xt + ahead_t
            excess = approach(grains.next_velocity, working.contact, c) - numbers_at(working.gap_rate, c)
            vt = slip(grains.next_velocity, grains.next_rim, working.contact, c)
            dv, dvt = vector(), vector()
            for k in range(wp.static(count)):
                dv[k] = law.normal_change(excess[k], y[k], f64(0.0))
            for k in range(wp.static(count)):
                dvt[k] = law.tangential_change(narrow[k] * vt[k], yt[k], friction * (y[k] + dv[k]))
            push_and_turn(
                grains.next_velocity,
                grains.next_rim,
                working.contact,
                c,
                dv,
                dvt,
                share_i,
                share_j,
                rim_i,
                rim_j,
            )
            set_numbers(working.last_dv, c, x)
            set_numbers(working.last_dvt, c, xt)
            set_numbers(working.dv, c, y + dv)
            set_numbers(working.dvt, c, yt + dvt)
            zeta = larger_of(zeta, larger_of(larger_of(dv, -dv), larger_of(dvt, -dvt)))
            wide_dvt = product_of(wide, dvt)
            downhill = sum_of(product_of(dv, ahead + dv), product_of(wide_dvt, ahead_t + dvt))
            slope = sum_of(slope, product_of(mu, downhill))
            size = sum_of(size, product_of(mu, sum_of(product_of(dv, dv), product_of(wide_dvt, dvt))))
            c += wp.static(count)
        total = wp.vec3d()
        for k in range(wp.static(count)):
            total = wp.vec3d(larger(total[0], zeta[k]), total[1] + size[k], total[2] - slope[k])
        return total

    return sweep


sweep_pairs = in_fours(sweeping_pairs)


def sweeping_walls(driven: bool) -> wp.Function:
    """Return the function that corrects contacts with walls from y, and returns what `sweeping_pairs` does.

    `driven`: a force drives one of the walls.
    """

    @wp.func(inline=not driven)
    def sweep_walls(s: Scene, begin: int, end: int) -> wp.vec3d:
        velocity = s.grains.next_velocity  # assigned one by one: a tuple is read again for every contact
        rim = s.grains.next_rim
        working = s.working
        beta = s.momentum.state.beta
        first_wall = pair_count(s)
        total = wp.vec3d()
        c = int(begin)
        while c < end:
            i, normal = working_first_of(working.contact, c), working_normal_of(working.contact, c)
            surface = surface_of(s, at(working.index, c))
            part = rim_weights(s, at(working.index, c), True)
            v, u, t = at(velocity, i), at(rim, i), law.tangent(normal)
            x, xt = at(working.dv, c), at(working.dvt, c)
            y = x + beta * (x - at(working.last_dv, c))
            yt = xt + beta * (xt - at(working.last_dvt, c))
            if wp.static(driven):
                j = working_second_of(working.contact, c)
                found = correct_wall(s, velocity, i, j, normal, y, at(working.gap_rate, c), f64(1.0))
                dv, wide_dv = found[0], found[1] * found[0]
            else:
                limit = limits_at(working.limits, c - first_wall)[1]
                gap = law.round_gap_rate(at(working.gap_rate, c), law.speed_along(v, normal), limit)
                dv = law.normal_change(wp.dot(v, normal), y, gap)
                wide_dv = dv
            vt = law.wall_slip(v, normal, u, surface[1])
            dvt = law.tangential_change(part[0] * vt, yt, surface[0] * (y + dv))
            put(velocity, i, v - (dv * normal + dvt * t))
            put(rim, i, u - dvt * part[1])
            put(working.last_dv, c, x)
            put(working.last_dvt, c, xt)
            put(working.dv, c, y + dv)
            put(working.dvt, c, yt + dvt)
            mu, wide_dvt = mass_in_phi(s, i), dvt / part[0]
            zeta = larger(total[0], larger(wp.abs(wide_dv), wp.abs(dvt)))
            size = total[1] + mu * (wide_dv * dv + wide_dvt * dvt)
            total = wp.vec3d(
                zeta, size, total[2] - mu * (wide_dv * (y + dv - x) + wide_dvt * (yt + dvt - xt))
            )
            c += 1
        return total

    return sweep_walls


sweep_walls, sweep_driven_walls = sweeping_walls(False), sweeping_walls(True)
sweep_ahead_with_friction = correcting_working_sets(
    "sweep_ahead_with_friction", sweep_pairs, sweep_walls, sweep_driven_walls
)
