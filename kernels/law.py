"""The law of grains as pure functions of numbers, to be compared with MODEL.md line by line."""

import warp as wp

f64 = wp.float64


@wp.func
def free_velocity(v: wp.vec2d, gravity: wp.vec2d, drag: f64, mass: f64, dt: f64) -> wp.vec2d:
    """Velocity after Newton's law, without contacts [m/s] (eq. 2)."""
    return v + dt * (gravity - (drag / mass) * v)


@wp.func
def leapfrog_velocity(
    v: wp.vec2d, gravity: wp.vec2d, drag: f64, mass: f64, dt: f64, staggered: bool
) -> wp.vec2d:
    """The same in the middle of the step (eqs. 16, 17); a `staggered` v is of the middle of the last one."""
    a = drag * dt / (f64(2.0) * mass)
    kicked = v + (f64(0.5) * dt) * gravity
    if staggered:
        kicked = (f64(1.0) - a) * v + dt * gravity
    return kicked / (f64(1.0) + a)


@wp.func
def turned_gravity(start: wp.vec2d, rate: f64, time: f64) -> wp.vec2d:
    """Gravity at a time, of `start` at time 0, that turns at a rate [rad/s] (eq. 31)."""
    c, s = wp.cos(rate * time), wp.sin(rate * time)
    return wp.vec2d(c * start[0] - s * start[1], s * start[0] + c * start[1])


@wp.func
def distance(tail: wp.vec2d, head: wp.vec2d) -> f64:
    """Distance of two points [m]."""
    d = head - tail
    return wp.sqrt(d[0] * d[0] + d[1] * d[1])


@wp.func
def nearest_image(d: wp.vec2d, period: wp.vec2d) -> wp.vec2d:
    """Return the shortest of a way and its periodic images [m] (eq. 36); a period of 0 has none."""
    x, y = d[0], d[1]
    if period == wp.vec2d():  # else a processor divides by both before it tests them
        return d
    if period[0] > f64(0.0):
        x -= period[0] * wp.rint(x / period[0])
    if period[1] > f64(0.0):
        y -= period[1] * wp.rint(y / period[1])
    return wp.vec2d(x, y)


@wp.func
def normal(tail: wp.vec2d, head: wp.vec2d):
    """Unit normal from tail to head, and their distance [m] (eq. 4)."""
    d = head - tail
    length = distance(tail, head)
    return wp.vec2d(d[0] / length, d[1] / length), length


@wp.func
def pair_gap(distance: f64, radius_i: f64, radius_j: f64) -> f64:
    """Free distance between two grains [m] (eq. 4)."""
    return distance - (radius_i + radius_j)


@wp.func
def normal_change(vn: f64, dvc: f64, gap_rate: f64) -> f64:
    """Change dv of the correction dv_c of a pair, or of a side of a wall [m/s] (eq. 6).

    gap_rate = gap / dt closes the gap in a step.
    """
    return wp.max(f64(0.0), vn + dvc - gap_rate) - dvc


@wp.func
def projection(vn: f64, dv: f64, gap_rate: f64, back_rate: f64) -> f64:
    """dv_c that a contact with a wall needs to keep clear of both sides of it [m/s] (eq. 8).

    back_rate is gap / dt on the other side, where dv_c < 0 pushes; inf where there is no other side.
    """
    return wp.max(f64(0.0), vn + dv - gap_rate) - wp.max(f64(0.0), -vn - dv - back_rate)


@wp.func
def driven_change(excess: f64, dv: f64, compliance: f64) -> f64:
    """Change of the correction of a contact with a driven wall [m/s] (eq. 29); the excess is vn - gap / dt.

    A correction of 1 m/s changes vn, in which the speed of the wall counts, by the compliance.
    """
    return wp.max(f64(0.0), dv + excess / compliance) - dv


@wp.func
def inverse_kt(rim: f64, wall: f64) -> f64:
    """1 / K_t of a contact with a driven wall (eq. 30b), from what rim and wall add to K_t."""
    return f64(1.0) / (f64(1.0) + rim + wall)


