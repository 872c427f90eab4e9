"""The exact method: against another library over all pairs, its bits, and what it refuses."""

import sys
from functools import lru_cache, partial

import numpy as np
import pytest
from hard_scenes import SOON, drum, heap, past_the_origin, random_masses, stack
from invariants import checked_step
from residual_twin import free_velocity, twin_residual
from same_bits import at_annulus, contents, run_of
from sample_scenes import SUDDEN, dense_start
from scipy import sparse

from warpgrains import Batch, InputError, Scene, Simulation
from warpgrains.solver.exact import active_set, bordered, convex, interior_point
from warpgrains.solver.exact.bordered import BorderedMatrix
from warpgrains.solver.exact.path import FrictionStep
from warpgrains.solver.exact.projection import NormalMatrix, Projection

EPS = np.finfo(float).eps


def few(n, **changes):
    """One, two or three grains that fall on the wall and on one another."""
    position = np.array([[0.0, -0.85], [0.02, -0.6], [-0.2, 0.5]])[:n]
    velocity = np.array([[0.0, -9.0], [0.0, -20.0], [3.0, 0.0]])[:n]
    return Scene(position=position, velocity=velocity, radius=0.1, mass=0.3, radius_out=1.0, **changes)


SCENES = {
    "one grain": partial(few, 1),
    "two grains, inner wall": partial(few, 2, radius_in=0.4),
    "three grains, no gravity": partial(few, 3, gravity=(0.0, 0.0)),
    "a grain at the origin": partial(past_the_origin, 0.98),
    "a column struck": partial(stack, 50),
    "a heap": partial(heap, 60, spacing=2.0),
    "masses 1:10,000": partial(random_masses, 60, 1e4),
    "a round wall": partial(heap, 60, spacing=2.0, wall="round", scheme="leapfrog"),
    "masses, and drag at the midpoint": lambda: random_masses(60, 100.0).replace(scheme="leapfrog", drag=2.0),
    "long steps": partial(heap, 60, spacing=2.0, dt=0.1),
    **{scene.__name__: scene for scene in SUDDEN},
}


@pytest.mark.parametrize(("seed", "filled"), [(0, 0.9), (11, 0.9), (8, 0.67)])
def test_sweeps_go_on_where_the_host_declines(seed, filled):
    """A dense start without solution is seen at once, and ends with the bits that sweeps alone give it."""
    scene = dense_start(seed, filled, tolerance=1e-7, max_iterations=700)
    exactly, sweeps = (Simulation(scene, method=method) for method in ("exact", "accelerated"))
    tried, alone = exactly.step(), sweeps.step()
    assert tried.factorizations == 1
    assert tried.iterations == alone.iterations == 700
    assert tried.residual == alone.residual > scene.tolerance
    assert np.array_equal(exactly.position, sweeps.position)


@lru_cache
def at_rest(n):
    """Grains of one mass, 2 s after they fell."""
    scene = heap(n, dt=0.005, order="color", tolerance=1e-5, max_iterations=300, method="accelerated")
    resting = run_of(scene, 400)
    return scene.replace(position=resting.position, velocity=resting.velocity)


@pytest.mark.parametrize(
    ("kind", "ratio", "n"),
    [
        *(("top", 100.0, 100), ("top", 1e4, 500), ("random", 1e4, 100)),
        pytest.param("random", 1e4, 2000, marks=pytest.mark.slow),
    ],
)
def test_heavy_tops_and_random_masses_on_a_pile_at_rest_are_solved(kind, ratio, n):
    """A cold step, to a tolerance that sweeps miss by four digits."""
    scene = at_rest(n)
    power = np.random.default_rng(2).uniform(0.0, 1.0, n)
    if kind == "top":
        power = np.argsort(np.argsort(scene.position[:, 1])) >= n - n // 10
    simulation = Simulation(
        scene, mass=0.1 * ratio**power, method="exact", tolerance=1e-6, max_iterations=1000
    )
    report = optimal_step(simulation)
    assert report.converged
    assert 0 < report.factorizations <= convex.MOST


def test_host_is_not_asked_where_sweeps_converge():
    """Whether the residual falls too slowly is not told before it was measured twice in a step."""
    simulation = Simulation(heap(100), method="exact", tolerance=1e-6, max_iterations=10_000, stop="residual")
    reports = [simulation.step() for _ in range(200)]
    assert sum(50 < report.iterations < 100 for report in reports) > 10
    assert not any(report.factorizations for report in reports if report.iterations < 100)


def optimal_step(simulation):
    """Take a step, and check that it satisfies eq. 10 over all pairs and both walls, to the tolerance."""
    scene, free = simulation.scene, free_velocity(simulation)
    report = checked_step(simulation)
    parts = free, simulation.contacts().correction, at_annulus(simulation).correction
    largest = max(np.abs(part).max(initial=0.0) for part in parts) + scene.radius_out / scene.dt
    # a velocity is changed by some contacts, a hundred times each at most
    assert twin_residual(simulation, free) <= scene.tolerance + 100.0 * EPS * largest
    return report


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_every_step_is_optimal_over_all_pairs(scene):
    simulation, asked = Simulation(scene(), **SOON), 0
    for _ in range(12):
        report = optimal_step(simulation)
        asked += report.factorizations
        assert report.converged
    assert asked > 0 or simulation.scene.n < 3


