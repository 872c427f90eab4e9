"""MODEL.md determines the bits: a program of it alone, and its table, gives those of the kernels."""

from typing import Any

import numpy as np
import pytest
from arithmetic_twin import Twin

from warpgrains import Arc, Disc, Scene, Segment, Simulation
from warpgrains.scene.gravity import TurningGravity

STEPS = 25


def motion(rng: np.random.Generator) -> dict[str, Any]:
    """Some motion of a wall, or none; it may begin and end within a step."""
    if rng.random() < 0.4:
        return {}
    given: dict[str, Any] = {
        "velocity": tuple(rng.uniform(-0.5, 0.5, 2).tolist()),
        "angular_velocity": rng.uniform(-1.0, 1.0),
        "from_time": rng.choice([0.0, 0.013, 0.016]),
        "to_time": rng.choice([None, 0.053, 0.056]),
        "pivot": (0.1, -0.2) if rng.random() < 0.5 else None,
    }
    return given


def joined_walls(rng: np.random.Generator) -> list[Any]:
    """Walls with joints that move alike, or none."""
    given = motion(rng)
    walls = [
        Segment((0.3, -0.45), (0.0, -0.5), **given),
        Segment((-0.5, -0.3), (0.0, -0.5), **given),
        Arc((0.0, -0.3), 0.2, -0.5 * np.pi, 0.5, **given),
        Segment((0.3, -0.45), (0.35, -0.2), **given),
    ]
    return [walls[k] for k in rng.permutation(4)[: rng.choice([0, 2, 4])]]


def random_scene(seed: int) -> Scene:
    """A scene with some of all features that plain sweeps know."""
    rng = np.random.default_rng(seed)
    n, has_friction, is_driven = int(rng.integers(2, 12)), rng.random() < 0.5, rng.random() < 0.3
    walls: list[Any] = [
        Segment((-0.7, -0.3), (0.2, -0.6), **motion(rng)),
        Disc((0.4, -0.5), 0.15, **motion(rng)),
        Arc((0.1, -0.2), 0.6, -2.0, -0.4, **motion(rng)),
        Disc((0.02, 0.0), 0.95, inside=True, **motion(rng)),
    ]
    walls = [wall for wall in walls if rng.random() < 0.4] + joined_walls(np.random.default_rng(seed))
    fields: dict[str, Any] = {"wall": rng.choice(["tangent", "round"]), "radius_in": rng.choice([0.0, 0.25])}
    if is_driven and rng.random() < 0.6:
        fields |= {"pressure": rng.uniform(0.1, 3.0), "wall_mass": rng.choice([None, 2.0]), "wall": "tangent"}
    elif is_driven:
        walls.append(Segment((-0.8, 0.33), (0.7, 0.41), force=rng.uniform(-2.0, 2.0), mass=0.7))
        fields["wall"] = "tangent"
    if has_friction:
        fields |= {"friction": rng.choice([0.0, 0.4]), "wall_friction": 0.6, "angular_velocity_out": 0.5}
        fields |= {"spin_drag": rng.choice([0.0, 1e-4]), "spin": rng.uniform(-3.0, 3.0, n)}
        fields["angular_velocity_in"] = 0.8 if fields["radius_in"] > 0.0 else 0.0
        if np.random.default_rng((seed, 2)).random() < 0.5:
            fields |= {"rolling_friction": 0.2, "wall_rolling_friction": [None, 0.0, 0.5][seed % 3]}
    if np.random.default_rng((seed, 1)).random() < 0.5:
        fields |= {
            "restitution": 0.6,
            "wall_restitution": [None, 1.0, 0.0][seed % 3],
            "restitution_speed": 0.1,
        }
    if rng.random() < 0.3:
        fields["gravity"] = TurningGravity((0.5, -9.81), rng.uniform(-3.0, 3.0))
    angle, distance = rng.uniform(0.0, 2.0 * np.pi, n), np.sqrt(rng.uniform(0.1, 0.8, n))
    position = distance[:, np.newaxis] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    position = position[~np.any([wall.covers(position) for wall in walls] or [np.zeros(n, bool)], axis=0)]
    n = max(1, len(position))
    position = position if len(position) else np.array([[0.0, 0.6]])
    if has_friction:
        fields["spin"] = fields["spin"][:n]
    stop, tolerance = (("default", 1e-6), ("residual", 1e-3))[seed % 2]
    return Scene(
        position=position,
        velocity=rng.uniform(-2.0, 2.0, (n, 2)),
        radius=rng.uniform(0.05, 0.12, n),
        mass=rng.uniform(0.1, 1.0, n) if rng.random() < 0.7 else 0.3,
        radius_out=1.0,
        walls=walls,
        drag=rng.choice([0.0, 0.2]),
        scheme=rng.choice(["text", "leapfrog"]),
        dt=0.01,
        stop=stop,
        tolerance=tolerance,
        max_iterations=40,
        **fields,
    )


@pytest.mark.filterwarnings("ignore:grains overlap")
@pytest.mark.parametrize("seed", range(60))
def test_a_program_of_the_page_gives_the_same_bits(seed: int) -> None:
    scene = random_scene(seed)
    simulation, twin = Simulation(scene), Twin(scene)
    for _ in range(STEPS):
        assert simulation.step().iterations == twin.step()
        assert np.array_equal(simulation.position, twin.x)
        assert np.array_equal(simulation.velocity, twin.v)
        if scene.has_friction:
            assert np.array_equal(simulation.spin, twin.spin)
