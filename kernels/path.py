"""Path following for a step with friction (MODEL.md, "The exact method with friction").

A contact answers to its velocities by a piecewise linear law with a small compliance eps around given
corrections (`carried`). On a piece of it, the equations of all contacts are linear. The given corrections
solve them for gaps and surface speeds that are changed by errors, times s = 1. `follow` takes s to 0, from
piece to piece.
"""

import warp as wp

from . import law
from .access import at, put
from .block_lu import Factors, Triples, factor, solve
from .types import Floats, Ints, Vectors

f64 = wp.float64
OPEN, STICK, FORWARD, BACKWARD = (wp.constant(k) for k in range(4))
"""Pieces of the law of a contact. It slips on two of them: with dv_t > 0, and with dv_t < 0."""
FOLLOWING, DONE, AT_FOLD, SPENT, UNBOUNDED = (wp.constant(k) for k in range(5))
"""Outcomes of a pass: not known yet; s = 0; at a fold that was not passed; without pivots; no piece ends."""
PIVOTS, FACTORIZATIONS, SNAPS, FOLDS = (wp.constant(k) for k in range(4))
"""Counts of a pass."""
UPDATES = wp.constant(40)  # changes of pieces between two factorizations
SLIPPING = wp.constant(f64(1.0 - 1e-12))  # of mu dv_c, from which on a contact slips
INSIDE = wp.constant(f64(1.0 - 1e-9))  # of mu dv_c, to which a contact is put that sticks again
CLEAR = wp.constant(f64(1e-13))  # [m/s] by which contacts that carry nothing are clear of their gap

TYPES = {(2,): wp.vec2d, (3,): wp.vec3d, (3, 3): wp.mat33d}
"""Types of the elements of an array of this shape but for the first axis."""

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Step:
    """A step with friction: its m contacts, and its n grains."""

    first: Ints
    second: Ints  # -1 at walls
    normal: Vectors
    gap_rate: Floats  # gap / dt [m/s]
    reach: Floats  # A / dt at a round wall, or inf [m/s] (eq. 18)
    friction: Floats
    surface: Floats  # speed of the surface along the tangent [m/s]
    compliance: Floats  # K_t (eq. 22)
    mass: Floats  # mu_c [kg]
    place: Ints  # of the blocks of a pair in the factors
    contact_start: Ints  # contacts of grain i: contact[k], contact_start[i] <= k < contact_start[i + 1]
    contact: Ints
    inertia: Triples  # M, M, J / 2 [kg]
    free: Triples  # free velocity and rim speed [m/s]


@wp.struct
class Path:
    """A point on the path, and where it leads."""

    dv: Floats  # corrections: of the centre, and then those that were reached [m/s]
    dvt: Floats
    gap: Floats  # gap / dt for the velocities of the centre [m/s]
    piece: Ints
    error: Vectors  # of gap / dt, and of the speed of the surface [m/s]
    opening: Vectors  # what is added to them around a fold
    excess: Vectors  # A, B: arguments of the law [m/s]
    rate: Vectors  # their rates along the way
    velocity: Triples  # and rim speed [m/s]
    saved: Triples  # those at a fold
    way: Triples  # rate of the velocity
    change: Triples  # of the way by a change of a piece
    force: Triples
    updates: Triples  # changes since the last factorization, one after the other
    updated: Ints  # contacts whose pieces changed
    gradient: Vectors  # by which they did
    pivot: Floats
    mark: Ints  # grains near a fold
    front: Ints
    count: Ints  # by PIVOTS, ...
    reached: Floats  # s, and eta [m/s]


@wp.func
def relative(u: Triples, i: int, j: int, n: wp.vec2d) -> wp.vec2d:
    """Return vn and vt of a contact, for a surface at rest."""
    own = at(u, i)
    x, y, rim = own[0], own[1], own[2]
    if j >= 0:
        other = at(u, j)
        x, y, rim = x - other[0], y - other[1], rim + other[2]
    return wp.vec2d(x * n[0] + y * n[1], y * n[0] - x * n[1] + rim)


