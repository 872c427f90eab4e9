"""A program of MODEL.md alone: plain sweeps over all contacts, as its table "The arithmetic" computes them.

It is written from the page, and shares no code with kernels or host.
"""

from dataclasses import dataclass
from math import cos, dist, inf, pi, sin, sqrt
from typing import Any

import numpy as np

from warpgrains import Disc, Scene, Segment

Vector = tuple[float, float]


def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1]


def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1]


def plus(a: Vector, factor: float, b: Vector) -> Vector:
    return a[0] + factor * b[0], a[1] + factor * b[1]


def size(d: Vector) -> float:
    return sqrt(d[0] * d[0] + d[1] * d[1])


def unit(d: Vector) -> Vector:
    return d[0] / size(d), d[1] / size(d)


def turned(c: float, s: float, a: Vector) -> Vector:
    return c * a[0] - s * a[1], s * a[0] + c * a[1]


def along(n: Vector, a: Vector) -> float:
    """a . t"""
    return n[0] * a[1] - n[1] * a[0]


def foot(wall: Any, x: Vector) -> Vector:
    """The point of a wall, or of its center line, to which the normal leads."""
    if isinstance(wall, Segment):
        e = minus(wall.end, wall.start)
        return plus(wall.start, min(max(dot(minus(x, wall.start), e) / dot(e, e), 0.0), 1.0), e)
    if isinstance(wall, Disc):
        return wall.center
    middle, c, radius = 0.5 * (wall.from_angle + wall.to_angle), wall.center, wall.radius
    m, k, d = (cos(middle), sin(middle)), cos(0.5 * (wall.to_angle - wall.from_angle)), minus(x, wall.center)
    if dot(d, m) >= size(d) * k:
        return plus(c, radius / size(d), d)
    s = sqrt(1.0 - k * k)
    return plus(c, radius, turned(k, -s if m[0] * d[1] - m[1] * d[0] < 0.0 else s, m))


def frame(wall: Any, x: Vector, r: float) -> tuple[Vector, float]:
    """Normal and gap (8b)."""
    d = minus(foot(wall, x), x)
    n = unit(d)
    if not isinstance(wall, Disc):
        return n, size(d) - r
    if wall.inside:
        return (-n[0], -n[1]), (wall.radius - size(d)) - r
    return n, size(d) - (r + wall.radius)


def end_of(wall: Any, x: Vector) -> int:
    """The end that is the foot of x, 0 or 1, or -1."""
    if isinstance(wall, Disc):
        return -1
    if isinstance(wall, Segment):
        e = minus(wall.end, wall.start)
        share = dot(minus(x, wall.start), e) / dot(e, e)
        return 0 if share <= 0.0 else 1 if share >= 1.0 else -1
    middle, half = 0.5 * (wall.from_angle + wall.to_angle), 0.5 * (wall.to_angle - wall.from_angle)
    m, d = (cos(middle), sin(middle)), minus(x, wall.center)
    if dot(d, m) >= size(d) * cos(half):
        return -1
    return 0 if m[0] * d[1] - m[1] * d[0] < 0.0 else 1


def length(wall: Any) -> float:
    """The length of a segment, and the diameter of a round wall."""
    return dist(wall.start, wall.end) if isinstance(wall, Segment) else 2.0 * wall.radius


def ends(wall: Any) -> list[Vector]:
    """The ends, 0 and 1."""
    if isinstance(wall, Segment):
        return [wall.start, wall.end]
    angles = [] if isinstance(wall, Disc) else [wall.from_angle, wall.to_angle]
    return [plus(wall.center, wall.radius, (cos(angle), sin(angle))) for angle in angles]


def is_joined(p: Vector, wall: Any, other: Any) -> bool:
    """Whether an end p of a wall lies on another wall, and both move alike."""
    apart = size(minus(foot(other, p), p))
    apart = abs(apart - other.radius) if isinstance(other, Disc) else apart
    thin = [length(one) / 2.0 for one in (wall, other) if not isinstance(one, Disc)]
    motions = [
        (one.velocity, one.angular_velocity, one.from_time, one.to_time, one.pivot or one.middle)
        for one in (wall, other)
    ]
    return apart <= 1e-9 * max(thin) and (motions[0] == motions[1] or not (wall.moves or other.moves))


