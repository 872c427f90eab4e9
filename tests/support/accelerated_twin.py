"""The accelerated method in plain Python, contact by contact over all pairs (kernels/MODEL.md, eqs. 13, 14).

There is no list of near contacts. Products and sums of velocities, corrections and the residual are those of
that page, in the same order. Only the sums of the test (14) are added in another order. Vectors are complex
numbers.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from math import inf, sqrt

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
class Contact:
    """Contact of two grains, or of grain i and both circles of the annulus (j is None).

    `n` is the normal, `mu` the effective mass [kg], `dv` the correction and `last` that before the last sweep
    [m/s]. `share` holds the parts of a correction that change the velocities of i and j.
    """

    i: int
    j: int | None
    n: complex
    tangent: float  # gap / dt; at the walls, of the outer wall [m/s]
    mu: float
    dv: float
    last: float
    share: tuple[float, float] = (1.0, 0.0)
    inner: float = inf  # gap / dt of the inner wall [m/s]
    reach: float = inf  # A / dt of (18), if the wall is round [m/s]

    def vn(self, v: Velocities) -> float:
        return dot(v[self.i] if self.j is None else v[self.i] - v[self.j], self.n)

    def apply(self, v: Velocities, dv: float) -> None:
        v[self.i] -= dv * self.n * self.share[0]
        if self.j is not None:
            v[self.j] += dv * self.n * self.share[1]

    def gap(self, v: Velocities) -> float:
        if self.reach == inf:
            return self.tangent
        along = self.n.real * v[self.i].imag - self.n.imag * v[self.i].real
        return self.tangent - (self.reach - sqrt(max(0.0, self.reach * self.reach - along * along)))

    def change(self, v: Velocities, y: float, omega: float) -> float:
        vn, gap = self.vn(v), self.gap(v)
        if self.j is not None:
            return max(0.0, y + omega * (vn - gap)) - y
        return projection(omega * vn + y, omega * gap, omega * self.inner) - y

    def violation(self, v: Velocities) -> float:
        return abs(projection(self.vn(v), self.gap(v), self.inner))

    def is_near(self, v: Velocities, near: float) -> bool:
        vn, gap = self.vn(v), self.gap(v)
        if self.j is not None:
            return vn - gap + 2.0 * near > 0.0
        return projection(vn, gap - near, self.inner - near) != 0.0

    def cost(self, dv: float, v: Velocities) -> float:
        return dv * self.gap(v) if dv >= 0.0 or self.inner == inf else -dv * self.inner

    def residual(self, v: Velocities) -> float:
        vn, outer, inner = self.vn(v), max(0.0, self.dv), max(0.0, -self.dv)
        worst = abs(max(0.0, vn + outer - self.gap(v)) - outer)
        return max(worst, abs(max(0.0, -vn + inner - self.inner) - inner))


def projection(pushed: float, outer: float, inner: float) -> float:
    return max(0.0, pushed - outer) - max(0.0, -pushed - inner)


class AcceleratedTwin:
    """Simulation of a scene from its start by the accelerated method, with contacts in sequential order."""

    def __init__(self, scene: Scene):
        self.scene = scene
        self.position, self.velocity = scene.position.copy(), scene.velocity.copy()
        self.staggered = False
        self.corrections = [0.0] * (scene.n * (scene.n + 1) // 2)  # of all pairs, then at the walls [m/s]
        self.iterations, self.zeta, self.residual = 0, 0.0, 0.0

    def step(self) -> None:
        scene = self.scene
        free = free_velocity(scene, self.velocity, self.staggered)
        self._free: Velocities = [complex(*v) for v in free]
        self._contacts = [*self._listed()]
        self._v = self._made_by_corrections()
        self._iterate()
        self.velocity = np.array([[v.real, v.imag] for v in self._v])
        self.position = self.position + scene.dt * self.velocity
        self.staggered = scene.scheme == "leapfrog"
        self.corrections = [c.dv for c in self._contacts]

    def _listed(self) -> Iterator[Contact]:
        """Yield the contacts of all pairs, and then those of all grains with the walls."""
        scene, x, dt = self.scene, [complex(*x) for x in self.position], self.scene.dt
        m, r, carried = contact_mass(scene).tolist(), scene.radius.tolist(), iter(self.corrections)
        for i, j in combinations(range(scene.n), 2):
            (n, distance), dv = normal(x[j] - x[i]), next(carried)
            share = m[j] / (m[i] + m[j]), m[i] / (m[i] + m[j])
            yield Contact(i, j, n, (distance - (r[i] + r[j])) / dt, m[i] * share[0], dv, dv, share)
        for i, dv in enumerate(carried):
            n, distance = normal(x[i])
            inner = (distance - scene.radius_in - r[i]) / dt if scene.radius_in > 0.0 else inf
            reach = (scene.radius_out - r[i]) / dt if scene.wall == "round" else inf
            outer = (scene.radius_out - distance - r[i]) / dt
            yield Contact(i, None, n, outer, m[i], dv, dv, inner=inner, reach=reach)

    def _made_by_corrections(self) -> Velocities:
        v = self._free.copy()
        for contact in self._contacts:
            contact.apply(v, contact.dv)
        return v

    def _look(self, zeta: float) -> float:
        """Choose the working set: contacts that carry a correction, or are near for this `zeta` [m/s].

        Returns the largest violation of a contact that carries no correction [m/s].
        """
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
        """Extrapolate the corrections to y and do the k-th sweep from there.

        Returns whether the result passes the test (14). If not, it is undone.
        """
        beta, omega, mass = self._beta, 1.0 + self._rho * self._beta, contact_mass(self.scene).tolist()
        before = self._v
        self._v = [v + beta * (v - last) for v, last in zip(before, self._v_last, strict=True)]
        self._v_last = before
        kinetic = sum(m * dot(y - v, y + v) for m, y, v in zip(mass, self._v, before, strict=True)) / 2.0
        rounding = 2e-15 * beta * sum(m * dot(v, v) for m, v in zip(mass, before, strict=True))
        climb, gains, uphill, self.zeta = kinetic, 0.0, 0.0, 0.0
        for c in self._working:
            y = c.dv + beta * (c.dv - c.last)
            vn, dv = c.vn(self._v), c.change(self._v, y, omega)
            new = y + dv
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