@wp.func
def push(force: Triples, i: int, j: int, n: wp.vec2d, amount: wp.vec2d):
    """Add the transpose of `relative` times the normal and tangential amount."""
    x = amount[0] * n[0] - amount[1] * n[1]
    y = amount[0] * n[1] + amount[1] * n[0]
    put(force, i, at(force, i) + wp.vec3d(x, y, amount[1]))
    if j >= 0:
        put(force, j, at(force, j) + wp.vec3d(-x, -y, amount[1]))


@wp.func
def carried(piece: int, excess: wp.vec2d, friction: f64, eps: f64) -> wp.vec2d:
    """Return dv_c and dv_t on a piece of the law, for A = excess[0] and B = excess[1]."""
    if piece == OPEN:
        return wp.vec2d(f64(0.0), f64(0.0))
    a = excess[0] / eps
    if piece == STICK:
        return wp.vec2d(a, excess[1] / eps)
    return wp.vec2d(a, wp.where(piece == FORWARD, friction * a, -friction * a))


@wp.func
def margin(piece: int, side: int, excess: wp.vec2d, friction: f64) -> f64:
    """Return the distance from one of the two sides of a piece, a linear function, > 0 within the piece."""
    if piece == OPEN:
        return -excess[0]
    if piece == STICK:
        return friction * excess[0] + wp.where(side == 0, -excess[1], excess[1])
    if side == 0:
        return excess[0]
    return wp.where(piece == FORWARD, excess[1], -excess[1]) - friction * excess[0]


@wp.func
def sides_of(piece: int, friction: f64) -> int:
    """Return the number of sides of a piece."""
    if piece == OPEN or (piece != STICK and friction == f64(0.0)):
        return 1
    return 2


@wp.func
def beyond(piece: int, side: int, excess: wp.vec2d) -> int:
    """Return the piece on the other side."""
    if piece == OPEN:
        return wp.where(excess[1] >= f64(0.0), FORWARD, BACKWARD)
    if piece == STICK:
        return wp.where(side == 0, FORWARD, BACKWARD)
    return wp.where(side == 0, OPEN, STICK)


@wp.func
def coupling(
    n: wp.vec3d, t: wp.vec3d, other_n: wp.vec3d, other_t: wp.vec3d, normal: wp.vec2d, tangential: wp.vec2d
):
    """Return the block that a contact adds, from its parts for both grains and the rates of the law."""
    return wp.outer(n, normal[0] * other_n) + wp.outer(t, normal[1] * other_n + tangential[1] * other_t)


@wp.func
def assemble(step: Step, path: Path, factors: Factors, eps: f64):
    """Write the matrix of the present pieces."""
    k = int(0)
    while k < factors.lower.shape[0]:
        put(factors.lower, k, wp.mat33d())
        put(factors.upper, k, wp.mat33d())
        k += 1
    g = int(0)
    while g < step.free.shape[0]:
        put(factors.diagonal, g, wp.diag(at(step.inertia, g)))
        g += 1
    c = int(0)
    while c < step.first.shape[0]:
        piece = at(path.piece, c)
        if piece != OPEN:
            mass = at(step.mass, c)
            share = mass / at(step.compliance, c)
            normal = carried(piece, wp.vec2d(mass, f64(0.0)), at(step.friction, c), eps)
            tangential = carried(piece, wp.vec2d(f64(0.0), share), at(step.friction, c), eps)
            x = at(step.normal, c)
            n, t = wp.vec3d(x[0], x[1], f64(0.0)), wp.vec3d(-x[1], x[0], f64(1.0))
            i = at(step.first, c)
            put(factors.diagonal, i, at(factors.diagonal, i) + coupling(n, t, n, t, normal, tangential))
            if at(step.second, c) >= 0:
                j = at(step.second, c)
                k = at(step.place, c)
                m, s = -n, wp.vec3d(x[1], -x[0], f64(1.0))
                put(factors.diagonal, j, at(factors.diagonal, j) + coupling(m, s, m, s, normal, tangential))
                right, left = (
                    coupling(n, t, m, s, normal, tangential),
                    coupling(m, s, n, t, normal, tangential),
                )
                if i < j:
                    put(factors.upper, k, at(factors.upper, k) + right)
                    put(factors.lower, k, at(factors.lower, k) + left)
                else:
                    put(factors.upper, k, at(factors.upper, k) + left)
                    put(factors.lower, k, at(factors.lower, k) + right)
        c += 1