def frame_at_joint(
    walls: list[Any], joined: list[list[int]], b: int, x: Vector, r: float, radius_out: float
) -> tuple[Vector, float]:
    """Normal and gap (8c); `joined` has the walls of the joints at both ends of wall b."""
    wall, end = walls[b], end_of(walls[b], x)
    n, gap = frame(wall, x, r)
    if end < 0 or gap > r or not joined[end]:
        return n, gap
    gap_k, k = min((frame(walls[one], x, r)[1], one) for one in (b, *joined[end]))
    if k == b:
        return n, gap
    p, m = foot(wall, x), frame(walls[k], x, r)[0]
    t = (
        unit(minus(wall.end, wall.start))
        if isinstance(wall, Segment)
        else turned(0.0, 1.0, unit(minus(p, wall.center)))
    )
    t = t if end == 0 else (-t[0], -t[1])
    rises, sizes = True, sorted((length(wall), length(walls[k])))
    if isinstance(walls[k], Segment):
        left = turned(0.0, 1.0, unit(minus(walls[k].end, walls[k].start)))
        m = left if dot(m, left) > 0.0 else (-left[0], -left[1])
    else:
        rises = size(minus(x, walls[k].center)) < walls[k].radius
        m = unit(minus(p, walls[k].center))
    rises = rises and dot(t, m) < -1e-9 and sizes[0] >= r
    if rises and end_of(walls[k], x) >= 0 and size(minus(foot(walls[k], x), p)) > 1e-9 * sizes[1]:
        return n, gap
    if not rises or end_of(walls[k], x) >= 0:
        return n, gap + 2.0 * radius_out
    left = -t[1], t[0]
    h = dot(left, minus(x, p))
    return (t[1], -t[0]) if h > 0.0 else left, max(abs(h) - r, gap_k)


@dataclass
class Contact:
    """A contact of grain i with grain j, or with wall j."""

    i: int
    j: int
    at_wall: bool
    n: Vector = (0.0, 0.0)
    gap_rate: float = inf
    back_rate: float = inf
    reach: float = inf
    surface: float = 0.0
    mu: float = 0.0
    e: float = 0.0
    dv: float = 0.0
    dvt: float = 0.0
    mu_r: float = 0.0
    spin: float = 0.0
    dvr: float = 0.0


