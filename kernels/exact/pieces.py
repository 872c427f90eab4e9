"""The equations of a step with friction, whose contacts are on pieces of a regularized law (eqs. 32 and 33).

Corrections are piecewise linear functions of the velocities of a contact, with a small compliance eps.
"""

import warp as wp

from .. import law
from ..access import at, put
from ..types import Floats, Ints, Triples, Vectors

f64 = wp.float64
OPEN, STICK, FORWARD, BACKWARD = (wp.constant(k) for k in range(4))
"""Pieces of the law of a contact. The contact slips on the last two, with dv_t > 0 and dv_t < 0."""


@wp.struct
class Step:
    """A step with friction: its m contacts, and its n grains in the order of elimination.

    A contact that resists rolling has two elements in the arrays of contacts. In the second one, vr, dv_r and
    mu_r (eq. 37) replace vt, dv_t and mu. Its normal correction only limits dv_r; it does not act on grains.
    """

    first: Ints
    second: Ints  # second grain, or n + index of a driven wall, or -1 for other walls
    normal: Vectors
    gap_rate: Floats  # gap / dt [m/s]
    circle: Floats  # A / dt at a round wall, or inf [m/s] (eq. 18)
    friction: Floats
    surface: Floats  # speed of the surface along the tangent [m/s]
    lever: Vectors  # g, g_t at driven walls (eqs. 28, 30b)
    parts: Triples  # factors of slip and both rim speeds in vt: 1, 1, 1; in vr: 0, c_i, -c_j (eq. 37)
    k_n: Floats  # K (eq. 28)
    k_t: Floats  # K_t or K_r (eqs. 22, 30b, 37)
    mass: Floats  # mu_c [kg]
    block: Ints  # index of the pair's block in the factors
    contact_start: Ints  # contacts of grain i: contact[k], contact_start[i] <= k < contact_start[i + 1]
    contact: Ints
    inertia: Triples  # M, M, J / 2 of a grain [kg]; mass, 1, 1 of a driven wall
    free: Triples  # free velocity and rim speed of a grain [m/s]; speed, 0, 0 of a driven wall


@wp.func
def is_grain(step: Step, j: int) -> bool:
    """Return whether j, from `Step.second`, is a grain and not a wall."""
    return j >= 0 and j < step.contact_start.shape[0] - 1


@wp.func
def relative(u: Triples, step: Step, c: int) -> wp.vec2d:
    """Return (vn, vt) of contact c [m/s] for the velocities and rim speeds u of all bodies.

    If c is the second element of a contact that resists rolling (`Step`), vt is vr. The speed of a driven
    wall is subtracted, that of a surface along its tangent (`Step.surface`) is not.
    """
    own, j, n, parts = at(u, at(step.first, c)), at(step.second, c), at(step.normal, c), at(step.parts, c)
    x, y, rim = own[0], own[1], parts[1] * own[2]
    if is_grain(step, j):
        other = at(u, j)
        x, y, rim = x - other[0], y - other[1], rim + parts[2] * other[2]
    v = wp.vec2d(x * n[0] + y * n[1], parts[0] * (y * n[0] - x * n[1]) + rim)
    if j >= 0 and not is_grain(step, j):
        lever = at(step.lever, c)
        v = v - at(u, j)[0] * wp.vec2d(lever[0], parts[0] * lever[1])
    return v


@wp.func
def push(force: Triples, step: Step, c: int, amount: wp.vec2d):
    """Add the impulses mu_c times `amount` (normal, tangential) of contact c to `force` of both its bodies.

    `force` has a triple for each body: the impulse and its moment. This is the transpose of `relative`. The
    second element of a contact that resists rolling (`Step`) adds a moment only.
    """
    i, j, n, f = at(step.first, c), at(step.second, c), at(step.normal, c), at(step.mass, c) * amount
    parts = at(step.parts, c)
    along = parts[0] * f
    x, y = along[0] * n[0] - along[1] * n[1], along[0] * n[1] + along[1] * n[0]
    put(force, i, at(force, i) + wp.vec3d(x, y, parts[1] * f[1]))
    if is_grain(step, j):
        put(force, j, at(force, j) + wp.vec3d(-x, -y, parts[2] * f[1]))
    elif j >= 0:
        put(force, j, at(force, j) - wp.vec3d(wp.dot(at(step.lever, c), along), f64(0.0), f64(0.0)))


@wp.func
def carried(piece: int, excess: wp.vec2d, friction: f64, eps: f64) -> wp.vec2d:
    """Return (dv_c, dv_t) of a contact on a `piece` of its law: OPEN, STICK, FORWARD or BACKWARD (eq. 32).

    `excess` is (A, B), the arguments of the law, and eps the compliance.
    """
    if piece == OPEN:
        return wp.vec2d(f64(0.0), f64(0.0))
    a = excess[0] / eps
    if piece == STICK:
        return wp.vec2d(a, excess[1] / eps)
    return wp.vec2d(a, wp.where(piece == FORWARD, friction * a, -friction * a))


@wp.func
def margin(piece: int, side: int, excess: wp.vec2d, friction: f64) -> f64:
    """Return a linear function of the excess (A, B) that is > 0 on a piece and 0 at its side 0 or 1.

    (A, B) are the arguments of the law (eq. 32). A piece has one or two sides, where another piece of the law
    begins. The result is 0 if there is no side 1.
    """
    if piece == STICK:
        return friction * excess[0] + wp.where(side == 0, -excess[1], excess[1])
    if side == 0:
        return wp.where(piece == OPEN, -excess[0], excess[0])
    if piece == OPEN or friction == f64(0.0):
        return f64(0.0)
    return wp.where(piece == FORWARD, excess[1], -excess[1]) - friction * excess[0]


@wp.func
def beyond(piece: int, side: int, excess: wp.vec2d) -> int:
    """Return the piece of the law that begins beyond side 0 or 1 of a piece, for the excess (A, B) there."""
    if piece == OPEN:
        return wp.where(excess[1] >= f64(0.0), FORWARD, BACKWARD)
    if piece == STICK:
        return wp.where(side == 0, FORWARD, BACKWARD)
    return wp.where(side == 0, OPEN, STICK)


@wp.func
def gap_now(step: Step, c: int, u: Triples) -> f64:
    """Return gap / dt of contact c [m/s]; at a round wall, it depends on the velocity of the grain (eq. 18).

    u holds the velocities and rim speeds of all bodies.
    """
    own = at(u, at(step.first, c))
    along = law.speed_along(wp.vec2d(own[0], own[1]), at(step.normal, c))
    return law.round_gap_rate(at(step.gap_rate, c), along, at(step.circle, c))


@wp.func
def coupling(n: wp.vec3d, t: wp.vec3d, other_n: wp.vec3d, other_t: wp.vec3d, slope: wp.vec3d) -> wp.mat33d:
    """Return a 3 x 3 block of the matrix of eq. 33, by which a contact couples a body with itself or another.

    n and t are the derivatives of vn and vt by the velocity of the block's row, other_n and other_t those by
    the velocity of its column. `slope` has the derivatives of dv by vn, of dv_t by vn, and of dv_t by vt,
    times mu_c.
    """
    return wp.outer(n, slope[0] * other_n) + wp.outer(t, slope[1] * other_n + slope[2] * other_t)