@wp.func
def find_velocity(step: Step, path: Path):
    """Compute the velocities that the corrections make of the free ones."""
    g = int(0)
    while g < step.free.shape[0]:
        put(path.force, g, wp.vec3d())
        g += 1
    c = int(0)
    while c < step.first.shape[0]:
        amount = at(step.mass, c) * wp.vec2d(at(path.dv, c), at(path.dvt, c))
        push(path.force, at(step.first, c), at(step.second, c), at(step.normal, c), amount)
        c += 1
    g = int(0)
    while g < step.free.shape[0]:
        put(path.velocity, g, at(step.free, g) - wp.cw_div(at(path.force, g), at(step.inertia, g)))
        g += 1


@wp.func
def gap_now(step: Step, c: int, u: wp.vec3d) -> f64:
    """Return gap / dt of a contact for the velocity of its first grain."""
    along = law.speed_along(wp.vec2d(u[0], u[1]), at(step.normal, c))
    return law.round_gap_rate(at(step.gap_rate, c), along, at(step.reach, c))


@wp.func
def residual_of(step: Step, path: Path) -> f64:
    """Return eta of the corrections [m/s] (eq. 25), and compute their velocities."""
    find_velocity(step, path)
    worst = f64(0.0)
    c = int(0)
    while c < step.first.shape[0]:
        i, compliance = at(step.first, c), at(step.compliance, c)
        v = relative(path.velocity, i, at(step.second, c), at(step.normal, c))
        change = law.normal_change(v[0], at(path.dv, c), gap_now(step, c, at(path.velocity, i)))
        limit = at(step.friction, c) * (at(path.dv, c) + change)
        slip = law.tangential_change((v[1] - at(step.surface, c)) / compliance, at(path.dvt, c), limit)
        worst = wp.max(worst, wp.max(wp.abs(change), compliance * wp.abs(slip)))
        c += 1
    return worst


@wp.func
def begin(step: Step, path: Path):
    """Begin at the corrections: the gaps for their velocities, the piece of every contact, and its error."""
    find_velocity(step, path)
    c = int(0)
    while c < step.first.shape[0]:
        i = at(step.first, c)
        v = relative(path.velocity, i, at(step.second, c), at(step.normal, c))
        a, b, gap = at(path.dv, c), at(path.dvt, c), gap_now(step, c, at(path.velocity, i))
        slip = v[1] - at(step.surface, c)
        limit = at(step.friction, c) * a
        piece = int(OPEN)
        error = wp.vec2d(wp.max(f64(0.0), v[0] - gap + CLEAR), f64(0.0))
        if a > f64(0.0):
            error = wp.vec2d(v[0] - gap, f64(0.0))
            if wp.abs(b) >= limit * SLIPPING and slip * b >= f64(0.0):
                piece = wp.where(b >= f64(0.0), FORWARD, BACKWARD)
            else:
                piece = int(STICK)
                error = wp.vec2d(v[0] - gap, slip)
                put(path.dvt, c, wp.clamp(b, -limit * INSIDE, limit * INSIDE))
        put(path.gap, c, gap)
        put(path.piece, c, piece)
        put(path.error, c, error)
        c += 1