class Twin:
    def __init__(self, scene: Scene):
        self.scene, self.steps, self.staggered = scene, 0, False
        self.x = list(map(tuple, scene.position.tolist()))
        self.v = list(map(tuple, scene.velocity.tolist()))
        self.r, self.m, n = scene.radius.tolist(), scene.mass.tolist(), scene.n
        self.spin, self.rough, self.driven = (scene.spin.tolist(), scene.has_friction, scene.has_driven_walls)
        self.two = (self.rough or self.driven) and scene.radius_in > 0.0
        inner = [Disc((0.0, 0.0), scene.radius_in)] if self.two else []
        self.walls: list[Any] = [None, *inner, *scene.walls]
        can_join = [
            b for b in range(1 + self.two, len(self.walls)) if getattr(self.walls[b], "force", None) is None
        ]
        self.joined = [
            [
                [k for k in can_join if k != b and b in can_join and is_joined(p, wall, self.walls[k])]
                for p in ends(wall)
            ]
            if wall
            else []
            for b, wall in enumerate(self.walls)
        ]
        mu = scene.wall_frictions[:1] + scene.wall_frictions[2 - self.two :]
        self.force, self.inverse, self.way = ([0.0] * len(self.walls) for _ in range(3))
        self.speed, self.direction = [0.0] * len(self.walls), [(0.0, 0.0)] * len(self.walls)
        self.way[0] = scene.radius_out
        if scene.pressure is not None:
            self.inverse[0] = 1.0 / (
                float(np.sum(scene.mass)) if scene.wall_mass is None else scene.wall_mass
            )
        for k, wall in enumerate(self.walls):
            if isinstance(wall, Segment) and wall.force is not None and wall.mass is not None:
                e, length = minus(wall.end, wall.start), dist(wall.start, wall.end)
                self.direction[k] = -(e[1] / length), e[0] / length
                self.inverse[k], self.force[k] = 1.0 / wall.mass, wall.force
        leapfrog, dt = scene.scheme == "leapfrog", scene.dt
        self.mass = [m + (scene.drag * dt) / 2.0 if leapfrog else m for m in self.m]
        rim_mass = [
            m + (scene.spin_drag * dt) / (r * r) if leapfrog else m
            for m, r in zip(self.m, self.r, strict=True)
        ]
        self.k = [(2.0 * m) / j for m, j in zip(self.mass, rim_mass, strict=True)]
        e = scene.wall_restitutions[:1] + scene.wall_restitutions[2 - self.two :]
        mu_r = scene.wall_rolling_frictions[:1] + scene.wall_rolling_frictions[2 - self.two :]
        between = {"mu": scene.friction, "e": scene.restitution, "mu_r": scene.rolling_friction}
        self.contacts = [Contact(i, j, False, **between) for i in range(n) for j in range(i + 1, n)]
        every = range(len(self.walls))
        at_walls = [{"mu": mu[b], "e": e[b], "mu_r": mu_r[b]} for b in every]
        self.contacts += [Contact(i, b, True, **at_walls[b]) for i in range(n) for b in every]

    def freeze(self, contact: Contact) -> None:
        scene, x, r, away = self.scene, self.x[contact.i], self.r[contact.i], 0.0
        if not contact.at_wall:
            d = minus(self.x[contact.j], x)
            contact.n, contact.gap_rate = unit(d), (size(d) - (r + self.r[contact.j])) / scene.dt
        elif contact.j == 0:
            contact.n, contact.gap_rate = unit(x), ((self.way[0] - size(x)) - r) / scene.dt
            contact.surface = self.way[0] * scene.angular_velocity_out
            contact.spin = scene.angular_velocity_out
            if scene.radius_in > 0.0 and not self.two:
                contact.back_rate = ((size(x) - scene.radius_in) - r) / scene.dt
            if scene.wall == "round":
                contact.reach = (scene.radius_out - r) / scene.dt
        else:
            contact.n, gap, contact.surface, away, contact.spin = self.frame_inside(contact.j, x, r)
            contact.gap_rate = gap / scene.dt
        self.let_bounce(contact, away)

    def let_bounce(self, contact: Contact, w: float) -> None:
        """(35), for the velocities and wall speeds that the last step has left."""
        v, n = self.v[contact.i], contact.n
        vn = dot(v if contact.at_wall else minus(v, self.v[contact.j]), n)
        if contact.at_wall and self.driven:
            vn = vn - self.levers(contact)[0] * self.speed[contact.j]
        a, vt, b = contact.reach, along(n, v), contact.gap_rate
        if a < inf:
            b = b - (a - sqrt(max(0.0, a * a - vt * vt)))
        least, e = self.scene.restitution_speed, contact.e
        if e > 0.0 and vn > b and vn - w > least:
            contact.gap_rate = min(b, w - e * (vn - w)) + (contact.gap_rate - b)
        if e > 0.0 and -vn > contact.back_rate and -vn > least:
            contact.back_rate = min(contact.back_rate, -(e * -vn))

    def frame_inside(self, b: int, x: Vector, r: float) -> tuple[Vector, float, float, float, float]:
        """Normal, gap, speeds of the surface along the tangent and the normal, and its spin."""
        wall, dt = self.walls[b], self.scene.dt
        if self.two and b == 1:
            spin = self.scene.angular_velocity_in
            return *frame(wall, x, r), (-self.scene.radius_in) * spin, 0.0, spin
        joint = self.walls, self.joined[b], b
        if not wall.moves:
            q, d = self.way[b], self.direction[b]
            return *frame_at_joint(*joint, (x[0] - q * d[0], x[1] - q * d[1]), r, self.way[0]), 0.0, 0.0, 0.0
        (px, py), (vx, vy), w = wall.pivot or wall.middle, wall.velocity, wall.angular_velocity
        to_time = inf if wall.to_time is None else wall.to_time
        times = self.steps * dt, (self.steps + 1) * dt
        before, tau = (min(max(t, wall.from_time), to_time) - wall.from_time for t in times)
        c, s = cos(w * tau), sin(w * tau)
        dx, dy = x[0] - ((px - (c * px - s * py)) + vx * tau), x[1] - ((py - (s * px + c * py)) + vy * tau)
        n, gap = frame_at_joint(*joint, (c * dx + s * dy, c * dy - s * dx), r, self.way[0])
        n = turned(c, s, n)
        if not tau - before > 0.5 * (times[1] - times[0]):
            return n, gap, 0.0, 0.0, 0.0
        y = plus(x, r + gap, n)
        u = (vx + w * (py + vy * tau)) - w * y[1], (vy - w * (px + vx * tau)) + w * y[0]
        return n, gap, along(n, u), dot(u, n), w

    def shares(self, contact: Contact) -> tuple[float, float]:
        if contact.at_wall:
            return 1.0, 0.0
        i, j = self.mass[contact.i], self.mass[contact.j]
        return j / (i + j), i / (i + j)

    def levers(self, contact: Contact) -> tuple[float, float, float, float]:
        """g, h, g_t and h_t (28); 0 where no wall is driven."""
        if not (contact.at_wall and self.driven):
            return 0.0, 0.0, 0.0, 0.0
        d, mass, inverse = self.direction[contact.j], self.mass[contact.i], self.inverse[contact.j]
        g, gt = (1.0, 0.0) if contact.j == 0 else (dot(contact.n, d), along(contact.n, d))
        return g, (g * mass) * inverse, gt, (gt * mass) * inverse

    def slopes(self, contact: Contact) -> tuple[float, float, float]:
        """share_i k_i, share_j k_j or g_t h_t, and 1 / K_t (22)."""
        (i, j), (_, _, gt, ht) = self.shares(contact), self.levers(contact)
        at_i, at_j = i * self.k[contact.i], gt * ht if contact.at_wall else j * self.k[contact.j]
        return at_i, at_j, 1.0 / ((1.0 + at_i) + at_j)

    def sides(self, contact: Contact, out: float, back: float) -> tuple[float, float]:
        """The two maxima of (8), with these corrections in the place of dv_b."""
        v = self.next[contact.i] if contact.at_wall else minus(self.next[contact.i], self.next[contact.j])
        vn, vt, a, rate = dot(v, contact.n), along(contact.n, v), contact.reach, contact.gap_rate
        if a < inf:
            rate = rate - (a - sqrt(max(0.0, a * a - vt * vt)))
        return max(0.0, (vn + out) - rate), max(0.0, (-vn - back) - contact.back_rate)

    def changes(self, contact: Contact, is_visit: bool = True) -> tuple[float, float, float]:
        """The changes dv and b that a contact needs, and K; in a visit, dv moves a wall before b is found."""
        i, j, n, dv = contact.i, contact.j, contact.n, contact.dv
        v = self.next[i] if contact.at_wall else minus(self.next[i], self.next[j])
        vn, stiffness = dot(v, n), 1.0
        g, h, gt, _ = self.levers(contact)
        if contact.at_wall and self.driven:
            stiffness = 1.0 + g * h
            change = max(0.0, dv + ((vn - g * self.speed[j]) - contact.gap_rate) / stiffness) - dv
        else:
            out, back = self.sides(contact, dv, dv)
            change = (out - back) - dv
        if not self.rough:
            return change, 0.0, stiffness
        if contact.at_wall:
            speed = self.speed[j] + change * h if is_visit else self.speed[j]
            vt = along(n, v) + (self.rim[i] - (contact.surface + gt * speed))
        else:
            vt = (along(n, v) + self.rim[i]) + self.rim[j]
        limit = contact.mu * (dv + change)
        slip = min(limit, max(-limit, contact.dvt + vt * self.slopes(contact)[2])) - contact.dvt
        return change, slip, stiffness

    def apply(self, contact: Contact, dv: float, b: float) -> None:
        i, j, n = contact.i, contact.j, contact.n
        push, (at_i, at_j) = (dv * n[0] + b * -n[1], dv * n[1] + b * n[0]), self.shares(contact)
        self.next[i] = self.next[i][0] - push[0] * at_i, self.next[i][1] - push[1] * at_i
        rims = self.slopes(contact)
        self.rim[i] -= b * rims[0]
        if contact.at_wall:
            _, h, _, ht = self.levers(contact)
            self.speed[j] = (self.speed[j] + dv * h) + b * ht
            return
        self.rim[j] -= b * rims[1]
        self.next[j] = plus(self.next[j], at_j, push)

    def rolling(self, contact: Contact, dv: float) -> tuple[float, float]:
        """The change of dv_r that a contact needs, and 1 / K_r (37)."""
        i, j, (at_i, at_j, _) = contact.i, contact.j, self.slopes(contact)
        if contact.at_wall:
            slowed, vr = 1.0 / at_i, self.rim[i] - self.r[i] * contact.spin
        else:
            c = self.r[j] / (self.r[i] + self.r[j])
            d = 1.0 - c
            slowed, vr = 1.0 / ((c * c) * at_i + (d * d) * at_j), c * self.rim[i] - d * self.rim[j]
        limit = contact.mu_r * dv
        return min(limit, max(-limit, contact.dvr + slowed * vr)) - contact.dvr, slowed

    def turn(self, contact: Contact, b: float) -> None:
        i, j, (at_i, at_j, _) = contact.i, contact.j, self.slopes(contact)
        c = 1.0 if contact.at_wall else self.r[j] / (self.r[i] + self.r[j])
        self.rim[i] -= (b * c) * at_i
        if not contact.at_wall:
            self.rim[j] += (b * (1.0 - c)) * at_j

    def begin(self) -> None:
        """Free velocities, and the corrections that are kept."""
        self.next, self.rim, self.speed = list(self.free[0]), list(self.free[1]), list(self.free[2])
        for contact in self.contacts:
            self.apply(contact, contact.dv, contact.dvt)
            self.turn(contact, contact.dvr)

    def residual(self) -> float:
        """eta, of (12), (25), (30) and (38), for recomputed velocities."""
        swept = self.next, self.rim, self.speed
        self.begin()
        eta = 0.0
        for contact in self.contacts:
            change, slip, stiffness = self.changes(contact, is_visit=False)
            if contact.back_rate < inf:  # each side by itself
                own = max(contact.dv, 0.0), max(-contact.dv, 0.0)
                out, back = self.sides(contact, own[0], -own[1])
                change = max(abs(out - own[0]), abs(back - own[1]))
            eta = max(eta, stiffness * abs(change), abs(slip) / self.slopes(contact)[2])
            if self.scene.has_rolling_friction:
                turned, slowed = self.rolling(contact, contact.dv + change)
                eta = max(eta, abs(turned) / slowed)
        self.next, self.rim, self.speed = swept
        return eta

    def free_velocities(self) -> None:
        scene, dt = self.scene, self.scene.dt
        first, then = (
            scene.scheme == "leapfrog" and not self.staggered,
            scene.scheme == "leapfrog" and self.staggered,
        )
        g = tuple(scene.gravity)
        if scene.gravity_rate:
            angle = scene.gravity_rate * (self.steps * dt)
            g = turned(cos(angle), sin(angle), g)  # type: ignore[arg-type]
        free, rim = [], []
        for v, m, r, w in zip(self.v, self.m, self.r, self.spin, strict=True):
            a, inertia = (scene.drag * dt) / (2.0 * m), ((0.5 * m) * r) * r
            b = (scene.spin_drag * dt) / (2.0 * inertia)
            if first:
                free.append(tuple((u + (0.5 * dt) * k) / (1.0 + a) for u, k in zip(v, g, strict=True)))
                w = w / (1.0 + b)
            elif then:
                free.append(tuple(((1.0 - a) * u + dt * k) / (1.0 + a) for u, k in zip(v, g, strict=True)))
                w = ((1.0 - b) * w) / (1.0 + b)
            else:
                free.append(tuple(u + dt * (k - (scene.drag / m) * u) for u, k in zip(v, g, strict=True)))
                w = w - dt * ((scene.spin_drag / inertia) * w)
            rim.append(r * w)
        force = [-((scene.pressure or 0.0) * ((2.0 * pi) * self.way[0])), *self.force[1:]]
        kick = 0.5 * dt if first else dt
        speed = [s + kick * (f * i) for s, f, i in zip(self.speed, force, self.inverse, strict=True)]
        self.free: Any = free, rim, speed

    def step(self) -> int:
        """Take a step, and return its iterations."""
        scene, dt, iterations, stops = self.scene, self.scene.dt, 0, False
        for contact in self.contacts:
            self.freeze(contact)
        self.free_velocities()
        self.begin()
        while not stops:
            iterations, zeta = iterations + 1, 0.0
            for contact in self.contacts:
                dv, b, stiffness = self.changes(contact)
                self.apply(contact, dv, b)
                contact.dv += dv
                contact.dvt += b
                turned = self.rolling(contact, contact.dv)[0] if scene.has_rolling_friction else 0.0
                self.turn(contact, turned)
                contact.dvr += turned
                _, _, gt, ht = self.levers(contact)
                zeta = max(zeta, stiffness * abs(dv), (1.0 + gt * ht) * abs(b), abs(turned))
            stops = iterations == scene.max_iterations
            if scene.stop != "residual":
                stops = stops or zeta <= scene.tolerance
            elif (iterations == 1 or iterations % 10 == 0) and zeta <= 2.0 * scene.tolerance:
                stops = stops or self.residual() <= scene.tolerance
        self.x = [plus(x, dt, v) for x, v in zip(self.x, self.next, strict=True)]
        self.v, self.way = self.next, [q + dt * s for q, s in zip(self.way, self.speed, strict=True)]
        if self.rough:
            self.spin = [u / r for u, r in zip(self.rim, self.r, strict=True)]
        self.staggered, self.steps = scene.scheme == "leapfrog", self.steps + 1
        return iterations
