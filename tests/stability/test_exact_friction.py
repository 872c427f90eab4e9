"""The exact method with friction: hard steps of runs, its budget, its bits, and what it refuses."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from hard_scenes import ROUGH, couette, drum
from same_bits import contents
from walled_scenes import WALLED

from warpgrains import Simulation
from warpgrains.accuracy import certify
from warpgrains.kernels.exact.block_lu import Factors, Triples, factor, solve
from warpgrains.solver.exact import friction
from warpgrains.solver.exact.path import Contacts, FrictionStep

EPS = np.finfo(float).eps
STEPS = Path(__file__).parent / "friction_steps"
"""Steps of runs in which 300 sweeps end above 2 % of g dt; dv and dvt are the corrections then."""
NAMES = sorted(file.stem for file in STEPS.glob("*.npz"))


@wp.kernel
def factor_and_solve(factors: Factors, x: Triples, sign: wp.array(dtype=wp.float64)):
    sign[0] = factor(factors)
    solve(factors, x)


@pytest.mark.parametrize("first", [3.0, -3.0])
def test_factors_of_two_grains(first):
    """One contact of compliance 1e-8 links them: quotients by a block of entries far apart stay exact."""
    stiffness, h, g = 1e8, np.array([0.6, 0.7, -0.4]), np.array([-0.5, 0.3, 0.8])
    blocks = [np.diag([first, 2.0, 3.0]) + stiffness * np.outer(h, h), np.eye(3) + stiffness * np.outer(g, g)]
    lower, upper = -stiffness * np.outer(g, h), -stiffness * np.outer(h, g)
    right, sign = np.arange(1.0, 7.0), wp.zeros(1, dtype=wp.float64, device="cpu")
    factors = Factors()
    for name, values in {"start": [0, 1, 1], "row": [1], "used": [0], "used_end": [0, 0]}.items():
        setattr(factors, name, wp.array(values, dtype=wp.int32, device="cpu"))
    parts = {"diagonal": blocks, "inverse": blocks, "lower": [lower], "upper": [upper]}
    for name, values in parts.items():
        setattr(factors, name, wp.array(np.array(values), dtype=wp.mat33d, device="cpu"))
    x = wp.array(right.reshape(2, 3), dtype=wp.vec3d, device="cpu")
    wp.launch(factor_and_solve, dim=1, inputs=[factors, x, sign], device="cpu")
    whole = np.block([[blocks[0], upper], [lower, blocks[1]]])
    assert sign.numpy()[0] == np.sign(np.linalg.det(whole))
    quotient, solution = factors.lower.numpy()[0], x.numpy().ravel()
    for found, expected, size in (  # each with the roundings of a dozen products that are added up
        (quotient @ blocks[0], lower, np.abs(quotient) @ np.abs(blocks[0])),
        (factors.diagonal.numpy()[1] + quotient @ upper, blocks[1], np.abs(quotient) @ np.abs(upper)),
        (whole @ solution, right, np.abs(whole) @ np.abs(solution)),
    ):
        assert (np.abs(found - expected) <= 12.0 * EPS * (np.abs(expected) + size)).all()


def hard_step(name):
    with np.load(STEPS / f"{name}.npz") as file:
        own = dict(file)
    own["lever"], own["parts"] = np.zeros_like(own["normal"]), np.ones((len(own["first"]), 3))
    contacts = Contacts(*(own[field] for field in Contacts._fields))
    return FrictionStep(contacts, own["inertia"], own["free"]), contacts, own


def residual(contacts, own, dv, dvt):
    """Return the residual [m/s] (eq. 25) by NumPy."""
    i, j, n = contacts.first, contacts.second, contacts.normal
    pair, t = j >= 0, np.stack([-n[:, 1], n[:, 0]], axis=1)
    mass, k = own["inertia"][:, 0], own["inertia"][:, 0] / own["inertia"][:, 2]
    share_i = np.where(pair, mass[j] / (mass[i] + mass[j]), 1.0)
    share_j = np.where(pair, 1.0 - share_i, 0.0)
    u, impulse = own["free"].copy(), dv[:, None] * n + dvt[:, None] * t
    for grain, share, sign in ((i, share_i, -1.0), (j, share_j, 1.0)):
        np.add.at(u[:, :2], grain, sign * share[:, None] * impulse)
        np.subtract.at(u[:, 2], grain, share * k[grain] * dvt)
    other = np.where(pair[:, None], u[j], 0.0)
    v = u[i, :2] - other[:, :2]
    vn, vt = (v * n).sum(axis=1), (v * t).sum(axis=1) + u[i, 2] + other[:, 2] - contacts.surface
    round_wall = np.isfinite(contacts.circle)
    reach, along = contacts.circle[round_wall], (u[i, :2] * t).sum(axis=1)[round_wall]
    gap = contacts.gap_rate.copy()
    gap[round_wall] -= reach - np.sqrt(reach**2 - along**2)
    e_n = np.maximum(0.0, dv + vn - gap) - dv
    limit, compliance = contacts.friction * (dv + e_n), 1.0 + share_i * k[i] + share_j * k[j]
    e_t = compliance * (np.clip(dvt + vt / compliance, -limit, limit) - dvt)
    return float(np.abs([e_n, e_t]).max())


@pytest.mark.parametrize("name", NAMES)
def test_a_hard_step_is_solved(name):
    step, contacts, own = hard_step(name)
    before = step.residual(own["dv"], own["dvt"])
    # of some contacts, a hundred roundings each at most, of numbers up to 20 m/s, or 1 / dt here
    rounding = 100.0 * EPS * 1e3
    assert abs(before - residual(contacts, own, own["dv"], own["dvt"])) <= rounding
    assert before > 1e-4
    answer = step.solve(own["dv"], own["dvt"], 1e-9)
    assert answer.residual <= 1e-9
    assert residual(contacts, own, answer.dv, answer.dvt) <= 1e-9 + rounding
    assert (answer.dv >= 0.0).all()
    again = hard_step(name)[0].solve(own["dv"], own["dvt"], 1e-9)
    assert contents(again.dv) == contents(answer.dv)


@pytest.mark.parametrize("name", ["flow", "drum"])
def test_the_work_ends_within_the_budget_and_never_worse(name):
    step, _, own = hard_step(name)
    before = step.residual(own["dv"], own["dvt"])
    for budget in (0.0, 1e4, 1e5, 1e6):
        answer = step.solve(own["dv"], own["dvt"], 1e-12, budget)
        assert answer.work <= budget
        assert answer.residual <= before
        assert step.residual(answer.dv, answer.dvt) == answer.residual


@pytest.mark.parametrize("make", [drum, couette, partial(drum, friction=0.0), partial(drum, wall="tangent")])
def test_steps_are_solutions_of_coulombs_law(make):
    """The residual of the kernels meets the tolerance, and another library finds the same velocities."""
    simulation, asked = Simulation(make()), 0
    for _ in range(40):
        report = simulation.step()
        asked += report.factorizations
        assert report.converged
    assert asked > 0
    bound = certify(simulation)
    assert bound.error is None or bound.error < 1e-6
    assert bound.solver_error <= 1e-5  # [m/s], as far as clarabel proves its own velocities


@pytest.mark.parametrize(
    "make",
    [
        partial(drum, rolling_friction=0.1),
        partial(drum, wall_rolling_friction=0.3),
        partial(couette, rolling_friction=0.2, wall_rolling_friction=0.05),
        partial(WALLED["pressure, a light wall"], **ROUGH | {"max_iterations": 300}, rolling_friction=0.1),
    ],
)
def test_steps_with_rolling_friction_are_solved(make):
    simulation, asked = Simulation(make()), 0
    for _ in range(40):
        report = simulation.step()
        asked += report.factorizations
        assert report.converged
    assert asked > 0


@pytest.mark.parametrize("speed", [0.0, 1e9])
def test_an_answer_that_throws_grains_out_of_the_domain_is_declined(speed, monkeypatch):
    """Where grains cannot fit, a path leads to a smaller residual with velocities beyond all bounds."""
    simulation = Simulation(couette(tolerance=1e-17, max_iterations=30))
    simulation.advance(5)
    swept = Simulation(simulation.scene.replace(method="accelerated", exact_budget=None))
    swept.restore(simulation.state())
    found = FrictionStep.velocity
    monkeypatch.setattr(friction, "NEAR", 1e9)  # no contact is left out
    monkeypatch.setattr(FrictionStep, "velocity", lambda *own: found(*own) + speed)
    report = simulation.step()
    assert report.factorizations > 0
    assert not report.converged
    assert (report.residual == swept.step().residual) == (speed > 0.0)


def test_contacts_left_out_are_taken_in_where_an_answer_closes_them(monkeypatch):
    monkeypatch.setattr(friction, "NEAR", 0.0)
    steps = []
    monkeypatch.setattr(friction, "FrictionStep", lambda *own: steps.append(own) or FrictionStep(*own))
    simulation, attempts = Simulation(couette()), 0
    for _ in range(10):
        report = simulation.step()
        attempts += report.factorizations > 0
        assert report.converged
    assert len(steps) > attempts > 0


@pytest.mark.parametrize("swapped", [False, True])
def test_an_answer_is_kept_until_the_last_sweep_for_its_walls(swapped, monkeypatch):
    """The list may change within a step, and have another wall of a grain in the same place."""
    listed, asked, answers = friction.ListedContacts, [], []

    def swapping(*own):
        found = listed(*own)
        if swapped and len(asked) % 2 == 1:
            found.constraints.wall[:, 1] ^= 1
        asked.append(found)
        return found

    answer = friction.PathSolver._answer
    monkeypatch.setattr(friction, "ListedContacts", swapping)
    monkeypatch.setattr(friction.PathSolver, "_answer", lambda *own: answers.append(own) or answer(*own))
    simulation = Simulation(couette(exact_budget=1e-6))
    while len(asked) < 2:
        simulation.step()
    assert len(asked) == 2  # after 300 sweeps, and after the last one
    assert len(answers) == 1 + swapped


@pytest.mark.parametrize("make", [drum, couette])
def test_a_step_that_is_not_solved_ends_no_worse_than_by_sweeps(make):
    """With a budget too small for one factorization the bits are those of sweeps alone."""
    scene = make(exact_budget=1e-6)
    one, other = Simulation(scene), Simulation(scene.replace(exact_budget=None, method="accelerated"))
    for _ in range(20):
        assert one.step().residual == other.step().residual
    state = other.state()
    for tight in (0.1, 1.0, 10.0):
        one = Simulation(scene.replace(exact_budget=tight))
        one.restore(state)
        other.restore(state)
        assert one.step().residual <= other.step().residual
