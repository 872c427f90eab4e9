"""Accelerated Gauss-Seidel: momentum around a sweep that goes a little too far.

A sweep is coordinate descent on the dual objective of the step (MODEL.md, eq. 14),

    phi = 1/2 sum_i m_i |v_i|^2 + sum_c mu_c dv_c gap_c / dt,    mu_c = m_i m_j / (m_i + m_j), m_i at a wall.

Between two sweeps, corrections x and velocities go on along the line from the last ones,
y = x + beta (x - last), with beta = (t - 1) / t', t' = (1 + sqrt(1 + 4 t^2)) / 2 (Nesterov 1983; eq. 13).
With beta grows the over-relaxation of the sweep (Young 1954). Here is the sweep from y, with what it has done
to phi; restart.py accepts or rejects it, stops momentum, and goes on.

Only the working set is swept (working_set.py).
"""

import warp as wp

from . import law
from .access import (
    first_of,
    gap_rate_of,
    larger,
    normal_of,
    number_at,
    read_wall,
    second_of,
    set_number,
    set_vector,
    set_wall_dv,
    vector_at,
)
from .chunks import CHUNK, chunks_in, part_count, wall_part_count
from .record import Scene, grain_count, pair_count, wall_count
from .threads import Team, partial_index, thread_range
from .types import Contacts, Grains, Vectors, WorkingSet
from .walls import WallContact, has_inner, outer_gap_rate, wall_cost, wall_projection

f64 = wp.float64
ENOUGH = wp.constant(f64(0.99))  # part of its own decrease of phi that a sweep must keep
RELAXATION = wp.constant(f64(0.25))  # by how much a sweep goes too far at beta = 1, at first


@wp.func
def mass_in_phi(grains: Grains, contacts: Contacts, i: int) -> f64:
    """Mass of a grain; where all masses are equal, phi is by unit mass."""
    if contacts.weights.shape[0] > 0:
        return grains.mass[i]
    return f64(1.0)


@wp.func
def relaxation_factor(s: Scene) -> f64:
    """How many times its own correction a contact is given."""
    return f64(1.0) + s.momentum.state.relaxation * s.momentum.state.beta


@wp.func
def correct_pair(
    velocity: Vectors, working: WorkingSet, c: int, shares: wp.vec3d, momentum: wp.vec2d
) -> wp.vec3d:
    """One pair's correction from y, in place. Returns |dv|, cost in phi less gain, slope.

    `shares` are those of the grains and mu_c, `momentum` is beta and the over-relaxation.
    """
    i = first_of(working.pairs, c)
    j = second_of(working.pairs, c)
    n = normal_of(working.pairs, c)
    gap_rate = gap_rate_of(working.pairs, c)
    x = number_at(working.pair_dv, c)
    ahead = momentum[0] * (x - number_at(working.pair_last, c))
    vi = vector_at(velocity, i)
    vj = vector_at(velocity, j)
    excess = wp.dot(vi - vj, n) - gap_rate
    dv = law.pair_correction(momentum[1] * excess, x + ahead, f64(0.0))
    set_vector(velocity, i, vi - dv * n * shares[0])
    set_vector(velocity, j, vj + dv * n * shares[1])
    set_number(working.pair_last, c, x)
    set_number(working.pair_dv, c, x + ahead + dv)
    rise = gap_rate * ahead - ENOUGH * dv * (excess - f64(0.5) * dv)
    return wp.vec3d(wp.abs(dv), shares[2] * rise, -shares[2] * dv * (ahead + dv))


@wp.func
def shares_of(grains: Grains, working: WorkingSet, c: int) -> wp.vec3d:
    """Parts of a pair's correction that its grains take, and mu_c."""
    weight = vector_at(working.weights, c)
    mass = number_at(grains.mass, first_of(working.pairs, c))
    return wp.vec3d(weight[0], weight[1], mass * weight[0])


