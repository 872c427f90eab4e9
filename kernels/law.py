"""The law, as pure functions of numbers: SPEC.md, section "One step", to be held against it line by line."""

import warp as wp

f64 = wp.float64


@wp.func
def drag_deceleration(velocity: wp.vec2d, drag: f64, mass: f64) -> wp.vec2d:
    """What linear drag takes from the gravity: drag / m_i * v_i [m/s2]."""
    return (drag / mass) * velocity


@wp.func
def normal(tail: wp.vec2d, head: wp.vec2d):
    """Unit normal from tail to head, and their distance [m]. A wall's normal starts at the origin."""
    d = head - tail
    distance = wp.sqrt(d[0] * d[0] + d[1] * d[1])
    return wp.vec2d(d[0] / distance, d[1] / distance), distance


@wp.func
def pair_gap(distance: f64, radius_i: f64, radius_j: f64) -> f64:
    """Free distance between two grains [m]: gap = |x_j - x_i| - (r_i + r_j)."""
    return distance - (radius_i + radius_j)


@wp.func
def outer_gap(distance: f64, radius: f64, radius_out: f64) -> f64:
    """Free distance between a grain and the outer wall [m]."""
    return radius_out - distance - radius


@wp.func
def inner_gap(distance: f64, radius: f64, radius_in: f64) -> f64:
    """Free distance between a grain and the inner wall [m]."""
    return distance - radius_in - radius


@wp.func
def pair_correction(vn: f64, dvc: f64, gap_rate: f64) -> f64:
    """Change dv of a pair's correction dv_c [m/s]; gap_rate = gap / dt just closes the gap in a step."""
    return wp.max(f64(0.0), vn + dvc - gap_rate) - dvc


@wp.func
def outer_correction(vn: f64, dvb: f64, gap_rate: f64) -> f64:
    """What the outer wall asks of a grain's wall correction dv_b [m/s]."""
    return wp.max(f64(0.0), vn + dvb - gap_rate)


@wp.func
def inner_correction(vn: f64, dvb: f64, gap_rate: f64) -> f64:
    """What the inner wall asks of a grain's wall correction dv_b [m/s]."""
    return wp.max(f64(0.0), -vn - dvb - gap_rate)


@wp.func
def share_of_mass(mass_i: f64, mass_j: f64) -> f64:
    """Part of a pair's correction that grain i takes: m_j / (m_i + m_j)."""
    return mass_j / (mass_i + mass_j)
