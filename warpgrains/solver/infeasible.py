"""Proofs that a step has no solution, and the grains that cannot fit.

The contacts of a step demand J v <= b, with (J v)_c = (v_i - v_j) . n for a pair, v_i . n at a wall (n points
into the wall), and b_c = gap_c / dt (kernels/MODEL.md, eqs. 10 and 15). For any weights y >= 0 of the
contacts, velocities v that meet these demands satisfy

    b . y >= y . J v = (J^T y) . v >= -max_i |v_i| sum_i |(J^T y)_i|,

and so max_i |v_i| >= -b . y / sum_i |(J^T y)_i|, a bound that is rounded downwards. If this speed carries a
grain across the whole domain within the step, no velocities keep the grains between the walls, and the step
has no solution. (This is Farkas' lemma, 1902: y are forces in equilibrium, J^T y = 0, that push against
overlaps, b . y < 0.)

Such weights are the positive part of J v - b at the minimum of 1/2 |max(0, J v - b)|^2, where the gradient
J^T y is zero and b . y = -|y|^2. The velocities after Gauss-Seidel sweeps are close to it, so the search
starts from them. It uses nonlinear conjugate gradients (Polak and Ribiere 1969) with exact line search.

Gaps at a round wall are smaller than at its tangent. Proofs use the tangent, and hold for the round wall too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from warpgrains.base.arrays import FloatArray, Indices
from warpgrains.solver.exact.constraints import Start, StepConstraints, every_wall

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.state import Corrections

EPS = np.finfo(float).eps
TRIES = 100  # search directions; any chain of up to this many grains is found
LINE_STEPS = 3  # Newton steps of a line search; the derivative is piecewise linear
SHARES = (0.1, 0.01, 0.001, 0.0)  # fractions of the largest weight below which contacts are dropped

Complex = NDArray[np.complex128]
"""Plane vectors as x + iy."""


@dataclass(frozen=True)
class InfeasibilityProof:
    """A proof that a step has no solution.

    Attributes
    ----------
    grains : tuple of int
        The grains that cannot fit, in ascending order.
    speed : float
        Lower bound of the largest speed that would separate the grains within the step [m/s].
    """

    grains: tuple[int, ...]
    speed: float

    def __str__(self) -> str:
        return f"no velocities below {self.speed:.1e} m/s separate them in one step"


class UnilateralConstraints(StepConstraints):
    """J v <= b of the contacts that carry a correction and of the walls that grains overlap."""

    @classmethod
    def of(cls, scene: Scene, start: Start, corrections: Corrections, time: float = 0.0) -> Self:
        """Return the constraints of a step that starts at `time` [s], for the corrections after sweeps."""
        wall, key = every_wall(scene), np.array([len(scene.walls), 1])
        every = cls.at(scene, start, corrections.pair, wall, time)
        carry = np.isin(wall @ key, (corrections.wall @ key)[corrections.wall_correction > 0.0])
        return every.only(carry | (every.gap_rate[len(every.second) :] < 0.0))

    @cached_property
    def direction(self) -> Complex:
        """Normals as complex numbers, shape (m,)."""
        return _complex(self.normal)

    @cached_property
    def grain_pushed(self) -> Indices:
        """Both grains of every pair and the grain of every wall contact, shape (m + k,)."""
        return np.concatenate([self.first, self.second])

    @cached_property
    def most(self) -> int:
        """Largest number of contacts of one grain."""
        return int(np.bincount(self.grain_pushed).max())

    def approach(self, velocity: Complex) -> FloatArray:
        """Return J v [m/s], shape (m,)."""
        relative = velocity[self.first]
        relative[: len(self.second)] -= velocity[self.second]
        return relative.real * self.direction.real + relative.imag * self.direction.imag

    def imbalance(self, weight: FloatArray) -> Complex:
        """Return J^T y for weights y of the contacts, shape (m,), as complex numbers, shape (n,)."""
        force = weight * self.direction
        force = np.concatenate([force, -force[: len(self.second)]])
        x, y = (np.bincount(self.grain_pushed, part, self.scene.n) for part in (force.real, force.imag))
        return x + 1j * y

    def least_speed(self, weight: FloatArray, imbalance: Complex) -> float:
        """Return a lower bound [m/s] on the largest speed of a solution, from weights y >= 0, not all zero.

        `imbalance` is J^T y. A sum of m products has an error below m eps times the sum of their absolute
        values, in any order. A normal has an error of 2 eps, and a component of (J^T y)_i is a sum of at most
        `most` products.
        """
        total = weight.sum()
        rounding = self.scene.rounding / self.scene.dt  # of an entry of b
        lost = (len(weight) + 1) * EPS * (np.abs(self.gap_rate) @ weight) + rounding * total
        left = np.abs(imbalance).sum() + 4.0 * (self.most + 4) * EPS * total
        return float((-self.gap_rate @ weight - lost) / left)


def find_infeasibility_proof(
    scene: Scene, start: Start, velocity: FloatArray, corrections: Corrections, time: float = 0.0
) -> InfeasibilityProof | None:
    """Search for a proof that a step has no solution. None is no evidence of a solution.

    Parameters
    ----------
    scene : Scene
    start : tuple of ndarray
        Centers [m] and velocities [m/s] before the step, shape (n, 2).
    velocity : ndarray
        Velocities after the contact iteration [m/s], shape (n, 2).
    corrections : Corrections
        Corrections after the contact iteration.
    time : float
        Time of the start of the step [s].
    """
    contacts = UnilateralConstraints.of(scene, start, corrections, time)
    if not (contacts.gap_rate < 0.0).any():
        return None  # velocities of zero meet every demand
    too_fast = 2.0 * scene.reach / scene.dt
    excess = contacts.approach(_complex(velocity)) - contacts.gap_rate
    last_slope, direction = np.zeros(scene.n, complex), np.zeros(scene.n, complex)
    last_size = float("inf")
    for _ in range(TRIES):
        weight = np.maximum(excess, 0.0)
        if not weight.any():
            return None  # these velocities meet every demand
        slope = contacts.imbalance(weight)
        if contacts.least_speed(weight, slope) > too_fast:
            return _smallest(contacts, weight, too_fast)
        size = float(np.vdot(slope, slope).real)
        if size == 0.0:
            return None
        ahead = (size - np.vdot(slope, last_slope).real) / last_size
        direction = max(0.0, ahead) * direction - slope
        last_slope, last_size = slope, size
        excess = _least_along(excess, contacts.approach(direction))
    return None


def _least_along(excess: FloatArray, change: FloatArray) -> FloatArray:
    """Return excess + t change for the t that minimizes the sum of squares of its positive part."""
    t = 0.0
    for _ in range(LINE_STEPS):
        at_t = excess + t * change
        positive = at_t > 0.0
        rising = change[positive]
        curvature = rising @ rising
        if curvature == 0.0:
            break
        t -= float(rising @ at_t[positive] / curvature)
    return excess + t * change


def _smallest(contacts: UnilateralConstraints, weight: FloatArray, too_fast: float) -> InfeasibilityProof:
    """Return a proof from weights that prove it, with few grains.

    Contacts of small weight are dropped, as long as the bound on the speed exceeds `too_fast` [m/s].
    """
    for share in SHARES:
        kept = np.where(weight >= share * weight.max(), weight, 0.0)
        speed = contacts.least_speed(kept, contacts.imbalance(kept))
        if speed > too_fast:
            break
    carrying = kept > 0.0
    grains = np.union1d(contacts.first[carrying], contacts.second[carrying[: len(contacts.second)]])
    return InfeasibilityProof(tuple(grains.tolist()), speed)


def _complex(vectors: FloatArray) -> Complex:
    """Return vectors of shape (n, 2) as complex numbers, shape (n,)."""
    return vectors[:, 0] + 1j * vectors[:, 1]
