"""Accelerated Gauss-Seidel: momentum around a sweep that goes a little too far.

A sweep is coordinate descent on the dual objective of the step (MODEL.md, eq. 14),

    phi = 1/2 sum_i M_i |v_i|^2 + sum_c mu_c dv_c gap_c / dt,    mu_c = M_i M_j / (M_i + M_j), M_i at a wall.

Between two sweeps, corrections x and velocities go on along the line from the last ones,
y = x + beta (x - last), with beta = (t - 1) / t', t' = (1 + sqrt(1 + 4 t^2)) / 2 (Nesterov 1983; eq. 13).
With beta grows the over-relaxation of the sweep (Young 1954). Here is the sweep from y, with what it has done
to phi; restart.py accepts or rejects it, stops momentum, and goes on.

Only the working set is swept (working_set.py).
"""

import warp as wp

from . import law
from .access import at, larger, put, read_wall, set_wall_dv, wall_dv_at
from .chunks import CHUNK, chunks_in, part_count, wall_part_count
from .lanes import FOUR, end_of_fours, lanes
from .record import Scene, grain_count, pair_count, wall_count
from .threads import Team, keep_largest, thread_range
from .types import Contacts, Grains, WorkingSet
from .walls import WallContact, has_inner, outer_gap_rate, wall_cost, wall_projection

f64 = wp.float64
ENOUGH = wp.constant(f64(0.99))  # part of its own decrease of phi that a sweep must keep
RELAXATION = wp.constant(f64(0.25))  # by how much a sweep goes too far at beta = 1, at first


@wp.func
def mass_in_phi(grains: Grains, contacts: Contacts, i: int) -> f64:
    """Return the contact mass of a grain; where all masses are equal, phi is by unit mass."""
    if contacts.weights.shape[0] > 0:
        return at(grains.contact_mass, i)
    return f64(1.0)


@wp.func
def relaxation_factor(s: Scene) -> f64:
    """How many times its own correction a contact is given."""
    return f64(1.0) + s.momentum.state.relaxation * s.momentum.state.beta


def sweeping(count: int, weighted: bool) -> wp.Function:
    """Return the function that corrects working pairs from y, in place, so many at a time (lanes.py).

    It takes `(scene, begin, end)` and returns the largest |dv|, the cost in phi less the gain, and the slope.
    """
    several = lanes(count)
    vector, numbers_at, set_numbers = several.vector, several.numbers_at, several.set_numbers
    sum_of, product_of, larger_of = several.sum_of, several.product_of, several.larger_of
    approach, push_apart = several.approach, several.push_apart

    @wp.func
    def shares_of(working: WorkingSet, c: int):
        """Parts of the corrections that grains i and j take, and mu_c."""
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
            x = numbers_at(working.pair_dv, c)
            ahead = beta * (x - numbers_at(working.pair_last, c))
            y = x + ahead
            excess = approach(grains.next_velocity, working.pairs, c) - gap_rate
            dv = vector()
            for k in range(wp.static(count)):
                dv[k] = law.pair_correction(factor * excess[k], y[k], f64(0.0))
            zeta = larger_of(zeta, larger_of(dv, -dv))
            push_apart(grains.next_velocity, working.pairs, c, dv, share_i, share_j)
            set_numbers(working.pair_last, c, x)
            set_numbers(working.pair_dv, c, y + dv)
            gain = product_of(dv, excess - half * dv)
            rise = sum_of(rise, product_of(mu, product_of(gap_rate, ahead) - ENOUGH * gain))
            slope = sum_of(slope, product_of(mu, product_of(dv, ahead + dv)))
            c += wp.static(count)
        total = wp.vec3d()
        for k in range(wp.static(count)):
            total = wp.vec3d(larger(total[0], zeta[k]), total[1] + rise[k], total[2] - slope[k])
        return total

    return sweep


sweep_four, sweep_one = sweeping(FOUR, False), sweeping(1, False)
sweep_four_weighted, sweep_one_weighted = sweeping(FOUR, True), sweeping(1, True)


