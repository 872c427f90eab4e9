"""The accelerated method in plain Python, contact by contact over all pairs (kernels/MODEL.md, eqs. 13, 14).

It has no list. Every product and sum of a velocity, a correction or the residual is that of the page, in its
order; the sums of (14), which only decide, are added in another. Vectors are complex numbers.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from schemes import contact_mass

from warpgrains import Scene
from warpgrains.reference.reference import free_velocity

Velocities = list[complex]


def dot(a: complex, b: complex) -> float:
    return a.real * b.real + a.imag * b.imag


def normal(d: complex) -> tuple[complex, float]:
    length = sqrt(d.real * d.real + d.imag * d.imag)
    return d / length, length


@dataclass
class Pair:
    """Two grains that may touch."""

    i: int
    j: int
    n: complex
    gap: float  # gap / dt [m/s]
    share: tuple[float, float]
    mu: float
    dv: float
    last: float

    def vn(self, v: Velocities) -> float:
        return dot(v[self.i] - v[self.j], self.n)

    def apply(self, v: Velocities, dv: float) -> None:
        v[self.i] -= dv * self.n * self.share[0]
        v[self.j] += dv * self.n * self.share[1]

    def corrected(self, v: Velocities, y: float, omega: float) -> tuple[float, float]:
        dv = max(0.0, y + omega * (self.vn(v) - self.gap)) - y
        return y + dv, dv

    def violation(self, v: Velocities) -> float:
        return max(0.0, self.vn(v) - self.gap)

    def is_near(self, v: Velocities, near: float) -> bool:
        return self.vn(v) - self.gap + 2.0 * near > 0.0

    def cost(self, dv: float, v: Velocities) -> float:
        return dv * self.gap

    def residual(self, v: Velocities) -> float:
        return abs(max(0.0, self.vn(v) + self.dv - self.gap) - self.dv)


@dataclass
class Wall:
    """A grain that may touch the walls, tangent or round."""

    i: int
    n: complex
    tangent: float  # gap / dt of the outer wall, and of the inner one if there is one [m/s]
    inner: float | None
    reach: float | None  # A / dt of (18), where the wall is round [m/s]
    mu: float
    dv: float
    last: float

    def vn(self, v: Velocities) -> float:
        return dot(v[self.i], self.n)

    def apply(self, v: Velocities, dv: float) -> None:
        v[self.i] -= dv * self.n

    def outer(self, v: Velocities) -> float:
        if self.reach is None:
            return self.tangent
        along = self.n.real * v[self.i].imag - self.n.imag * v[self.i].real
        return self.tangent - (self.reach - sqrt(max(0.0, self.reach * self.reach - along * along)))

    def corrected(self, v: Velocities, y: float, omega: float) -> tuple[float, float]:
        vn = omega * self.vn(v)
        projected = max(0.0, vn + y - omega * self.outer(v))
        if self.inner is not None:
            projected -= max(0.0, -vn - y - omega * self.inner)
        dv = projected - y
        return y + dv, dv

    def violation(self, v: Velocities) -> float:
        return abs(self.corrected(v, 0.0, 1.0)[1])

    def is_near(self, v: Velocities, near: float) -> bool:
        vn = self.vn(v)
        projected = max(0.0, vn - (self.outer(v) - near))
        if self.inner is not None:
            projected -= max(0.0, -vn - (self.inner - near))
        return projected != 0.0

    def cost(self, dv: float, v: Velocities) -> float:
        return dv * self.outer(v) if dv >= 0.0 or self.inner is None else -dv * self.inner

    def residual(self, v: Velocities) -> float:
        vn, outer, inner = self.vn(v), max(0.0, self.dv), max(0.0, -self.dv)
        worst = abs(max(0.0, vn + outer - self.outer(v)) - outer)
        if self.inner is None:
            return worst
        return max(worst, abs(max(0.0, -vn + inner - self.inner) - inner))


class AcceleratedTwin:
    """A scene from its start, in sequential order."""

    def __init__(self, scene: Scene):
        self.scene = scene
        self.position, self.velocity = scene.position.copy(), scene.velocity.copy()
        self.staggered = False
        self.pair_correction = np.zeros(scene.n * (scene.n - 1) // 2)
        self.wall_correction = np.zeros(scene.n)
        self.iterations, self.zeta, self.residual = 0, 0.0, 0.0

    def step(self) -> None:
        scene = self.scene
        free = free_velocity(scene, self.velocity, self.staggered)
        self._free: Velocities = [complex(*v) for v in free]
        self._contacts = [*self._pairs(), *self._walls()]
        self._v = self._made_by_corrections()
        self._iterate()
        self.velocity = np.array([[v.real, v.imag] for v in self._v])
        self.position = self.position + scene.dt * self.velocity
        self.staggered = scene.scheme == "leapfrog"
        dv = np.array([c.dv for c in self._contacts])
        self.pair_correction, self.wall_correction = dv[: -scene.n], dv[-scene.n :]

    def _pairs(self) -> list[Pair]:
        scene, x, pairs = self.scene, [complex(*x) for x in self.position], []
        m, r = contact_mass(scene).tolist(), scene.radius.tolist()
        places = zip(*np.triu_indices(scene.n, 1), self.pair_correction.tolist(), strict=True)
        for i, j, dv in places:
            n, distance = normal(x[j] - x[i])
            share = m[j] / (m[i] + m[j]), m[i] / (m[i] + m[j])
            gap = (distance - (r[i] + r[j])) / scene.dt
            pairs.append(Pair(i, j, n, gap, share, m[i] * share[0], dv, dv))
        return pairs

    def _walls(self) -> list[Wall]:
        scene, walls = self.scene, []
        m, r = contact_mass(scene).tolist(), scene.radius.tolist()
        for i, dv in enumerate(self.wall_correction.tolist()):
            n, distance = normal(complex(*self.position[i]))
            gap = (scene.radius_out - distance - r[i]) / scene.dt
            inner = (distance - scene.radius_in - r[i]) / scene.dt if scene.radius_in > 0.0 else None
            reach = (scene.radius_out - r[i]) / scene.dt if scene.wall == "round" else None
            walls.append(Wall(i, n, gap, inner, reach, m[i], dv, dv))
        return walls

    def _made_by_corrections(self) -> Velocities:
        v = self._free.copy()
        for contact in self._contacts:
            contact.apply(v, contact.dv)
        return v

    def _look(self, zeta: float) -> float:
        """Choose the working set; return by how much the contacts without corrections are violated."""
        near = min(0.25 * zeta, 0.01 * float(self.scene.radius.min()) / self.scene.dt)
        self._working, violation = [], 0.0
        for c in self._contacts:
            carries = c.dv != 0.0 or c.last != 0.0
            if carries or c.is_near(self._v, near):
                self._working.append(c)
            violation = max(violation, 0.0 if carries else c.violation(self._v))
        return violation

    def _iterate(self) -> None:
        scene = self.scene
        on_residual = scene.stop != "zeta"
        self._v_last, self._t, self._beta, self._rho = self._v.copy(), 1.0, 0.0, 0.25
        self._look(0.0)
        for k in range(1, scene.max_iterations + 1):
            kept = self._sweep(k)
            self.iterations = k
            checking = on_residual and kept and (k == 1 or k % 10 == 0) and self.zeta <= 2.0 * scene.tolerance
            quiet = not on_residual and kept and self.zeta <= scene.tolerance
            rebuilding = checking or (kept and k % 100 == 0)
            if rebuilding or quiet or k == scene.max_iterations:
                rebuilt = self._made_by_corrections()
                self.residual = max(c.residual(rebuilt) for c in self._contacts)
                zipped = zip(self._v_last, rebuilt, self._v, strict=True)
                self._v_last = [last + (new - v) for last, new, v in zipped]
                self._v = rebuilt
                if on_residual and self.residual <= scene.tolerance:
                    return
            if k in (1, 2, 4, 8) or k % 10 == 0 or quiet or k == scene.max_iterations:
                violation = self._look(self.zeta)
                if not on_residual and kept:
                    self.zeta = max(self.zeta, violation)
                if quiet and self.zeta <= scene.tolerance:
                    return

    def _sweep(self, k: int) -> bool:
        """Go on to y and sweep from there, the k-th time; return whether it is kept."""
        beta, omega, mass = self._beta, 1.0 + self._rho * self._beta, contact_mass(self.scene).tolist()
        before = self._v
        self._v = [v + beta * (v - last) for v, last in zip(before, self._v_last, strict=True)]
        self._v_last = before
        kinetic = sum(m * dot(y - v, y + v) for m, y, v in zip(mass, self._v, before, strict=True)) / 2.0
        rounding = 2e-15 * beta * sum(m * dot(v, v) for m, v in zip(mass, before, strict=True))
        climb, gains, uphill, self.zeta = kinetic, 0.0, 0.0, 0.0
        for c in self._working:
            y = c.dv + beta * (c.dv - c.last)
            vn, (new, dv) = c.vn(self._v), c.corrected(self._v, y, omega)
            climb += c.mu * (c.cost(y, self._v) - c.cost(c.dv, self._v))
            gains += c.mu * (dv * (vn - dv / 2.0) - (c.cost(new, self._v) - c.cost(y, self._v)))
            uphill += c.mu * (y - new) * (new - c.dv)
            c.apply(self._v, dv)
            c.last, c.dv = c.dv, new
            self.zeta = max(self.zeta, abs(dv))
        kept = not (beta > 0.0 and climb > 0.99 * gains + rounding)
        if not kept:
            self._rho *= 0.8
            self._v = before.copy()
            for c in self._working:
                c.dv = c.last
        if not kept or uphill > 0.0:
            self._t, self._beta = max(1.0, self._t / 2.0), 0.0
        else:
            t, self._t = self._t, (1.0 + sqrt(1.0 + 4.0 * self._t * self._t)) / 2.0
            self._beta = (t - 1.0) / self._t
            if k == 1:
                self._first_zeta = self.zeta
            if self.zeta < 6.0 * self.scene.tolerance:
                fall = 1.5 * sqrt(self._first_zeta / self.scene.tolerance)
                self._t = min(self._t, max(24.0, fall, 0.2 * k))
        return kept
