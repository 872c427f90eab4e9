"""Friction and resistance to rolling: closed forms, and visits against another solver (MODEL.md, eq. 23)."""

import closed_forms
import numpy as np
import pytest
from walled_scenes import cloud, on_circle

from warpgrains import Scene, Simulation
from warpgrains.base.arrays import FloatArray


@pytest.mark.parametrize(
    ("tangent_of_slope", "friction", "rolling"),
    [
        *((tangent, 0.3, 0.0) for tangent in (0.3, 0.8, 1.2, 2.0)),
        *((tangent, 0.6, 0.2) for tangent in (0.19, 0.21, 1.3, 1.5)),
        *((tangent, 0.3, 2.0) for tangent in (0.29, 0.4)),
    ],
)
def test_disc_on_a_slope(tangent_of_slope: float, friction: float, rolling: float) -> None:
    """It rests, rolls with 2/3 g (sin - mu_r cos), or slides; the moment is at its bound where it rolls."""
    simulation = closed_forms.on_a_slope(tangent_of_slope, friction, rolling)
    expected = closed_forms.acceleration_on_a_slope(tangent_of_slope, friction, rolling)
    # velocities of the leapfrog are those half a step earlier
    speed = expected * (simulation.time - simulation.scene.dt / 2)
    assert simulation.velocity[0, 0] == pytest.approx(speed, rel=1e-6, abs=1e-9)
    slope, turns = np.arctan(tangent_of_slope), tangent_of_slope > rolling
    carried, kept, weight = simulation.wall_contacts(), simulation.state().corrections, 9.81 * np.cos(slope)
    assert carried.force == pytest.approx([weight], rel=1e-5)  # and v^2 / radius of the bowl
    slides = tangent_of_slope > (3.0 * friction - 2.0 * rolling if turns else friction)
    assert carried.slides.tolist() == [slides]
    held = friction * weight if slides else 9.81 * np.sin(slope) - expected
    assert carried.tangential_force == pytest.approx([held], rel=1e-5)
    bound = rolling * kept.wall_correction
    assert not rolling or (np.abs(kept.wall_rolling) == pytest.approx(bound, rel=1e-9)) == turns
    assert (abs(simulation.spin[0]) > 0.01) == turns
    assert (
        slides or not turns or simulation.spin[0] == pytest.approx(-simulation.velocity[0, 0] / 0.5, rel=1e-6)
    )


def test_contacts_know_which_of_them_slide() -> None:
    """No tangential force exceeds Coulomb's bound, and those that reach it do so to rounding."""
    simulation = Simulation(cloud(max_iterations=2000))
    simulation.advance(100)
    for contacts, friction in ((simulation.contacts(), 0.5), (simulation.wall_contacts(), 0.3)):
        share = np.abs(contacts.tangential_force) / (friction * contacts.force)
        assert share.max() <= 1.0 + 1e-14
        assert contacts.slides.any()
        assert not contacts.slides.all()
        assert (share[contacts.slides] >= 1.0 - 1e-14).all()
        assert (share[~contacts.slides] < 1.0 - 1e-12).all()
    smooth = Simulation(Scene.load("annulus"))
    smooth.advance(100)
    for carried in (smooth.contacts(), smooth.wall_contacts()):
        assert carried.slides.all()
        assert not carried.tangential_force.any()


PAIRS = 2500  # of each coefficient of friction: 20,000 in all


