"""A heap at rest stays at rest: no drift and no gain of energy, however many steps.

At rest the same contacts carry all the time. Each of their gaps is within dt eta of 0 after every step,
whatever came before: |vn - gap/dt| <= eta, and a step leaves gap - dt vn of it. So errors of the steps do not
add up: displacements u since the start obey |J u| <= 2 dt eta + |u|^2 / r at every contact, where the second
term is for the turning of the normals, over distances of a radius r at least. So do dt times the velocities
of a step.

J is blind to one displacement alone, the rotation of the heap about the origin: no wall and no pair has a
moment about it. The angular momentum L changes only by gravity's moment: the heap is a pendulum of inertia I,
with I phi'' = -m g h sin(phi), h the distance of its centre of mass from the origin. Either scheme is
symplectic Euler for it, with an L as old as the velocities. It keeps the amplitude below
sqrt(phi0^2 + (L0 / (I w))^2) / (1 - w dt / 2), w^2 = m g h / I.
A deformation that moves the centre of mass by s changes gravity's moment by m g s at most, and so adds
m g s t / (I w) at most in a time t.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from hard_scenes import heap
from invariants import EPS, checked_step
from same_bits import at_annulus
from schemes import SCHEMES

from warpgrains import Scene, Simulation
from warpgrains.arrays import FloatArray
from warpgrains.scene.state import State

TOLERANCE = 1e-10  # m/s
SETTLING = 1500  # steps


def resting(scheme: dict[str, str]) -> tuple[Scene, State]:
    """Thirty grains that have come to rest in a liquid, which is then taken away."""
    solver = {"method": "accelerated", "tolerance": TOLERANCE, "max_iterations": 200_000}
    scene = heap(30, spacing=2.3, **solver, **scheme)
    settling = Simulation(scene.replace(drag=0.05 * scene.mass[0] / scene.dt))
    assert settling.run(steps=SETTLING).unconverged == 0
    return scene, settling.state()


@dataclass(frozen=True)
class Rest:
    """What bounds a heap's drift: its carrying contacts, their rigidity, and its pendulum."""

    jacobian: FloatArray  # J, shape (contacts, 2 n)
    rotation: FloatArray  # of all grains about the origin, of length 1, shape (2 n,)
    rigidity: float  # smallest singular value of J but that of the rotation
    amplitude: float  # of the pendulum, as a length of (2 n,) [m]
    frequency: float  # w [1/s]
    moment: float  # m g / (I w) times the length of a rotation by 1 [1/s]

    def deformation(self, gap: float) -> float:
        """How long u is at most, but for its rotation [m], if |J u| <= gap [m] at every contact."""
        return gap * np.sqrt(len(self.jacobian)) / self.rigidity


def rest_of(simulation: Simulation) -> Rest:
    scene, x, v = simulation.scene, simulation.position, simulation.velocity
    mass, gravity = scene.mass, np.hypot(*scene.gravity)
    rotation = np.stack([-x[:, 1], x[:, 0]], axis=1).ravel()
    length = np.linalg.norm(rotation)
    jacobian = jacobian_of(simulation)
    _, singular, basis = np.linalg.svd(jacobian)
    rank = np.sum(singular > 1e-6)
    assert rank == 2 * scene.n - 1, "the heap is not rigid"
    assert abs(abs(basis[-1] @ rotation) / length - 1.0) <= 1e-9
    centre, inertia = mass @ x, (mass * (x * x).sum(axis=1)).sum()
    frequency = np.sqrt(gravity * np.hypot(*centre) / inertia)
    spin = (mass * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])).sum() / inertia
    offset = np.hypot(np.arctan2(centre[0], -centre[1]), spin / frequency)
    return Rest(
        jacobian=jacobian,
        rotation=rotation / length,
        rigidity=singular[rank - 1],
        amplitude=length * offset / (1.0 - 0.5 * frequency * scene.dt),
        frequency=frequency,
        moment=length * mass.sum() * gravity / (inertia * frequency),
    )


def jacobian_of(simulation: Simulation) -> FloatArray:
    contacts, n = simulation.contacts(), simulation.scene.n
    walls = np.flatnonzero(at_annulus(simulation).correction)
    rows = np.zeros((len(contacts.pair) + len(walls), n, 2))
    pair, wall = np.split(np.arange(len(rows)), [len(contacts.pair)])
    i, j = contacts.pair.T
    rows[pair, i], rows[pair, j] = contacts.normal, -contacts.normal
    x = simulation.position[walls]
    rows[wall, walls] = x / np.hypot(*x.T)[:, None]
    return rows.reshape(len(rows), 2 * n)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(("steps", "every"), [(300, 1), pytest.param(20_000, 10, marks=pytest.mark.slow)])
def test_heap_stays_at_rest(steps: int, every: int, scheme: dict[str, str]) -> None:
    scene, state = resting(scheme)
    simulation = Simulation(scene)
    simulation.restore(state)
    checked_step(simulation)
    x0, pairs, rest = simulation.position, simulation.contacts().pair, rest_of(simulation)
    walls = np.flatnonzero(at_annulus(simulation).correction)
    for step in range(every, steps + 1, every):
        if every > 1:
            assert simulation.advance(every - 1).unconverged == 0
        report = checked_step(simulation)
        assert report.converged
        assert np.array_equal(simulation.contacts().pair, pairs)
        assert np.array_equal(np.flatnonzero(at_annulus(simulation).correction), walls)
        u, v = (simulation.position - x0).ravel(), simulation.velocity.ravel()
        gap = 2.0 * (scene.dt * TOLERANCE + 16.0 * EPS * scene.radius_out) + u @ u / scene.radius.min()
        deformation = rest.deformation(gap)
        swing = rest.amplitude + rest.moment * deformation * step * scene.dt
        turned, turning = rest.rotation @ u, rest.rotation @ v
        assert abs(turned) <= 2.0 * swing
        assert abs(turning) <= rest.frequency * swing
        assert np.linalg.norm(u - turned * rest.rotation) <= deformation
        assert scene.dt * np.linalg.norm(v - turning * rest.rotation) <= deformation
