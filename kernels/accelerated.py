"""Accelerated Gauss-Seidel: momentum around a sweep that goes a little too far.

A sweep is coordinate descent on the dual objective of the step (MODEL.md, eq. 14),

    phi = 1/2 sum_i M_i |v_i|^2 + sum_c mu_c dv_c gap_c / dt,    mu_c = M_i M_j / (M_i + M_j), M_i at a wall.

Between two sweeps, corrections x and velocities are extrapolated along the line from the last ones,
y = x + beta (x - last), with beta = (t - 1) / t', t' = (1 + sqrt(1 + 4 t^2)) / 2 (Nesterov 1983; eq. 13).
With beta grows the over-relaxation of the sweep (Young 1954). Here is the sweep from y, with what it has done
to phi; momentum.py accepts or rejects it, and chooses the momentum of the next one.

Only the working set is swept (working_set.py).
"""

from collections.abc import Callable

import warp as wp

from . import law
from .access import at, larger, named, put, working_first_of, working_normal_of, working_second_of
from .contacts import chunks_of_set, is_wall_set, limits_at, range_of_set
from .driven import correct_wall
from .lanes import FOUR, end_of_fours, lanes
from .momentum import mass_in_phi
from .record import Scene, has_weights, is_driven, pair_count
from .threads import Team, update_max
from .types import WorkingSet

f64 = wp.float64
ENOUGH = wp.constant(f64(0.99))  # part of its own decrease of phi that a sweep must keep


@wp.func
def relaxation_factor(s: Scene) -> f64:
    """Return omega: the multiple of its own correction that a contact is given (eq. 13)."""
    return f64(1.0) + s.momentum.state.relaxation * s.momentum.state.beta


def sweeping_pairs(count: int, weighted: bool) -> wp.Function:
    """Return the function that corrects pairs of the working set from y, in place, `count` at a time.

    It takes `(scene, begin, end)` and returns the largest |dv|, the cost in phi less the gain, and the slope.
    """
    several = lanes(count)
    vector, numbers_at, set_numbers = several.vector, several.numbers_at, several.set_numbers
    sum_of, product_of, larger_of = several.sum_of, several.product_of, several.larger_of
    approach, push_apart = several.approach, several.push_apart

    @wp.func
    def shares_of(working: WorkingSet, c: int):
        """Return the parts of the corrections that grains i and j take, and mu_c."""
        share_i, share_j, mu = vector(), vector(), vector()
        for k in range(wp.static(count)):
            weight = at(working.weights, c + k)
            share_i[k] = weight[0]
            share_j[k] = weight[1]
            mu[k] = weight[2]
        return share_i, share_j, mu

    @wp.func
    def sweep(s: Scene, begin: int, end: int):
        grains, working = s.grains, s.working
        beta, factor = s.momentum.state.beta, relaxation_factor(s)
        half = f64(0.5)
        share_i, share_j, mu = vector(half), vector(half), vector(half)  # by unit mass where all are equal
        zeta, rise, slope = vector(), vector(), vector()
        c = int(begin)
        while c < end:
            if wp.static(weighted):
                share_i, share_j, mu = shares_of(working, c)
            gap_rate = numbers_at(working.gap_rate, c)
            x = numbers_at(working.dv, c)
            ahead = beta * (x - numbers_at(working.last_dv, c))
            y = x + ahead
            excess = approach(grains.next_velocity, working.contact, c) - gap_rate
            dv = vector()
            for k in range(wp.static(count)):
                dv[k] = law.normal_change(factor * excess[k], y[k], f64(0.0))
            zeta = larger_of(zeta, larger_of(dv, -dv))
            push_apart(grains.next_velocity, working.contact, c, dv, share_i, share_j)
            set_numbers(working.last_dv, c, x)
            set_numbers(working.dv, c, y + dv)
            gain = product_of(dv, excess - half * dv)
            rise = sum_of(rise, product_of(mu, product_of(gap_rate, ahead) - ENOUGH * gain))
            slope = sum_of(slope, product_of(mu, product_of(dv, ahead + dv)))
            c += wp.static(count)
        total = wp.vec3d()
        for k in range(wp.static(count)):
            total = wp.vec3d(larger(total[0], zeta[k]), total[1] + rise[k], total[2] - slope[k])
        return total

    return sweep