@wp.func
def correct_wall(s: Scene, c: int, beta: f64, relaxation: f64) -> wp.vec3d:
    """One grain's wall correction from y, in place. Returns |dv|, cost in phi less gain, slope."""
    wall = WallContact()
    read_wall(s.working.walls, c, wall)
    v = vector_at(s.grains.next_velocity, wall.i)
    inner = has_inner(s.walls)
    y = wall.dv + beta * (wall.dv - number_at(s.working.wall_last, c))
    vn = wp.dot(v, wall.n)
    gap_out = outer_gap_rate(wall, v, s.walls)
    gap_in = wp.where(inner, wall.gap_rate_in, -gap_out)  # so that the cost is linear without an inner wall
    new = wall_projection(relaxation * vn, y, relaxation * gap_out, relaxation * gap_in, inner)
    dv = new - y
    set_vector(s.grains.next_velocity, wall.i, v - dv * wall.n)
    set_number(s.working.wall_last, c, wall.dv)
    set_wall_dv(s.working.walls, c, new)
    cost_y = wall_cost(y, gap_out, gap_in)
    gain = dv * (vn - f64(0.5) * dv) - (wall_cost(new, gap_out, gap_in) - cost_y)
    rise = cost_y - wall_cost(wall.dv, gap_out, gap_in) - ENOUGH * gain
    mu = mass_in_phi(s.grains, s.contacts, wall.i)
    return wp.vec3d(wp.abs(dv), mu * rise, -mu * dv * (new - wall.dv))


@wp.func
def sweep_pairs_ahead(team: Team, s: Scene, k: int):
    """Correct the working pairs of a set."""
    zeta = f64(0.0)
    grains, working = s.grains, s.working
    momentum = wp.vec2d(s.momentum.state.beta, relaxation_factor(s))
    weighted = working.weights.shape[0] > 0
    shares = wp.vec3d(f64(0.5), f64(0.5), f64(0.5))  # by unit mass where all masses are equal
    first, last = thread_range(team, s.contacts.set_start[k] // CHUNK, chunks_in(s.contacts.set_start[k + 1]))
    for chunk in range(first, last):
        part = wp.vec2d(f64(0.0), f64(0.0))
        bounds = working.pair_range[chunk + k]
        c = bounds[0]
        while c < bounds[1]:
            if weighted:
                shares = shares_of(grains, working, c)
            result = correct_pair(grains.next_velocity, working, c, shares, momentum)
            part = part + wp.vec2d(result[1], result[2])
            zeta = larger(zeta, result[0])
            c += 1
        s.momentum.pair_part[chunk + k] = part
    wp.atomic_max(s.partial.zeta, partial_index(team, s.partial.zeta.shape[0]), zeta)


@wp.func
def sweep_walls_ahead(team: Team, s: Scene):
    """Correct the working wall contacts."""
    zeta = f64(0.0)
    beta = s.momentum.state.beta
    relaxation = relaxation_factor(s)
    first, last = thread_range(team, 0, wall_part_count(s))
    for chunk in range(first, last):
        part = wp.vec2d(f64(0.0), f64(0.0))
        bounds = s.working.wall_range[chunk]
        for c in range(bounds[0], bounds[1]):
            result = correct_wall(s, c, beta, relaxation)
            part = part + wp.vec2d(result[1], result[2])
            zeta = larger(zeta, result[0])
        s.momentum.wall_part[chunk] = part
    wp.atomic_max(s.partial.zeta, partial_index(team, s.partial.zeta.shape[0]), zeta)


@wp.func
def begin_momentum(team: Team, s: Scene):
    """Nothing is selected yet; start without momentum, or go on with it."""
    nothing = wp.vec2i(0, 0)
    first, last = thread_range(team, 0, part_count(s))
    for k in range(first, last):
        s.momentum.pair_part[k] = wp.vec2d(f64(0.0), f64(0.0))
        s.working.pair_range[k] = nothing
    first, last = thread_range(team, 0, wall_part_count(s))
    for k in range(first, last):
        s.working.wall_range[k] = nothing
    if s.control.resuming != 0:
        return
    first, last = thread_range(team, 0, grain_count(s))
    for i in range(first, last):
        s.momentum.last_velocity[i] = s.grains.next_velocity[i]
    first, last = thread_range(team, 0, pair_count(s))
    for c in range(first, last):
        s.momentum.pair_last[c] = s.contacts.pair_dv[c]
    first, last = thread_range(team, 0, wall_count(s))
    for c in range(first, last):
        s.momentum.wall_last[c] = s.contacts.walls[c].dv
    if team.rank == 0:
        s.momentum.state.t = f64(1.0)
        s.momentum.state.beta = f64(0.0)
        s.momentum.state.relaxation = RELAXATION
