"""Rolling resistance: the third correction of a contact, against the relative rotation (MODEL.md, eq. 37)."""

import warp as wp

from .. import law
from ..access import at, bodies_of, put
from ..contacts import rim_weights
from ..record import Scene, grain_count
from ..types import Contact, Floats, PoseOf
from ..walls.walls import are_mobile

f64 = wp.float64


@wp.func
def find_roll_weights(s: Scene, c: int, i: int, j: int):
    """Write (c_i, 1 / K_r) of contact c, between grain i and grain or wall j, to `roll_weights` (eq. 37).

    c_i, which multiplies grain i's rim speed in vr, is 1 at walls.
    """
    part, at_wall = f64(1.0), j >= grain_count(s)
    if not at_wall:
        part = law.rolling_part(at(s.grains.radius, i), at(s.grains.radius, j))
    rims, other = rim_weights(s, c, at_wall), f64(1.0) - part
    compliance = part * part * rims[1] + other * other * rims[2]
    put(s.contacts.roll_weights, c, wp.vec2d(part, f64(1.0) / compliance))


@wp.func
def rolling_at_wall(s: Scene, j: int) -> wp.vec2d:
    """Return (coefficient of rolling friction, angular velocity [rad/s]) of the wall that is body j."""
    b = j - grain_count(s)
    rolling = at(s.walls.rolling, b)
    if b > 0 and are_mobile(s.walls):
        return rolling + wp.vec2d(f64(0.0), at(s.walls.pose, b - 1)[PoseOf.ANGULAR_VELOCITY])
    return rolling


@wp.func
def apply_rolling(s: Scene, rim: Floats, contact: Contact, c: int, dvr: f64):
    """Change the rim speeds of both bodies by the rolling correction dvr [m/s] of contact c (eq. 37)."""
    i, j = bodies_of(contact)
    at_wall = j >= grain_count(s)
    rims, part = rim_weights(s, c, at_wall), at(s.contacts.roll_weights, c)[0]
    put(rim, i, at(rim, i) - dvr * part * rims[1])
    if not at_wall:
        put(rim, j, at(rim, j) + dvr * (f64(1.0) - part) * rims[2])


@wp.func
def rolling_residual(s: Scene, contact: Contact, c: int, dv: f64) -> f64:
    """Return the rolling part of the residual of contact c [m/s] (eq. 38), for a normal correction dv."""
    i, j = bodies_of(contact)
    rim, weights = s.grains.recomputed_rim, at(s.contacts.roll_weights, c)
    vr, mu = f64(0.0), f64(s.rolling_friction)
    if j >= grain_count(s):
        rolls = rolling_at_wall(s, j)
        vr, mu = law.wall_roll(at(rim, i), at(s.grains.radius, i), rolls[1]), rolls[0]
    else:
        vr = law.pair_roll(weights[0], at(rim, i), at(rim, j))
    return law.tangential_residual(vr, at(s.contacts.dvr.now, c), weights[1], mu * dv)
