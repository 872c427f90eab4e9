"""Path following for a step with friction (MODEL.md, "The exact method with friction").

The law of a contact is regularized: corrections are piecewise linear functions of its velocities, with a
small compliance eps around given corrections (`carried`). On one piece per contact, the equations of all
contacts are linear. The given corrections solve them if s times an error is added to the gaps and surface
speeds, with s = 1. `follow` reduces s to 0, from piece to piece.
"""

import warp as wp

from .. import law
from ..access import at, clear, put
from ..types import Floats, Ints, Triples, Vectors
from .block_lu import Factors, factor, solve
from .pieces import (
    BACKWARD,
    FORWARD,
    OPEN,
    STICK,
    Step,
    beyond,
    carried,
    coupling,
    gap_now,
    is_grain,
    margin,
    push,
    relative,
)

f64 = wp.float64
FOLLOWING, DONE, AT_FOLD, SPENT, UNBOUNDED = (wp.constant(k) for k in range(5))
"""Outcomes of a pass: not ended; s = 0; at a fold that was not passed; pivots used up; no piece ends."""
PIVOTS, FACTORIZATIONS, OUTCOME = (wp.constant(k) for k in range(3))
"""Indices of the results of a pass in `Path.count`."""
UPDATES = wp.constant(40)  # changes of pieces between two factorizations
LOCAL = wp.constant(20)  # number of pivots within which a fold must be passed
NEARBY = wp.constant(2)  # distance from a fold, in grains, within which gaps are opened
SLIPPING = wp.constant(f64(1.0 - 1e-12))  # |dv_t| / (mu dv_c) from which a contact counts as slipping
INSIDE = wp.constant(f64(1.0 - 1e-9))  # bound on |dv_t| / (mu dv_c) of a contact that sticks at the start
CLEAR = wp.constant(f64(1e-13))  # margin by which an open contact is clear of its gap at the start [m/s]
TYPES = {(2,): wp.vec2d, (3,): wp.vec3d, (3, 3): wp.mat33d}
"""Warp types of the elements of an array, by the shape of one element (without the first axis)."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Path:
    """A point on the path, the direction of the path there, and work arrays."""

    dv: Floats  # corrections: first the given ones (the center of the law), at the end the solution [m/s]
    dvt: Floats
    gap: Floats  # gap / dt for the velocities that the given corrections yield [m/s]
    piece: Ints
    error: Vectors  # errors of gap / dt and of the surface speed, which s multiplies [m/s]
    opening: Vectors  # changes of gap / dt and surface speed around a fold, which sigma multiplies
    excess: Vectors  # A, B: arguments of the law [m/s]
    rate: Vectors  # rates of A, B along the path
    velocity: Triples  # velocity and rim speed [m/s]
    saved: Triples  # velocity and rim speed at a fold
    way: Triples  # rate of `velocity` along the path
    change: Triples  # of `way` by a change of a piece, or of `velocity` by corrections
    updates: Triples  # changes of `way` since the last factorization, one after the other
    updated: Ints  # contacts whose pieces changed
    gradient: Vectors  # by change: of the margin that became 0
    pivot: Floats  # by change: ratio of the determinants of the matrix
    near: Ints  # whether grains are near a fold
    found: Ints  # the grains near a fold
    count: Ints  # results, with indices PIVOTS, FACTORIZATIONS and OUTCOME
    residual: Floats  # [m/s]


@wp.func
def add(x: Triples, amount: f64, change: Triples, first: int):
    """Set x += amount * change[first : first + len(x)]."""
    g = int(0)
    while g < x.shape[0]:
        put(x, g, at(x, g) + amount * at(change, first + g))
        g += 1


@wp.func
def copy(target: Triples, first: int, source: Triples):
    """Copy `source` to target[first : first + len(source)]."""
    for g in range(source.shape[0]):
        put(target, first + g, at(source, g))


@wp.func
def find_velocity(step: Step, path: Path):
    """Set `path.velocity` to the free velocities and rim speeds plus the changes by the corrections."""
    clear(path.change)
    for c in range(step.first.shape[0]):
        push(path.change, step, c, wp.vec2d(at(path.dv, c), at(path.dvt, c)))
    for g in range(step.free.shape[0]):
        put(path.velocity, g, at(step.free, g) - wp.cw_div(at(path.change, g), at(step.inertia, g)))


@wp.func
def begin(step: Step, path: Path):
    """Begin a pass at the corrections `path.dv` and `path.dvt`, the centers of the law (eq. 34).

    Compute the velocities that they yield, and gap, piece and error of every contact.
    """
    find_velocity(step, path)
    for c in range(step.first.shape[0]):
        v, gap = relative(path.velocity, step, c), gap_now(step, c, path.velocity)
        a, b, slip = at(path.dv, c), at(path.dvt, c), v[1] - at(step.surface, c)
        piece, limit = int(OPEN), at(step.friction, c) * a
        error = wp.vec2d(wp.max(f64(0.0), v[0] - gap + CLEAR), f64(0.0))
        if a > f64(0.0):
            error[0] = v[0] - gap
            if wp.abs(b) >= limit * SLIPPING and slip * b >= f64(0.0):
                piece = wp.where(b >= f64(0.0), FORWARD, BACKWARD)
            else:
                piece = int(STICK)
                error[1] = slip
                put(path.dvt, c, wp.clamp(b, -limit * INSIDE, limit * INSIDE))
        put(path.gap, c, gap)
        put(path.piece, c, piece)
        put(path.error, c, error)
        put(path.opening, c, wp.vec2d())


@wp.func
def assemble(step: Step, path: Path, factors: Factors, eps: f64):
    """Write the matrix of eq. 33, for the present piece of every contact and compliance eps, to `factors`."""
    for k in range(factors.lower.shape[0]):
        put(factors.lower, k, wp.mat33d())
        put(factors.upper, k, wp.mat33d())
    for g in range(step.free.shape[0]):
        put(factors.diagonal, g, wp.diag(at(step.inertia, g)))
    for c in range(step.first.shape[0]):
        piece = at(path.piece, c)
        if piece != OPEN:
            x, friction, share = at(step.normal, c), at(step.friction, c), f64(1.0) / at(step.k_t, c)
            by_n = at(step.mass, c) * carried(piece, wp.vec2d(f64(1.0), f64(0.0)), friction, eps)
            by_t = at(step.mass, c) * carried(piece, wp.vec2d(f64(0.0), share), friction, eps)
            parts = at(step.parts, c)
            slope = wp.vec3d(parts[0] * by_n[0], by_n[1], by_t[1])
            n, t = wp.vec3d(x[0], x[1], f64(0.0)), wp.vec3d(-parts[0] * x[1], parts[0] * x[0], parts[1])
            i, j, k = at(step.first, c), at(step.second, c), at(step.block, c)
            put(factors.diagonal, i, at(factors.diagonal, i) + coupling(n, t, n, t, slope))
            if j >= 0:
                m, s = -n, wp.vec3d(parts[0] * x[1], -parts[0] * x[0], parts[2])
                if not is_grain(step, j):
                    m = wp.vec3d(-at(step.lever, c)[0], f64(0.0), f64(0.0))
                    s = wp.vec3d(-parts[0] * at(step.lever, c)[1], f64(0.0), f64(0.0))
                put(factors.diagonal, j, at(factors.diagonal, j) + coupling(m, s, m, s, slope))
                above, below = coupling(n, t, m, s, slope), coupling(m, s, n, t, slope)
                if i > j:
                    above, below = coupling(m, s, n, t, slope), coupling(n, t, m, s, slope)
                put(factors.upper, k, at(factors.upper, k) + above)
                put(factors.lower, k, at(factors.lower, k) + below)


@wp.func
def find_excess(step: Step, path: Path, s: f64, sigma: f64, eps: f64):
    """Write the arguments (A, B) of the law of every contact (eq. 32), for `path.velocity`, to `path.excess`.

    s multiplies the errors of the contacts (`path.error`), and sigma their openings around a fold
    (`path.opening`).
    """
    for c in range(step.first.shape[0]):
        v, error = relative(path.velocity, step, c), s * at(path.error, c) + sigma * at(path.opening, c)
        a = eps * at(path.dv, c) + v[0] - at(path.gap, c) - error[0]
        b = eps * at(path.dvt, c) + (v[1] - at(step.surface, c) - error[1]) / at(step.k_t, c)
        put(path.excess, c, wp.vec2d(a, b))


@wp.func
def correct(step: Step, path: Path, factors: Factors, s: f64, sigma: f64, eps: f64):
    """Make velocities and rim speeds solve the equations of all contacts on their pieces, `path.piece`.

    `factors` holds their factored matrix for the compliance eps; for s and sigma see `find_excess`. The
    equations are linear, so one Newton step solves them.
    """
    find_excess(step, path, s, sigma, eps)
    for g in range(step.free.shape[0]):
        put(path.change, g, wp.cw_mul(at(step.inertia, g), at(path.velocity, g) - at(step.free, g)))
    for c in range(step.first.shape[0]):
        push(path.change, step, c, carried(at(path.piece, c), at(path.excess, c), at(step.friction, c), eps))
    solve(factors, path.change)
    add(path.velocity, f64(-1.0), path.change, 0)


@wp.func
def solve_updated(step: Step, path: Path, factors: Factors, x: Triples, updates: int):
    """Replace the right-hand side x by the solution, after `updates` rank-1 updates of the factored matrix.

    Each update is the change of one contact's piece since the factorization.
    """
    solve(factors, x)
    for k in range(updates):
        along = wp.dot(at(path.gradient, k), relative(x, step, at(path.updated, k)))
        if along != f64(0.0):
            add(x, -along / at(path.pivot, k), path.updates, k * x.shape[0])


@wp.func
def find_way(step: Step, path: Path, factors: Factors, drive: Vectors, updates: int, eps: f64):
    """Compute `path.way`, the rate at which `path.velocity` changes along the path.

    `drive` has the rates of gap / dt and surface speed of every contact. `updates` is the number of changes
    of pieces since the factorization with the compliance eps.
    """
    clear(path.way)
    for c in range(step.first.shape[0]):
        rate = at(drive, c)
        if rate[0] != f64(0.0) or rate[1] != f64(0.0):
            rate[1] = rate[1] / at(step.k_t, c)
            push(path.way, step, c, carried(at(path.piece, c), rate, at(step.friction, c), eps))
    solve_updated(step, path, factors, path.way, updates)


@wp.func
def next_kink(step: Step, path: Path, drive: Vectors, lead: f64, last: int):
    """Return (contact, side, way): the contact that first reaches a side of its piece, and the way to it.

    `way` >= 0 is the change of s or sigma, whose rate is `lead`, 1 or -1. If no contact reaches a side, the
    contact is -1 and way is inf. The contact `last` is skipped: its piece has just changed, so it is at a
    side.
    """
    hit, hit_side, way = int(-1), int(0), f64(wp.inf)
    c = int(0)
    while c < step.first.shape[0]:
        v = relative(path.way, step, c) - at(drive, c)
        rate = wp.vec2d(lead * v[0], lead * v[1] / at(step.k_t, c))
        put(path.rate, c, rate)
        piece, friction = at(path.piece, c), at(step.friction, c)
        if c != last:
            for side in range(2):
                falls = -margin(piece, side, rate, friction)
                if falls > f64(0.0):
                    left = margin(piece, side, at(path.excess, c), friction) / falls
                    if left < way:
                        hit, hit_side, way = c, side, left
        c += 1
    return hit, hit_side, wp.max(f64(0.0), way)


@wp.func
def open_around(step: Step, path: Path, c: int):
    """Set `opening` to (1, 0) for contacts at most NEARBY grains from contact c, and to 0 for others."""
    for e in range(step.first.shape[0]):
        put(path.opening, e, wp.vec2d())
    for g in range(step.free.shape[0]):
        put(path.near, g, 0)
    begun, count = int(0), int(0)
    for side in range(2):
        g = wp.where(side == 0, at(step.first, c), at(step.second, c))
        if side == 0 or is_grain(step, g):
            put(path.near, g, 1)
            put(path.found, count, g)
            count += 1
    for _ in range(NEARBY):
        end = int(count)
        while begun < end:
            g = at(path.found, begun)
            for k in range(at(step.contact_start, g), at(step.contact_start, g + 1)):
                e = at(step.contact, k)
                put(path.opening, e, wp.vec2d(f64(1.0), f64(0.0)))
                other = at(step.first, e) + at(step.second, e) - g
                if is_grain(step, at(step.second, e)) and at(path.near, other) == 0:
                    put(path.near, other, 1)
                    put(path.found, count, other)
                    count += 1
            begun += 1


@wp.func
def rate_of_margin(step: Step, path: Path, c: int, gradient: wp.vec2d, drive: Vectors) -> f64:
    """Return the rate at which a `margin` of contact c changes along the path.

    `gradient` has the derivatives of this margin by vn and vt, and `drive` the rates of gap / dt and surface
    speed of every contact.
    """
    return wp.dot(gradient, relative(path.way, step, c) - at(drive, c))


@wp.kernel
def follow(step: Step, path: Path, factors: Factors, eps: f64, most: int):
    """Follow the path from the corrections `path.dv` and `path.dvt`, and replace them by those at its end.

    eps is the compliance. In a pass, contacts change their pieces (a pivot) at most `most` times. The numbers
    of pivots and factorizations and the outcome are written to `path.count`.
    """
    begin(step, path)
    s, sigma, lead = f64(1.0), f64(0.0), f64(-1.0)  # lead: sign of the rate of s or sigma
    drive = path.error
    snapping, local = bool(False), int(0)
    updates, pivots, factorizations, last = int(UPDATES), int(0), int(0), int(-1)
    outcome = int(FOLLOWING)
    while outcome == FOLLOWING:
        if updates == UPDATES:
            assemble(step, path, factors, eps)
            lead = -factor(factors)
            factorizations += 1
            updates = 0
            if lead > f64(0.0) and not snapping:
                outcome = int(AT_FOLD)
                break
            correct(step, path, factors, s, sigma, eps)
            correct(step, path, factors, s, sigma, eps)
            find_excess(step, path, s, sigma, eps)
            find_way(step, path, factors, drive, updates, eps)
        c, side, way = next_kink(step, path, drive, lead, last)
        left = wp.where(snapping, sigma, s)
        ends = lead < f64(0.0) and way >= left
        if ends:
            way = left
        elif c < 0:
            outcome = int(UNBOUNDED)
            break
        add(path.velocity, lead * way, path.way, 0)
        for e in range(step.first.shape[0]):
            put(path.excess, e, at(path.excess, e) + way * at(path.rate, e))
        if snapping:
            sigma = sigma + lead * way
            local += 1
        else:
            s = s + lead * way
        if ends and not snapping:
            s = f64(0.0)
            outcome = int(DONE)
            break
        if ends:  # sigma = 0 on another branch of the path
            snapping, sigma, lead, last = False, f64(0.0), f64(-1.0), int(-1)
            drive = path.error
            find_way(step, path, factors, drive, updates, eps)
            continue
        if pivots >= most or local > LOCAL:
            outcome = int(SPENT)
            if snapping:
                copy(path.velocity, 0, path.saved)
                sigma, outcome = f64(0.0), int(AT_FOLD)
            break
        friction, old = at(step.friction, c), at(path.piece, c)
        new = beyond(old, side, at(path.excess, c))
        p = margin(old, side, wp.vec2d(f64(1.0), f64(0.0)), friction)
        q = margin(old, side, wp.vec2d(f64(0.0), f64(1.0)), friction)
        across = wp.vec2d(p, q) / (p * p + q * q)  # by which the margin changes by 1
        gradient = wp.vec2d(p, q / at(step.k_t, c))
        clear(path.change)
        push(path.change, step, c, carried(new, across, friction, eps) - carried(old, across, friction, eps))
        solve_updated(step, path, factors, path.change, updates)
        pivot = f64(1.0) + wp.dot(gradient, relative(path.change, step, c))  # ratio of the determinants
        rate = rate_of_margin(step, path, c, gradient, drive)
        if pivot < f64(0.0) and not snapping:  # a fold in s
            snapping, local, before = True, int(0), lead * rate
            copy(path.saved, 0, path.velocity)
            open_around(step, path, c)
            drive = path.opening
            find_way(step, path, factors, drive, updates, eps)
            rate = rate_of_margin(step, path, c, gradient, drive)
            if rate * before > f64(0.0):  # gaps must close, not open, to reach the far side
                rate = -rate
                add(path.way, f64(-2.0), path.way, 0)
                for e in range(step.first.shape[0]):
                    put(path.opening, e, -at(path.opening, e))
            lead = f64(1.0)
        elif pivot < f64(0.0):
            lead = -lead
        add(path.way, -rate / pivot, path.change, 0)
        copy(path.updates, updates * step.free.shape[0], path.change)
        put(path.updated, updates, c)
        put(path.gradient, updates, gradient)
        put(path.pivot, updates, pivot)
        put(path.piece, c, new)
        if old == OPEN or new == OPEN:
            put(path.excess, c, wp.vec2d(f64(0.0), at(path.excess, c)[1]))
        updates += 1
        pivots += 1
        last = int(c)
    find_excess(step, path, s, sigma, eps)
    for e in range(step.first.shape[0]):
        a = wp.max(f64(0.0), at(path.excess, e)[0] / eps)
        limit = at(step.friction, e) * a
        put(path.dv, e, a)
        put(path.dvt, e, wp.clamp(at(path.excess, e)[1] / eps, -limit, limit))
    put(path.count, PIVOTS, pivots)
    put(path.count, FACTORIZATIONS, factorizations)
    put(path.count, OUTCOME, outcome)


@wp.kernel
def measure(step: Step, path: Path):
    """Compute `path.velocity` from the corrections, and `path.residual`, their natural residual [m/s].

    The residual is the largest of eqs. 25, 30 and 38.
    """
    find_velocity(step, path)
    worst = f64(0.0)
    for c in range(step.first.shape[0]):
        v, k_n, k_t = relative(path.velocity, step, c), at(step.k_n, c), at(step.k_t, c)
        change = law.driven_change(v[0] - gap_now(step, c, path.velocity), at(path.dv, c), k_n)
        limit = at(step.friction, c) * (at(path.dv, c) + change)
        slip = law.tangential_change((v[1] - at(step.surface, c)) / k_t, at(path.dvt, c), limit)
        worst = wp.max(worst, wp.max(k_n * wp.abs(change), k_t * wp.abs(slip)))
    put(path.residual, 0, worst)
