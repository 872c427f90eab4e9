"""The contact law and the laws of motion as pure functions of numbers, each with its equation of MODEL.md."""

import warp as wp

f64 = wp.float64


@wp.func
def free_velocity(v: wp.vec2d, gravity: wp.vec2d, drag: f64, mass: f64, dt: f64) -> wp.vec2d:
    """Return the velocity after a step of Newton's law without contacts [m/s] (eq. 2)."""
    return v + dt * (gravity - (drag / mass) * v)


@wp.func
def leapfrog_velocity(
    v: wp.vec2d, gravity: wp.vec2d, drag: f64, mass: f64, dt: f64, staggered: bool
) -> wp.vec2d:
    """Return the velocity in the middle of the step, without contacts [m/s] (eqs. 16, 17).

    v is the velocity in the middle of the last step if `staggered`, and at the start of this step otherwise.
    """
    a = drag * dt / (f64(2.0) * mass)
    kicked = v + (f64(0.5) * dt) * gravity
    if staggered:
        kicked = (f64(1.0) - a) * v + dt * gravity
    return kicked / (f64(1.0) + a)


@wp.func
def turned_gravity(start: wp.vec2d, rate: f64, time: f64) -> wp.vec2d:
    """Return gravity at a time [s] if it is `start` at time 0 and turns at a rate [rad/s] (eq. 31)."""
    c, s = wp.cos(rate * time), wp.sin(rate * time)
    return wp.vec2d(c * start[0] - s * start[1], s * start[0] + c * start[1])


@wp.func
def distance(tail: wp.vec2d, head: wp.vec2d) -> f64:
    """Return the distance between two points [m]."""
    d = head - tail
    return wp.sqrt(d[0] * d[0] + d[1] * d[1])


@wp.func
def nearest_image(d: wp.vec2d, period: wp.vec2d) -> wp.vec2d:
    """Return the shortest periodic image of the vector d [m] (eq. 36); period 0: not periodic."""
    x, y = d[0], d[1]
    if period == wp.vec2d():  # without this test, a processor divides by both periods before it tests them
        return d
    if period[0] > f64(0.0):
        x -= period[0] * wp.rint(x / period[0])
    if period[1] > f64(0.0):
        y -= period[1] * wp.rint(y / period[1])
    return wp.vec2d(x, y)


@wp.func
def normal(tail: wp.vec2d, head: wp.vec2d):
    """Return the unit normal from tail to head, and the distance between the two points [m] (eq. 4)."""
    d = head - tail
    length = distance(tail, head)
    return wp.vec2d(d[0] / length, d[1] / length), length


@wp.func
def pair_gap(distance: f64, radius_i: f64, radius_j: f64) -> f64:
    """Return the gap between two grains whose centers have this distance [m] (eq. 4)."""
    return distance - (radius_i + radius_j)


@wp.func
def normal_change(vn: f64, dvc: f64, gap_rate: f64) -> f64:
    """Return the change of the correction dv_c of a pair, or of one side of a wall [m/s] (eq. 6).

    gap_rate = gap / dt is the velocity that closes the gap in one step.
    """
    return wp.max(f64(0.0), vn + dvc - gap_rate) - dvc


@wp.func
def projection(vn: f64, dv: f64, gap_rate: f64, back_rate: f64) -> f64:
    """Return the new correction dv_c of a contact with a wall [m/s] (eq. 8), from the present one, dv.

    With it, the grain passes neither side of the wall. back_rate is gap / dt on the other side, which pushes
    with dv_c < 0; it is inf if there is no other side.
    """
    return wp.max(f64(0.0), vn + dv - gap_rate) - wp.max(f64(0.0), -vn - dv - back_rate)


@wp.func
def driven_change(excess: f64, dv: f64, compliance: f64) -> f64:
    """Return the change of the correction of a contact with a driven wall [m/s] (eq. 29).

    The excess is vn - gap / dt. A correction of 1 m/s reduces vn by the compliance, as the wall moves too.
    """
    return wp.max(f64(0.0), dv + excess / compliance) - dv


@wp.func
def inverse_kt(rim: f64, wall: f64) -> f64:
    """Return 1 / K_t = 1 / (1 + rim + wall) of a contact with a driven wall (eq. 30b).

    `rim` is the term of the grain's rotation, k_i, and `wall` that of the wall's speed, g_t h_t.
    """
    return f64(1.0) / (f64(1.0) + rim + wall)


@wp.func
def tangent(n: wp.vec2d) -> wp.vec2d:
    """Return the unit tangent of a contact: the normal, turned counterclockwise by 90 degrees."""
    return wp.vec2d(-n[1], n[0])


@wp.func
def tangential_change(vt: f64, dvt: f64, bound: f64) -> f64:
    """Return the change of the tangential correction dv_t [m/s], after which |dv_t| <= bound (eq. 23).

    The argument vt is the slip velocity of the surfaces, divided by K_t of eq. 22. The same law changes dv_r
    (eq. 37).
    """
    stuck = dvt + vt
    return wp.where(stuck > bound, bound, wp.where(stuck < -bound, -bound, stuck)) - dvt