def in_fours(sweeping_pairs: Callable[[int, bool], wp.Function]) -> wp.Function:
    """Return the function that corrects pairs by two of `sweeping_pairs`: in fours, then those left."""
    sweep_four, sweep_one = sweeping_pairs(FOUR, False), sweeping_pairs(1, False)
    sweep_four_weighted, sweep_one_weighted = sweeping_pairs(FOUR, True), sweeping_pairs(1, True)

    @wp.func
    def sweep_pairs(s: Scene, begin: int, end: int) -> wp.vec3d:
        rest = end_of_fours(begin, end)
        four, one = wp.vec3d(), wp.vec3d()
        if has_weights(s):
            four = sweep_four_weighted(s, begin, rest)
            one = sweep_one_weighted(s, rest, end)
        else:
            four = sweep_four(s, begin, rest)
            one = sweep_one(s, rest, end)
        return wp.vec3d(larger(four[0], one[0]), four[1] + one[1], four[2] + one[2])

    return sweep_pairs


sweep_pairs = in_fours(sweeping_pairs)


def sweeping_walls(driven: bool) -> wp.Function:
    """Return the function that corrects contacts with walls from y, in place.

    It returns what that of `sweeping_pairs` does. `driven`: a force drives one of the walls (eq. 29).
    """

    @wp.func(inline=not driven)
    def sweep_walls(s: Scene, begin: int, end: int) -> wp.vec3d:
        velocity = s.grains.next_velocity  # assigned one by one: a tuple is read again for every contact
        working = s.working
        beta = s.momentum.state.beta
        factor = relaxation_factor(s)
        first_wall = pair_count(s)
        total = wp.vec3d()
        c = int(begin)
        while c < end:
            i, n = working_first_of(working.contact, c), working_normal_of(working.contact, c)
            v, gap = at(velocity, i), at(working.gap_rate, c)
            x = at(working.dv, c)
            y = x + beta * (x - at(working.last_dv, c))
            if wp.static(driven):
                j = working_second_of(working.contact, c)
                found = correct_wall(s, velocity, i, j, n, y, gap, factor)
                dv, compliance = found[0], found[1]
                new = y + dv
                gain = dv * (found[2] - f64(0.5) * compliance * dv)
                cost = gap * (y - x)
            else:
                limits, vn, compliance = limits_at(working.limits, c - first_wall), wp.dot(v, n), f64(1.0)
                gap = law.round_gap_rate(gap, law.speed_along(v, n), limits[1])
                new = law.projection(factor * vn, y, factor * gap, factor * limits[0])
                dv = new - y
                cost_y = law.wall_cost(y, gap, limits[0])
                gain = dv * (vn - f64(0.5) * dv) - (law.wall_cost(new, gap, limits[0]) - cost_y)
                cost = cost_y - law.wall_cost(x, gap, limits[0])
            put(velocity, i, v - dv * n)
            put(working.last_dv, c, x)
            put(working.dv, c, new)
            mu = mass_in_phi(s, i)
            zeta, wide_dv = larger(total[0], compliance * wp.abs(dv)), compliance * dv
            rise = total[1] + mu * (cost - ENOUGH * gain)
            total = wp.vec3d(zeta, rise, total[2] - mu * wide_dv * (new - x))
            c += 1
        return total

    return sweep_walls


sweep_walls, sweep_driven_walls = sweeping_walls(False), sweeping_walls(True)


def correcting_working_sets(
    name: str, sweep_pairs: wp.Function, sweep_walls: wp.Function, sweep_driven_walls: wp.Function
) -> wp.Function:
    """Return the stage that corrects the contacts of a set that are in the working set."""

    @named(name)
    def correct_working_set(team: Team, s: Scene, k: int):
        zeta = f64(0.0)
        begin, end, _, part = chunks_of_set(s, k)
        first, last = range_of_set(team, s, k, begin, end)
        for chunk in range(first, last):
            bounds = at(s.working.range, part + chunk)
            total = wp.vec3d()
            if is_wall_set(s, k):
                if is_driven(s):
                    total = sweep_driven_walls(s, bounds[0], bounds[1])
                else:
                    total = sweep_walls(s, bounds[0], bounds[1])
            else:
                total = sweep_pairs(s, bounds[0], bounds[1])
            put(s.momentum.contact_part, part + chunk, wp.vec2d(total[1], total[2]))
            zeta = larger(zeta, total[0])
        update_max(team, s.partial.zeta, zeta)

    return correct_working_set


sweep_ahead = correcting_working_sets("sweep_ahead", sweep_pairs, sweep_walls, sweep_driven_walls)