@wp.func
def find_excess(step: Step, path: Path, s: f64, sigma: f64, eps: f64):
    """Compute the arguments of the laws at a point of the path."""
    c = int(0)
    while c < step.first.shape[0]:
        v = relative(path.velocity, at(step.first, c), at(step.second, c), at(step.normal, c))
        error, opening = at(path.error, c), at(path.opening, c)
        a = eps * at(path.dv, c) + v[0] - at(path.gap, c) - s * error[0] - sigma * opening[0]
        b = eps * at(path.dvt, c) + (v[1] - at(step.surface, c) - s * error[1]) / at(step.compliance, c)
        put(path.excess, c, wp.vec2d(a, b))
        c += 1


@wp.func
def add(x: Triples, amount: f64, change: Triples, first: int):
    """Add a multiple of a change, which begins at an index."""
    g = int(0)
    while g < x.shape[0]:
        put(x, g, at(x, g) + amount * at(change, first + g))
        g += 1


@wp.func
def correct(step: Step, path: Path, factors: Factors, s: f64, sigma: f64, eps: f64):
    """Solve the equations of the present pieces for the velocity, by a Newton step."""
    find_excess(step, path, s, sigma, eps)
    g = int(0)
    while g < step.free.shape[0]:
        put(path.force, g, wp.cw_mul(at(step.inertia, g), at(path.velocity, g) - at(step.free, g)))
        g += 1
    c = int(0)
    while c < step.first.shape[0]:
        piece = at(path.piece, c)
        if piece != OPEN:
            amount = at(step.mass, c) * carried(piece, at(path.excess, c), at(step.friction, c), eps)
            push(path.force, at(step.first, c), at(step.second, c), at(step.normal, c), amount)
        c += 1
    solve(factors, path.force)
    add(path.velocity, f64(-1.0), path.force, 0)


@wp.func
def rate_along(step: Step, c: int, x: Triples, gradient: wp.vec2d) -> f64:
    """Return the rate of a margin along a direction of velocities."""
    return wp.dot(gradient, relative(x, at(step.first, c), at(step.second, c), at(step.normal, c)))


@wp.func
def solve_updated(step: Step, path: Path, factors: Factors, x: Triples, updates: int):
    """Replace a right-hand side by the solution with the matrix as some updates have made it."""
    solve(factors, x)
    for k in range(updates):
        amount = -rate_along(step, at(path.updated, k), x, at(path.gradient, k)) / at(path.pivot, k)
        if amount != f64(0.0):
            add(x, amount, path.updates, k * x.shape[0])


@wp.func
def find_way(step: Step, path: Path, factors: Factors, drive: Vectors, updates: int, eps: f64):
    """Compute the rate of the velocity for gaps and surface speeds that grow at the rates of the drive."""
    g = int(0)
    while g < step.free.shape[0]:
        put(path.way, g, wp.vec3d())
        g += 1
    c = int(0)
    while c < step.first.shape[0]:
        piece, rate = at(path.piece, c), at(drive, c)
        if piece != OPEN and (rate[0] != f64(0.0) or rate[1] != f64(0.0)):
            rate = wp.vec2d(rate[0], rate[1] / at(step.compliance, c))
            amount = at(step.mass, c) * carried(piece, rate, at(step.friction, c), eps)
            push(path.way, at(step.first, c), at(step.second, c), at(step.normal, c), amount)
        c += 1
    solve_updated(step, path, factors, path.way, updates)


@wp.func
def next_kink(step: Step, path: Path, drive: Vectors, lead: f64, last: int):
    """Return the contact that reaches a side of its piece first, that side, and the way to it.

    The contact whose piece was changed last is at a side, and does not count.
    """
    hit, hit_side, way = int(-1), int(0), f64(wp.inf)
    c = int(0)
    while c < step.first.shape[0]:
        v = relative(path.way, at(step.first, c), at(step.second, c), at(step.normal, c)) - at(drive, c)
        rate = wp.vec2d(lead * v[0], lead * v[1] / at(step.compliance, c))
        put(path.rate, c, rate)
        piece, friction, excess = at(path.piece, c), at(step.friction, c), at(path.excess, c)
        if c != last:
            for side in range(sides_of(piece, friction)):
                falls = -margin(piece, side, rate, friction)
                if falls > f64(0.0):
                    left = margin(piece, side, excess, friction) / falls
                    if left < way:
                        hit, hit_side, way = c, side, left
        c += 1
    return hit, hit_side, wp.max(f64(0.0), way)