@wp.func
def correct_wall(s: Scene, c: int, beta: f64, relaxation: f64) -> wp.vec3d:
    """One grain's wall correction from y, in place. Returns |dv|, cost in phi less gain, slope."""
    wall = WallContact()
    read_wall(s.working.walls, c, wall)
    v = at(s.grains.next_velocity, wall.i)
    inner = has_inner(s.walls)
    y = wall.dv + beta * (wall.dv - at(s.working.wall_last, c))
    vn = wp.dot(v, wall.n)
    gap_out = outer_gap_rate(wall, v, s.walls)
    gap_in = wp.where(inner, wall.gap_rate_in, -gap_out)  # so that the cost is linear without an inner wall
    new = wall_projection(relaxation * vn, y, relaxation * gap_out, relaxation * gap_in, inner)
    dv = new - y
    put(s.grains.next_velocity, wall.i, v - dv * wall.n)
    put(s.working.wall_last, c, wall.dv)
    set_wall_dv(s.working.walls, c, new)
    cost_y = wall_cost(y, gap_out, gap_in)
    gain = dv * (vn - f64(0.5) * dv) - (wall_cost(new, gap_out, gap_in) - cost_y)
    rise = cost_y - wall_cost(wall.dv, gap_out, gap_in) - ENOUGH * gain
    mu = mass_in_phi(s.grains, s.contacts, wall.i)
    return wp.vec3d(wp.abs(dv), mu * rise, -mu * dv * (new - wall.dv))


@wp.func
def sweep_pairs_ahead(team: Team, s: Scene, k: int):
    """Correct the working pairs of a set, four at a time and then those that are left."""
    zeta = f64(0.0)
    weighted = s.working.weights.shape[0] > 0
    set_begin, set_end = at(s.contacts.set_start, k), at(s.contacts.set_start, k + 1)
    first, last = thread_range(team, set_begin // CHUNK, chunks_in(set_end))
    for chunk in range(first, last):
        four, one = wp.vec3d(), wp.vec3d()
        bounds = at(s.working.pair_range, chunk + k)
        rest = end_of_fours(bounds[0], bounds[1])
        if weighted:
            four = sweep_four_weighted(s, bounds[0], rest)
            one = sweep_one_weighted(s, rest, bounds[1])
        else:
            four = sweep_four(s, bounds[0], rest)
            one = sweep_one(s, rest, bounds[1])
        put(s.momentum.pair_part, chunk + k, wp.vec2d(four[1] + one[1], four[2] + one[2]))
        zeta = larger(zeta, larger(four[0], one[0]))
    keep_largest(team, s.partial.zeta, zeta)


@wp.func
def sweep_walls_ahead(team: Team, s: Scene):
    """Correct the working wall contacts."""
    zeta = f64(0.0)
    beta = s.momentum.state.beta
    relaxation = relaxation_factor(s)
    first, last = thread_range(team, 0, wall_part_count(s))
    for chunk in range(first, last):
        part = wp.vec2d(f64(0.0), f64(0.0))
        bounds = at(s.working.wall_range, chunk)
        c = int(bounds[0])
        while c < bounds[1]:
            result = correct_wall(s, c, beta, relaxation)
            part = part + wp.vec2d(result[1], result[2])
            zeta = larger(zeta, result[0])
            c += 1
        put(s.momentum.wall_part, chunk, part)
    keep_largest(team, s.partial.zeta, zeta)


@wp.func
def begin_momentum(team: Team, s: Scene):
    """Nothing is selected yet; start without momentum, or go on with it."""
    nothing = wp.vec2i(0, 0)
    first, last = thread_range(team, 0, part_count(s))
    for k in range(first, last):
        put(s.momentum.pair_part, k, wp.vec2d(f64(0.0), f64(0.0)))
        put(s.working.pair_range, k, nothing)
    first, last = thread_range(team, 0, wall_part_count(s))
    for k in range(first, last):
        put(s.working.wall_range, k, nothing)
    if s.control.resuming != 0:
        return
    i, last = thread_range(team, 0, grain_count(s))
    while i < last:
        put(s.momentum.last_velocity, i, at(s.grains.next_velocity, i))
        i += 1
    c, last = thread_range(team, 0, pair_count(s))
    while c < last:
        put(s.momentum.pair_last, c, at(s.contacts.pair_dv, c))
        c += 1
    c, last = thread_range(team, 0, wall_count(s))
    while c < last:
        put(s.momentum.wall_last, c, wall_dv_at(s.contacts.walls, c))
        c += 1
    if team.rank == 0:
        s.momentum.state.t = f64(1.0)
        s.momentum.state.beta = f64(0.0)
        s.momentum.state.relaxation = RELAXATION
