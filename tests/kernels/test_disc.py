"""A fixed disc inside the annulus: against the C reference, a closed form, and scenes read and written."""

from math import acos
from pathlib import Path

import numpy as np
import pytest

from warpgrains import Disc, InputError, Scene, Simulation
from warpgrains.reference.reference import Reference, build

DISCS = (Disc((0.0, -0.5), 0.15), Disc((0.3, -0.6), 0.1))


def around(n: int = 140, **changes: object) -> Scene:
    """Return a scene of grains of many sizes that fall on two discs and between them."""
    rng = np.random.default_rng(1)
    angle, distance = rng.uniform(0.0, 2.0 * np.pi, n), np.sqrt(rng.uniform(0.1, 0.95, n))
    position = distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    clear = [np.hypot(*(position - disc.center).T) > disc.radius for disc in DISCS]
    position = position[np.all(clear, axis=0)]
    fields: dict[str, object] = {
        "position": position,
        "radius": rng.uniform(0.02, 0.05, len(position)),
        "mass": rng.uniform(0.1, 1.0, len(position)),
        "radius_in": 0.2,
        "radius_out": 1.0,
        "walls": DISCS,
        "dt": 5e-3,
        "drag": 0.1,
        "tolerance": 1e-6,
        "max_iterations": 300,
    }
    return Scene(**{**fields, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize("scheme", ["text", "leapfrog"])
@pytest.mark.parametrize("wall", ["tangent", "round"])
def test_bits_of_the_reference(tmp_path: Path, scheme: str, wall: str) -> None:
    scene = around(scheme=scheme, wall=wall)
    simulation, reference = Simulation(scene, threads=2), Reference(build(tmp_path), scene)
    touched: set[int] = set()
    for step in range(100):
        report = simulation.step()
        assert report.iterations == reference.step()[0]
        assert np.array_equal(simulation.position, reference.position)
        assert np.array_equal(simulation.velocity, reference.velocity)
        touched |= set(simulation.wall_contacts().wall[:, 1].tolist())
        if step == 50:
            state = simulation.state()
            simulation = Simulation(scene)
            simulation.restore(state)
            reference = Reference(build(tmp_path), scene, state)
    assert touched >= {0, 2, 3}


@pytest.mark.parametrize("method", ["gauss-seidel", "accelerated", "exact"])
@pytest.mark.parametrize("order", ["sequential", "color"])
def test_all_methods_keep_grains_off_discs(method: str, order: str) -> None:
    scene = around(method=method, order=order, stop="residual", max_iterations=10_000)
    simulation = Simulation(scene)
    statistics = simulation.advance(60)
    gaps = [disc.side(simulation.position, scene.radius).gap.min() for disc in DISCS]
    assert statistics.unconverged == 0
    assert min(gaps) >= -scene.dt * scene.tolerance - 1e-12  # (12) bounds gaps by dt eta after one step


def test_a_grain_slides_off_where_the_closed_form_says() -> None:
    """It leaves a sphere without friction at cos(theta) = 2/3 of that at the start."""
    start = np.array([1e-3, 1.1]) / np.hypot(1e-3, 1.1) * 1.1
    scene = Scene(
        position=[start],
        radius=0.1,
        mass=1.0,
        radius_out=3.0,
        walls=[{"kind": "disc", "center": (0.0, 0.0), "radius": 1.0}],
        dt=1e-4,
        scheme="leapfrog",
        tolerance=1e-12,
    )
    simulation = Simulation(scene)
    while simulation.step().contacts or simulation.steps < 10:
        pass
    x, y = simulation.position[0]
    # within a step before it leaves it moves by |v| dt: 3.8e-4 m at 2.7 m/s, an angle of 2.4e-4
    assert np.arctan2(x, y) == pytest.approx(acos(2.0 / 3.0 * start[1] / 1.1), abs=1e-3)


def test_what_a_scene_file_says_is_read_back(tmp_path: Path) -> None:
    file = tmp_path / "disc.toml"
    file.write_text(
        "[domain]\nradius_out = 1.0\n[grains]\nposition = [[0.0, 0.5]]\nradius = 0.1\nmass = 1.0\n"
        '[[walls]]\nkind = "disc"\ncenter = [0.0, -0.5]\nradius = 0.15\n'
    )
    scene = Scene.load(file)
    assert scene.walls == DISCS[:1]
    simulation = Simulation(scene)
    simulation.run(duration=0.5, record=tmp_path / "run.usdc", forces=True)
    simulation.save(tmp_path / "state.npz")
    assert Simulation.load(tmp_path / "state.npz").scene.walls == scene.walls


@pytest.mark.parametrize(
    ("walls", "message"),
    [
        (3, "walls is 3: it must be a list of walls"),
        ([7], "walls[0] is 7: it must be a wall, or a table of its keys"),
        ([{"kind": "disk"}], "unknown walls[0].kind 'disk': did you mean 'disc'?"),
        ([{"kind": "disc", "center": (0, 0)}], "walls[0].radius is missing: a disc needs it"),
        ([{"kind": "disc", "center": (0, 0), "radius": -1.0}], "walls[0]: radius of a disc is -1.0"),
        (
            [{"kind": "disc", "middle": (0, 0), "radius": 1.0}],
            "unknown key of walls[0] 'middle'",
        ),
        ([Disc((0.0, 0.5), 0.2)], "position of grain 0 is (0.0, 0.5): its center is inside walls[0]"),
    ],
)
def test_bad_walls(walls: object, message: str) -> None:
    with pytest.raises(InputError) as error:
        Scene(position=[(0.0, 0.5)], radius=0.1, mass=1.0, radius_out=1.0, walls=walls)  # type: ignore[arg-type]
    assert str(error.value).startswith(message)