@wp.func
def advance(path: Path, way: f64, lead: f64):
    """Move along the path."""
    add(path.velocity, lead * way, path.way, 0)
    c = int(0)
    while c < path.excess.shape[0]:
        put(path.excess, c, at(path.excess, c) + way * at(path.rate, c))
        c += 1


@wp.func
def open_around(step: Step, path: Path, c: int, amount: f64, nearby: int):
    """Open the gaps of the contacts near a contact, by this rate."""
    e = int(0)
    while e < step.first.shape[0]:
        put(path.opening, e, wp.vec2d())
        e += 1
    g = int(0)
    while g < step.free.shape[0]:
        put(path.mark, g, 0)
        g += 1
    put(path.mark, at(step.first, c), 1)
    put(path.front, 0, at(step.first, c))
    count = int(1)
    if at(step.second, c) >= 0:
        put(path.mark, at(step.second, c), 1)
        put(path.front, 1, at(step.second, c))
        count = 2
    begun = int(0)
    for _ in range(nearby):
        end = int(count)
        while begun < end:
            g = at(path.front, begun)
            for k in range(at(step.contact_start, g), at(step.contact_start, g + 1)):
                e = at(step.contact, k)
                put(path.opening, e, wp.vec2d(amount, f64(0.0)))
                other = at(step.first, e) + at(step.second, e) - g
                if at(step.second, e) >= 0 and at(path.mark, other) == 0:
                    put(path.mark, other, 1)
                    put(path.front, count, other)
                    count += 1
            begun += 1


@wp.func
def copy(target: Triples, source: Triples, first: int):
    """Copy into a larger array, from an index on."""
    g = int(0)
    while g < source.shape[0]:
        put(target, first + g, at(source, g))
        g += 1


@wp.func
def tally(path: Path, what: int):
    """Count."""
    put(path.count, what, at(path.count, what) + 1)


