"""What holds in every step, whatever the scene.

A step ends with velocities v = v* - M^-1 J^T p, where v* are the free velocities, M the contact masses,
p >= 0 the impulses of its contacts, and J v the velocities vn at which they close. Its residual eta
(kernels/sweeps/residual.py) says that vn <= gap/dt + eta everywhere, and vn >= gap/dt - eta where a contact
carries dv > eta.

Momentum. M_i (v_i - v*_i) is the sum of the impulses of the contacts of grain i: pairs change no total.

Energy. With K(v) = 1/2 v^T M v, from M (v* - v) = J^T p,

    K(v*) - K(v) = 1/2 |v - v*|_M^2 + (v* - v)^T M v = 1/2 |v - v*|_M^2 + p^T J v.

With -vn <= -gap/dt + eta, a contact adds at most p (max(0, -gap)/dt + eta) to K: its mean force p/dt times
the overlap that it separates, and the share of the residual. Without overlaps, contacts only dissipate.
Where 0 < dv <= eta, the residual does not say how fast a contact opens; there vn is taken as it is.

Overlap of grains. |d + dt (v_j - v_i)| is at least its component along n, distance - dt vn, so that the new
gap is at least gap - dt vn >= -dt eta, whatever the gap was. The inner wall is convex too: the same holds.

Overlap with the outer wall. A grain at distance rho ends at |(rho + dt vn, dt vt)|, vt tangential. With
A = radius_out - r and rho + dt vn <= A + dt eta, it overlaps by sqrt((A + dt eta)^2 + (dt vt)^2) - A at most:
of second order in dt, unless a grain crosses the whole disc in one step. The wall behind the origin does not
bound such a step, and a scene that is to be stable does not take it. At a round wall rho + dt vn is at most
sqrt(A^2 - (dt vt)^2) + dt eta, so that dt eta bounds the overlap, as it does that of grains. Its gap can be
negative where nothing overlaps: a grain that slides has to turn, and what makes it do so works on it.
"""

from dataclasses import dataclass

import numpy as np
from same_bits import at_annulus
from schemes import contact_mass, without_contacts

from warpgrains import Scene, Simulation
from warpgrains.base.arrays import FloatArray, IntArray
from warpgrains.solver.statistics import StepReport

EPS = np.finfo(float).eps


@dataclass(frozen=True)
class Step:
    """One step, as seen from outside: arrays before (0) and after it, and what it says of its contacts."""

    scene: Scene
    report: StepReport
    x0: FloatArray
    x: FloatArray
    v_free: FloatArray
    v: FloatArray
    pair: IntArray
    pair_correction: FloatArray
    wall_correction: FloatArray

    @property
    def mass(self) -> FloatArray:
        """M_i of eq. 17b [kg]."""
        return contact_mass(self.scene)

    @property
    def pair_impulse(self) -> FloatArray:
        """Impulses of the pairs along n from i to j [kg m/s]."""
        i, j = self.pair.T
        return self.mass[i] * self.mass[j] / (self.mass[i] + self.mass[j]) * self.pair_correction

    @property
    def size(self) -> float:
        """Largest length in the step [m]: what positions and gaps are rounded against."""
        scene = self.scene
        lengths = (scene.radius_out, self.x0, self.x, scene.dt * self.v, scene.dt * self.v_free)
        return max(np.abs(array).max() for array in lengths)


def checked_step(simulation: Simulation) -> StepReport:
    """Advance by one step, and assert everything above."""
    scene, x0, v0 = simulation.scene, simulation.position, simulation.velocity
    v_free = without_contacts(scene, v0, simulation.state().staggered)
    report = simulation.step()
    pairs, walls = simulation.contacts(), at_annulus(simulation)
    after = (simulation.position, v_free, simulation.velocity)
    step = Step(scene, report, x0, *after, pairs.pair, pairs.correction, walls.correction)
    for array in (step.x, step.v, pairs.correction, walls.correction, [report.residual, report.zeta]):
        assert np.isfinite(array).all()
    assert (pairs.correction > 0.0).all()
    assert_momentum(step)
    assert_energy(step)
    assert_overlaps(step)
    return report


def momentum_rounding(step: Step) -> FloatArray:
    """How far M_i (v_i - v*_i) may be from the sum of its impulses [kg m/s], shape (n,).

    With k contacts, k additions on either side and less than 8 more operations for v* and each product, each
    rounded by at most eps of what has come together by then.
    """
    n, (i, j) = step.scene.n, step.pair.T
    impulses, count = step.mass * np.abs(step.wall_correction), np.ones(n)
    for grain in (i, j):
        impulses += np.bincount(grain, step.pair_impulse, n)
        count += np.bincount(grain, minlength=n)
    return 2.0 * (count + 8.0) * EPS * (step.mass * np.hypot(*step.v_free.T) + impulses)