@wp.func
def tangential_residual(vt: f64, dvt: f64, inverse_k: f64, bound: f64) -> f64:
    """Return the natural residual of dv_t or dv_r for the speed vt or vr [m/s] (eqs. 25 and 38).

    inverse_k is 1 / K_t or 1 / K_r, and bound is the largest |dv_t| or |dv_r| that friction allows.
    """
    return wp.abs(tangential_change(inverse_k * vt, dvt, bound)) / inverse_k


@wp.func
def speed_along(v: wp.vec2d, n: wp.vec2d) -> f64:
    """Return the component of v along the tangent of a contact with normal n [m/s]."""
    return n[0] * v[1] - n[1] * v[0]


@wp.func
def pair_slip(difference: wp.vec2d, n: wp.vec2d, rim_i: f64, rim_j: f64) -> f64:
    """Return the slip velocity vt of the surfaces of two grains [m/s] (eq. 23); difference = v_i - v_j."""
    return speed_along(difference, n) + rim_i + rim_j


@wp.func
def wall_slip(v: wp.vec2d, n: wp.vec2d, rim: f64, surface: f64) -> f64:
    """Return the slip velocity vt of a grain on a wall [m/s] (eq. 23).

    `rim` is the grain's rim speed, and `surface` the speed of the wall's surface along the tangent.
    """
    return speed_along(v, n) + (rim - surface)


@wp.func
def rolling_part(radius_i: f64, radius_j: f64) -> f64:
    """Return c_i = r_j / (r_i + r_j), the factor of grain i's rim speed in the rolling speed vr (eq. 37)."""
    return radius_j / (radius_i + radius_j)


@wp.func
def pair_roll(part: f64, rim_i: f64, rim_j: f64) -> f64:
    """Return the rolling speed vr of two grains on each other [m/s] (eq. 37); `part` is c_i of eq. 37."""
    return part * rim_i - (f64(1.0) - part) * rim_j


@wp.func
def wall_roll(rim: f64, radius: f64, spin: f64) -> f64:
    """Return the rolling speed vr [m/s] of a grain on a wall that turns at `spin` [rad/s] (eq. 37)."""
    return rim - radius * spin


@wp.func
def round_gap_rate(gap_rate: f64, along: f64, circle: f64) -> f64:
    """Return gap / dt [m/s] at a round wall for a grain with the speed `along` it (eq. 18).

    gap_rate is gap / dt without this speed. circle is A / dt; if it is inf, the wall is not round and the
    result is gap_rate.
    """
    if circle == f64(wp.inf):
        return gap_rate
    root = wp.sqrt(wp.max(f64(0.0), circle * circle - along * along))
    return gap_rate - (circle - root)


@wp.func
def rebound(gap_rate: f64, rate: f64, vn: f64, surface: f64, restitution: f64, least: f64) -> f64:
    """Return gap / dt of a contact, which is smaller if the contact bounces [m/s] (eq. 35).

    `rate` is gap / dt for the speed along a round wall (eq. 18), otherwise gap_rate. vn is the closing speed
    at the end of the last step, and `surface` the speed of a wall along the normal. The contact bounces if vn
    > rate, so that the gap would close, and vn - surface > least, the `restitution_speed`.
    """
    if restitution > f64(0.0) and vn > rate and vn - surface > least:
        return wp.min(rate, surface - restitution * (vn - surface)) + (gap_rate - rate)
    return gap_rate


@wp.func
def mass_share(mass_i: f64, mass_j: f64) -> f64:
    """Return the share of a pair's correction that changes the velocity of grain i (eq. 7)."""
    return mass_j / (mass_i + mass_j)


@wp.func
def wall_residual(vn: f64, dv: f64, gap_rate: f64, back_rate: f64) -> f64:
    """Return the natural residual of a contact with a wall [m/s] (eq. 12): the larger one of both its sides.

    dv > 0 is the correction by the side of gap_rate, dv < 0 that by the other side, of back_rate.
    """
    front = normal_change(vn, wp.max(dv, f64(0.0)), gap_rate)
    back = normal_change(-vn, wp.max(-dv, f64(0.0)), back_rate)
    return wp.max(wp.abs(front), wp.abs(back))


@wp.func
def wall_cost(dv: f64, gap_rate: f64, back_rate: f64) -> f64:
    """Return the linear term of phi at a wall, per unit mass [m2/s2], for a correction dv [m/s] (eq. 14).

    It is dv gap_rate for dv >= 0, and -dv back_rate for dv < 0, where the other side acts. With one side, it
    is dv gap_rate also for dv < 0, which momentum may yield.
    """
    back = wp.where(back_rate < f64(wp.inf), back_rate, -gap_rate)
    return wp.where(dv >= f64(0.0), dv * gap_rate, -dv * back)