@wp.func
def tangent(n: wp.vec2d) -> wp.vec2d:
    """Unit tangent of a contact: its normal, turned by a quarter to the left."""
    return wp.vec2d(-n[1], n[0])


@wp.func
def tangential_change(vt: f64, dvt: f64, bound: f64) -> f64:
    """Change of a contact's tangential correction dv_t [m/s] (eq. 23), whose size is at most the bound.

    vt is the velocity at which the surfaces slip, divided by K_t of eq. 22. So is dv_r changed (eq. 37).
    """
    stuck = dvt + vt
    return wp.where(stuck > bound, bound, wp.where(stuck < -bound, -bound, stuck)) - dvt


@wp.func
def speed_along(v: wp.vec2d, n: wp.vec2d) -> f64:
    """Velocity along a wall of normal n [m/s]."""
    return n[0] * v[1] - n[1] * v[0]


@wp.func
def pair_slip(difference: wp.vec2d, n: wp.vec2d, rim_i: f64, rim_j: f64) -> f64:
    """Velocity vt at which the surfaces of two grains slip [m/s] (eq. 23), from v_i - v_j and their rims."""
    return speed_along(difference, n) + rim_i + rim_j


@wp.func
def wall_slip(v: wp.vec2d, n: wp.vec2d, rim: f64, surface: f64) -> f64:
    """Velocity vt at which a grain slips along a wall whose surface has a speed [m/s] (eq. 23)."""
    return speed_along(v, n) + (rim - surface)


@wp.func
def rolling_part(radius_i: f64, radius_j: f64) -> f64:
    """Part of its rim speed with which grain i rolls on grain j (eq. 37)."""
    return radius_j / (radius_i + radius_j)


@wp.func
def pair_roll(part: f64, rim_i: f64, rim_j: f64) -> f64:
    """Speed vr at which two grains roll on each other [m/s] (eq. 37), from their rims."""
    return part * rim_i - (f64(1.0) - part) * rim_j


@wp.func
def wall_roll(rim: f64, radius: f64, spin: f64) -> f64:
    """Speed vr at which a grain rolls on a wall of a spin [m/s] (eq. 37)."""
    return rim - radius * spin


@wp.func
def round_gap_rate(gap_rate: f64, along: f64, circle: f64) -> f64:
    """Gap / dt at a round wall, for a speed along it [m/s] (eq. 18); circle = A / dt, inf at a tangent."""
    if circle == f64(wp.inf):
        return gap_rate
    root = wp.sqrt(wp.max(f64(0.0), circle * circle - along * along))
    return gap_rate - (circle - root)


@wp.func
def rebound(gap_rate: f64, rate: f64, vn: f64, surface: f64, restitution: f64, least: f64) -> f64:
    """Gap / dt of a contact that may bounce [m/s] (eq. 35).

    vn is its closing speed at the end of the last step, with which it would close a gap of rate dt, and
    surface the speed of a wall along the normal.
    """
    if restitution > f64(0.0) and vn > rate and vn - surface > least:
        return wp.min(rate, surface - restitution * (vn - surface)) + (gap_rate - rate)
    return gap_rate


@wp.func
def mass_share(mass_i: f64, mass_j: f64) -> f64:
    """Part of a pair's correction that grain i takes (eq. 7)."""
    return mass_j / (mass_i + mass_j)


@wp.func
def wall_residual(vn: f64, dv: f64, gap_rate: f64, back_rate: f64) -> f64:
    """Return the natural residual (eq. 12) of a contact with a wall, the larger of two sides [m/s]."""
    front = normal_change(vn, wp.max(dv, f64(0.0)), gap_rate)
    back = normal_change(-vn, wp.max(-dv, f64(0.0)), back_rate)
    return wp.max(wp.abs(front), wp.abs(back))


@wp.func
def wall_cost(dv: f64, gap_rate: f64, back_rate: f64) -> f64:
    """The linear part of phi (eq. 14) of a contact with a wall, by unit mass [m2/s2].

    Where there is no other side it is linear throughout: momentum may lead to dv < 0 for a moment.
    """
    back = wp.where(back_rate < f64(wp.inf), back_rate, -gap_rate)
    return wp.where(dv >= f64(0.0), dv * gap_rate, -dv * back)