def assert_momentum(step: Step) -> None:
    """A grain's momentum changes by the impulses of its contacts, the sum of all by those of the walls."""
    mass, (i, j) = step.mass[:, None], step.pair.T
    d = step.x0[j] - step.x0[i]
    impulse = (step.pair_impulse / np.hypot(*d.T))[:, None] * d
    wall_normal = step.x0 / np.hypot(*step.x0.T)[:, None]
    gained = mass * (step.v - step.v_free) + mass * step.wall_correction[:, None] * wall_normal
    rounding = momentum_rounding(step)
    assert (np.abs(gained.sum(axis=0)) <= rounding.sum()).all()
    np.add.at(gained, i, impulse)
    np.subtract.at(gained, j, impulse)
    assert (np.abs(gained) <= rounding[:, None]).all()


def contacts_of(step: Step) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """p [kg m/s], dv [m/s], gap [m] and vn [m/s] of all pairs that carry, and of both walls of all grains."""
    scene, (i, j) = step.scene, step.pair.T
    d, rho = step.x0[j] - step.x0[i], np.hypot(*step.x0.T)
    distance, outward = np.hypot(*d.T), (step.v * step.x0).sum(axis=1) / rho
    vn = ((step.v[i] - step.v[j]) * d).sum(axis=1) / distance
    kinds = [(step.pair_impulse, step.pair_correction, distance - scene.radius[i] - scene.radius[j], vn)]
    outer = scene.radius_out - rho - scene.radius
    if scene.wall == "round":
        vt = (step.v[:, 1] * step.x0[:, 0] - step.v[:, 0] * step.x0[:, 1]) / rho
        outer = np.sqrt((scene.radius_out - scene.radius) ** 2 - (scene.dt * vt) ** 2) - rho
    for sign, gap in ((1.0, outer), (-1.0, rho - scene.radius_in - scene.radius)):
        dv = np.maximum(sign * step.wall_correction, 0.0)
        kinds.append((step.mass * dv, dv, gap, sign * outward))
    p, dv, gap, vn = map(np.concatenate, zip(*kinds, strict=True))
    return p, dv, gap, vn


def assert_energy(step: Step) -> None:
    """Contacts dissipate, but for what separating overlaps takes."""
    mass, eta = step.mass, step.report.residual
    p, dv, gap, vn = contacts_of(step)
    opening = np.where(dv > eta, np.maximum(-gap, 0.0) / step.scene.dt + eta, np.maximum(-vn, 0.0))
    before, after, dissipated = (
        0.5 * (mass * (u * u).sum(axis=1)).sum() for u in (step.v_free, step.v, step.v - step.v_free)
    )
    # Each velocity is off by its momentum's rounding over m; sums of n numbers are off by n eps.
    speeds = np.hypot(*step.v_free.T) + np.hypot(*step.v.T)
    work = (p * opening).sum()
    rounding = 2.0 * (momentum_rounding(step) * speeds).sum() + step.scene.n * EPS * (before + after + work)
    assert after + dissipated <= before + work + rounding


def assert_overlaps(step: Step) -> None:
    """Nothing overlaps by more than residual and outer wall allow, and the report tells the worst."""
    scene, dt, eta = step.scene, step.scene.dt, step.report.residual
    rounding = 16.0 * EPS * step.size  # of a dozen operations
    i, j = np.triu_indices(scene.n, 1)
    gap = np.hypot(*(step.x[j] - step.x[i]).T) - (scene.radius[i] + scene.radius[j])
    assert (gap >= -dt * eta - rounding).all()
    rho, rho0, room = np.hypot(*step.x.T), np.hypot(*step.x0.T), scene.radius_out - scene.radius
    outer, inner = scene.radius_out - rho - scene.radius, rho - scene.radius_in - scene.radius
    normal = step.x0 / rho0[:, None]
    vn = (step.v * normal).sum(axis=1)
    vt = normal[:, 0] * step.v[:, 1] - normal[:, 1] * step.v[:, 0]
    assert (rho0 + dt * vn >= -room).all(), "a grain crosses the disc in one step"
    # at a round wall, rho + dt vn <= root + dt eta, root^2 = A^2 - (dt vt)^2
    reached = np.sqrt(room**2 - (dt * vt) ** 2) if scene.wall == "round" else room
    assert (outer >= room - np.hypot(reached + dt * eta, dt * vt) - rounding).all()
    gaps = [gap, outer]
    if scene.radius_in > 0.0:
        assert (inner >= -dt * eta - rounding).all()
        gaps.append(inner)
    worst = max(0.0, -min(gaps_of_kind.min(initial=np.inf) for gaps_of_kind in gaps))
    assert abs(step.report.overlap - worst) <= 8.0 * EPS * step.size