def pairs(friction: float, seed: int) -> Scene:
    """Return pairs of unlike discs far from each other, with random velocities, spins, and gaps around 0."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(PAIRS)))
    center = 10.0 * (np.stack(np.divmod(np.arange(PAIRS), side), axis=1) - side / 2.0 + 0.3)
    radius, mass = rng.uniform(0.2, 1.0, (PAIRS, 2)), 10.0 ** rng.uniform(-2.0, 2.0, (PAIRS, 2))
    angle, gap = rng.uniform(0.0, 2.0 * np.pi, PAIRS), rng.choice([0.0, -1e-2, 1e-2], PAIRS)
    other = center + (radius.sum(axis=1) + gap)[:, np.newaxis] * on_circle(angle)
    return Scene(
        position=np.stack([center, other], axis=1).reshape(-1, 2),
        velocity=rng.normal(0.0, 1.0, (2 * PAIRS, 2)),
        spin=rng.normal(0.0, 2.0, 2 * PAIRS),
        radius=radius.ravel(),
        mass=mass.ravel(),
        radius_out=20.0 * side,
        gravity=(0.0, 0.0),
        friction=friction,
        tolerance=1e-12,
        max_iterations=100,
    )


def by_de_saxce(scene: Scene, sweeps: int = 3000) -> FloatArray:
    """Return the impulses (normal, tangential) of the pairs on their second discs [N s], shape (pairs, 2).

    The impulse r is the fixed point of the projection of r - rho (u + mu |u_t| n) on Coulomb's cone, with the
    relative velocity u at the contact after the impulse, and the gap divided by dt taken off its normal part
    (De Saxce and Feng 1998). The matrix between impulses and velocities is assembled for three degrees of
    freedom a disc, and its couplings are not assumed to vanish.
    """
    d = np.diff(scene.position.reshape(-1, 2, 2), axis=1)[:, 0]
    distance, r, zero = np.hypot(*d.T), scene.radius.reshape(-1, 2), np.zeros(PAIRS)
    n = d / distance[:, np.newaxis]
    nx, ny = n.T
    # of the velocity of the second surface relative to the first one: normal, and along (-ny, nx)
    jacobian = np.array([[-nx, -ny, zero, nx, ny, zero], [ny, -nx, -r[:, 0], -ny, nx, -r[:, 1]]])
    jacobian = np.moveaxis(jacobian, 2, 0)
    mass = np.stack([scene.mass, scene.mass, scene.inertia], axis=1).reshape(PAIRS, 6)
    velocity = np.column_stack([scene.velocity, scene.spin]).reshape(PAIRS, 6)
    w = np.einsum("pai,pi,pbi->pab", jacobian, 1.0 / mass, jacobian)
    free = np.einsum("pai,pi->pa", jacobian, velocity)
    free[:, 0] += (distance - r.sum(axis=1)) / scene.dt
    mu, rho = scene.friction, 1.0 / np.trace(w, axis1=1, axis2=2)
    impulse = np.zeros((PAIRS, 2))
    for _ in range(sweeps):
        u, before = free + np.einsum("pab,pb->pa", w, impulse), impulse
        shifted = u + np.stack([mu * np.abs(u[:, 1]), zero], axis=1)
        impulse = on_cone(impulse - rho[:, np.newaxis] * shifted, mu)
        if np.abs(impulse - before).max() <= 1e-13:
            break
    return impulse


def on_cone(impulse: FloatArray, mu: float) -> FloatArray:
    """Return the nearest points of the cone |r_t| <= mu r_n, shape (m, 2)."""
    normal, tangential = impulse[:, 0], np.abs(impulse[:, 1])
    along = (normal + mu * tangential) / (1.0 + mu * mu)
    edge = np.stack([along, mu * along * np.sign(impulse[:, 1])], axis=1)
    inside, polar = tangential <= mu * normal, mu * tangential <= -normal
    return np.where(inside[:, np.newaxis], impulse, np.where(polar[:, np.newaxis], 0.0, edge))


@pytest.mark.parametrize("friction", [0.01, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0, 3.0])
def test_visit_solves_the_problem_of_de_saxce(friction: float) -> None:
    scene = pairs(friction, seed=int(100 * friction))
    simulation = Simulation(scene)
    assert simulation.step().residual <= 1e-12
    contacts, found = simulation.contacts(), np.zeros((PAIRS, 2))
    pair = contacts.pair[:, 0] // 2
    assert (contacts.pair[:, 1] == contacts.pair[:, 0] + 1).all()
    found[pair] = scene.dt * np.stack([contacts.force, contacts.tangential_force], axis=1)
    expected = by_de_saxce(scene)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)
    touching = found[:, 0] > 0.0
    assert 0.2 * PAIRS < touching.sum() < 0.8 * PAIRS
    assert contacts.slides.any()
    assert friction < 0.1 or not contacts.slides.all()