def test_a_pile_at_rest_takes_few_factorizations():
    settled = run_of(heap(200, spacing=2.0, method="exact", tolerance=1e-6, order="color"), 150)
    harder = settled.scene.replace(tolerance=SOON["tolerance"], max_iterations=10)
    simulation = Simulation(harder, state=settled.state())
    reports = [simulation.step() for _ in range(10)]
    assert all(report.converged for report in reports)
    assert 0 < max(report.factorizations for report in reports) <= 30


@pytest.mark.parametrize("name", ["column", "no_inner_wall"])
def test_every_step_of_a_shipped_scene_converges(name):
    scene = Scene.load(name).replace(method="exact", order="color", stop="default", tolerance=1e-9)
    summary = Simulation(scene).run()
    assert summary.unconverged == 0
    assert summary.residual <= 1e-9


@pytest.mark.parametrize(
    ("name", "start", "kept"),
    [
        ("a heap", "nothing", 100),
        ("a heap", "sweeps", 3),
        ("masses 1:10,000", "nothing", 3),
        ("a column struck", "all", 100),
    ],
)
def test_contacts_that_change_lead_where_the_interior_point_method_does(name, start, kept, monkeypatch):
    """Contacts join and let go by dozens, beside one matrix or with new factors after every third change."""
    monkeypatch.setattr(bordered, "MOST", kept)
    monkeypatch.setattr(active_set, "most_solutions", lambda _: 2000)
    asked, real = [], convex.solve

    def solve(problem, matrices, q, tolerance):
        asked.append((problem, q, tolerance))
        return real(problem, matrices, q, tolerance)

    with monkeypatch.context() as patch:
        patch.setattr(convex, "solve", solve)
        run_of(SCENES[name]().replace(**SOON), 12)
    for problem, swept, tolerance in asked[-3:]:
        q = {"nothing": np.zeros_like(swept), "all": problem.unit, "sweeps": swept}[start]
        found = active_set.solve(problem, BorderedMatrix(), q, tolerance)
        other = interior_point.solve(problem, NormalMatrix(), swept, tolerance)
        assert found.residual <= tolerance
        assert other.residual <= tolerance
        assert found.factorizations > 1 or kept == 100 or start == "sweeps"
        # |u - u'|^2 <= sum_c (|q_c - q'_c|) residual: each satisfies what the other is short of
        apart = problem.rows.T @ (found.q - other.q)
        bound = 2.0 * tolerance * problem.unit.max() * np.abs(found.q - other.q).sum()
        assert apart @ apart <= bound + (100.0 * EPS * np.abs(problem.free).max()) ** 2


def test_where_too_many_contacts_change_the_interior_point_method_goes_on(monkeypatch):
    monkeypatch.setattr(active_set, "most_solutions", lambda _: 0)
    simulation = Simulation(heap(60, spacing=2.0, **SOON))
    for _ in range(5):
        assert optimal_step(simulation).factorizations > 1


def test_what_the_host_takes_for_solved_is_not_asked_for_ever(monkeypatch):
    monkeypatch.setattr(Projection, "residual", lambda *_: 0.0)
    scene = heap(60, spacing=2.0, **SOON).replace(max_iterations=200, tolerance=1e-17)
    assert not run_of(scene, 1).step().converged


@pytest.mark.parametrize(
    ("make", "solver"), [(partial(heap, 60, spacing=2.0, **SOON), convex), (drum, FrictionStep)]
)
def test_an_interrupted_solve_leaves_the_step_before(make, solver, monkeypatch):
    simulation = Simulation(make())
    while simulation.step().factorizations == 0:
        pass

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(solver, "solve", interrupted)
        with pytest.raises(KeyboardInterrupt):
            simulation.advance(100)
    for more in (0, 5):
        simulation.advance(more)
        assert contents(simulation.state()) == contents(run_of(make(), simulation.steps).state())


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_one_bound_in_closed_form(scale):
    """min |u - u0|^2 / 2 under n . u <= b is u0 - max(0, n . u0 - b) n, in any unit of mass and speed."""
    n, free, bound = np.array([0.6, 0.8]), scale * np.array([3.0, 1.0]), scale * 0.5
    rows = sparse.csr_array((n, [0, 1], [0, 2]), shape=(1, 2))
    problem = Projection(rows, np.array([bound]), free, np.array([1.0]))
    for method, matrix in ((active_set, BorderedMatrix()), (interior_point, NormalMatrix())):
        found = method.solve(problem, matrix, np.zeros(1), 1e-12 * scale)
        assert abs(found.q[0] - (n @ free - bound)) <= 1e-12 * scale
        assert found.residual <= 1e-12 * scale


@pytest.mark.parametrize("make", [Simulation, lambda scene: Batch([scene])])
def test_without_the_library_the_extra_is_named(make, monkeypatch):
    for module in ("active_set", "bordered", "convex", "friction", "interior_point", "path", "projection"):
        monkeypatch.delitem(sys.modules, f"warpgrains.solver.exact.{module}")
    monkeypatch.setitem(sys.modules, "qdldl", None)
    with pytest.raises(InputError, match=r"method 'exact' needs qdldl: pip install 'qdldl>="):
        make(heap(10, method="exact"))
    Simulation(heap(10, method="accelerated")).step()