@wp.kernel
def follow(step: Step, path: Path, factors: Factors, eps: f64, most: int, most_local: int, nearby: int):
    """Follow the path from the given corrections, for `most` pivots at most, and replace them by others.

    `reached` holds the s at which it ends, and the residual there. The last count is the outcome.
    """
    begin(step, path)
    for k in range(path.count.shape[0]):
        put(path.count, k, 0)
    drive = path.error
    status = int(FOLLOWING)
    s, sigma, lead = f64(1.0), f64(0.0), f64(-1.0)
    snapping = bool(False)
    updates, pivots, local = int(UPDATES), int(0), int(0)
    last = int(-1)
    c = int(0)
    while c < step.first.shape[0]:
        put(path.opening, c, wp.vec2d())
        c += 1
    while status == FOLLOWING:
        if updates >= UPDATES:
            assemble(step, path, factors, eps)
            sign = factor(factors)
            tally(path, FACTORIZATIONS)
            updates = 0
            lead = -sign
            if sign < f64(0.0) and not snapping:
                status = int(AT_FOLD)
            else:
                correct(step, path, factors, s, sigma, eps)
                correct(step, path, factors, s, sigma, eps)
                find_excess(step, path, s, sigma, eps)
                find_way(step, path, factors, drive, updates, eps)
        if status == FOLLOWING:
            c, side, way = next_kink(step, path, drive, lead, last)
            left = wp.where(snapping, sigma, s)
            at_end = lead < f64(0.0) and way >= left
            if at_end:
                way = left
            if c < 0 and not at_end:
                status = int(UNBOUNDED)
            else:
                advance(path, way, lead)
                if snapping:
                    sigma = sigma + lead * way
                    local += 1
                else:
                    s = s + lead * way
                if at_end and not snapping:
                    s = f64(0.0)
                    status = int(DONE)
                elif at_end:
                    snapping = False
                    sigma, lead, last = f64(0.0), f64(-1.0), int(-1)
                    drive = path.error
                    tally(path, SNAPS)
                    find_way(step, path, factors, drive, updates, eps)
                elif pivots >= most or local > most_local:
                    status = wp.where(snapping, AT_FOLD, SPENT)
                    if snapping:
                        copy(path.velocity, path.saved, 0)
                        sigma = f64(0.0)
                else:
                    friction, old = at(step.friction, c), at(path.piece, c)
                    share = f64(1.0) / at(step.compliance, c)
                    p = margin(old, side, wp.vec2d(f64(1.0), f64(0.0)), friction)
                    q = margin(old, side, wp.vec2d(f64(0.0), f64(1.0)), friction)
                    unit = wp.vec2d(p, q) / (p * p + q * q)
                    new = beyond(old, side, at(path.excess, c))
                    jump = carried(new, unit, friction, eps) - carried(old, unit, friction, eps)
                    gradient = wp.vec2d(p, q * share)
                    g = int(0)
                    while g < step.free.shape[0]:
                        put(path.change, g, wp.vec3d())
                        g += 1
                    push(
                        path.change,
                        at(step.first, c),
                        at(step.second, c),
                        at(step.normal, c),
                        at(step.mass, c) * jump,
                    )
                    solve_updated(step, path, factors, path.change, updates)
                    pivot = f64(1.0) + rate_along(step, c, path.change, gradient)
                    rate = rate_along(step, c, path.way, gradient) - wp.dot(gradient, at(drive, c))
                    if pivot < f64(0.0) and not snapping:
                        tally(path, FOLDS)
                        snapping = True
                        local = 0
                        copy(path.saved, path.velocity, 0)
                        open_around(step, path, c, f64(1.0), nearby)
                        drive = path.opening
                        before = lead * rate
                        find_way(step, path, factors, drive, updates, eps)
                        rate = rate_along(step, c, path.way, gradient) - wp.dot(gradient, at(drive, c))
                        if rate * before > f64(0.0):
                            open_around(step, path, c, f64(-1.0), nearby)
                            g = int(0)
                            while g < step.free.shape[0]:
                                put(path.way, g, -at(path.way, g))
                                g += 1
                            rate = -rate
                        lead = f64(1.0)
                    elif pivot < f64(0.0):
                        lead = -lead
                    add(path.way, -rate / pivot, path.change, 0)
                    copy(path.updates, path.change, updates * step.free.shape[0])
                    put(path.updated, updates, c)
                    put(path.gradient, updates, gradient)
                    put(path.pivot, updates, pivot)
                    updates += 1
                    put(path.piece, c, new)
                    pivots += 1
                    last = int(c)
                    if old == OPEN or new == OPEN:
                        put(path.excess, c, wp.vec2d(f64(0.0), at(path.excess, c)[1]))
    find_excess(step, path, s, sigma, eps)
    c = int(0)
    while c < step.first.shape[0]:
        excess = at(path.excess, c) / eps
        limit = at(step.friction, c) * wp.max(f64(0.0), excess[0])
        put(path.dv, c, wp.max(f64(0.0), excess[0]))
        put(path.dvt, c, wp.clamp(excess[1], -limit, limit))
        c += 1
    put(path.reached, 0, s)
    put(path.reached, 1, residual_of(step, path))
    put(path.count, PIVOTS, pivots)
    put(path.count, 4, status)


@wp.kernel
def measure(step: Step, path: Path):
    """Measure the residual of the corrections."""
    put(path.reached, 1, residual_of(step, path))
