"""Random scenes: from dense to sparse, with all methods, orders, schemes, walls and contact laws."""

from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
from walled_scenes import CORNERS, OF_EVERY_KIND

from warpgrains import Scene, Segment
from warpgrains.scene.fields import METHODS, ORDERS
from warpgrains.scene.gravity import TurningGravity

GRAINS = {"dense": (40, 160), "jammed": (20, 100), "huge": (500, 1500), "few": (1, 12), "spread": (5, 80)}
OFTEN = (0.25, 0.3, 0.005, 0.22, 0.225)


def random_scene(rng: np.random.Generator, kind: str | None = None, **fixed: Any) -> Scene:
    """Return a random scene, in which `fixed` replaces fields.

    `kind`, a key of `GRAINS`, sets the number of grains and how densely they are placed; by default, it is
    random.
    """
    kind = kind or str(rng.choice(list(GRAINS), p=OFTEN))
    n = int(rng.integers(*GRAINS[kind]))
    inner = float(rng.choice([0.0, 0.3]))
    filled = {"dense": rng.uniform(1.0, 6.0), "jammed": rng.uniform(0.9, 1.3), "few": 0.1}.get(kind, 0.5)
    typical = np.sqrt(filled * (1.0 - inner**2) / n)
    ratio = float(rng.choice([1.0, 1.5, 10.0]))
    radius = np.minimum(typical * rng.uniform(1.0 / ratio, 1.0, n), 0.3 * (1.0 - inner))
    distance = np.sqrt(rng.uniform(inner**2, 1.0, n)) * rng.uniform(0.8, 1.0)
    angle = rng.uniform(0.0, rng.choice([2.0, 1.0, 0.05]) * pi, n)
    position = np.maximum(distance, 1.001 * inner)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    method = fixed.get("method") or str(rng.choice(METHODS[: 2 + (n < 60)]))
    fields = random_contacts(rng, inner, method)
    walls = random_walls(rng, 0.3 * float(radius.min()) / 1e-2) if rng.random() < 0.5 else []
    if "pressure" not in fields and fields.get("wall") == "tangent":  # add a wall that a force drives
        walls.append(Segment((-0.8, 0.33), (0.7, 0.41), force=rng.uniform(-2.0, 2.0), mass=0.7))
    free = ~np.any([wall.covers(position) for wall in walls] or [np.zeros(n, bool)], axis=0)
    free[0] |= not free.any()
    walls = [wall for wall in walls if not wall.covers(position[free]).any()]
    if "friction" in fields:
        fields["spin"] = rng.normal(0.0, 10.0, free.sum())
    common = {
        "position": position[free],
        "velocity": rng.normal(0.0, rng.choice([0.0, 1.0, 20.0]), (free.sum(), 2)),
        "radius": radius[free] if ratio > 1.0 else float(radius.max()),
        "mass": 10.0 ** rng.uniform(-3.0, 3.0, free.sum()) if rng.random() < 0.3 else 1.0,
        "radius_in": inner,
        "radius_out": 1.0,
        "walls": walls,
        "gravity": random_gravity(rng),
        "drag": float(rng.choice([0.0, 0.05])),
        "dt": float(rng.choice([1e-4, 1e-3, 1e-2])),
        "tolerance": float(rng.choice([1e-8, 1e-4, 1e-2])),
        "max_iterations": int(rng.choice([1, 10, 50, 200, 1000], p=[0.3, 0.3, 0.25, 0.13, 0.02])),
        "order": str(rng.choice(ORDERS)),
        "method": method,
        "scheme": str(rng.choice(["euler", "leapfrog"])),
        "wall": str(rng.choice(["tangent", "round"])),
        "stop": "residual" if method == "exact" else str(rng.choice(["zeta", "residual"])),
    }
    return Scene(**common | fields | fixed)


def random_gravity(rng: np.random.Generator) -> Any:
    gravity = (0.5, float(rng.choice([0.0, -9.81, -1e4])))
    return TurningGravity(gravity, rng.uniform(-3.0, 3.0)) if rng.random() < 0.3 else gravity


def random_contacts(rng: np.random.Generator, inner: float, method: str) -> dict[str, Any]:
    """Return random fields of a scene: friction, restitution, and perhaps a pressure on the outer wall.

    `inner` is the radius of the inner wall [m]; 0 without one.
    """
    fields: dict[str, Any] = {}
    if method != "exact" and rng.random() < 0.4:
        fields |= {"friction": float(rng.choice([0.0, 0.05, 0.5, 2.0])), "wall_friction": 0.6}
        fields |= {"angular_velocity_out": float(rng.normal(0.0, 10.0)), "spin_drag": rng.choice([0.0, 1e-6])}
        fields |= {"angular_velocity_in": 8.0} if inner > 0.0 else {}
        if rng.random() < 0.5:
            fields |= {"rolling_friction": 0.2, "wall_rolling_friction": rng.choice([None, 0.0, 0.5])}
    if rng.random() < 0.3:
        fields |= {"wall": "tangent"}
        if rng.random() < 0.6:
            fields |= {"pressure": rng.uniform(0.1, 50.0), "wall_mass": rng.choice([None, 0.5])}
    if rng.random() < 0.5:
        fields |= {"restitution": 0.6, "wall_restitution": rng.choice([None, 1.0, 0.0])}
        fields |= {"restitution_speed": 0.1}
    return fields


def random_motion(rng: np.random.Generator, fastest: float) -> dict[str, Any]:
    """Return random fields of the motion of a wall, up to `fastest` [m/s], or none for a wall at rest.

    The motion may begin and end within a step.
    """
    if rng.random() < 0.4:
        return {}
    return {
        "velocity": tuple(rng.uniform(-fastest, fastest, 2).tolist()),
        "angular_velocity": float(rng.choice([0.0, fastest])),
        **rng.choice([{}, {"frequency": 8.0, "phase": 1.0}]),
        "start_time": rng.choice([0.0, 0.013, 0.016]),
        "end_time": rng.choice([None, 0.053, 0.056]),
        "pivot": (0.1, -0.2) if rng.random() < 0.5 else None,
    }


def random_walls(rng: np.random.Generator, fastest: float) -> list[Any]:
    """Return random walls, up to one of every kind, and some joined walls, which share one motion.

    `fastest` is the largest speed of a motion [m/s].
    """
    one = random_motion(rng, fastest)
    joined = [replace(wall, **one) for wall in CORNERS["chute"]]
    crossing = Segment(*map(tuple, rng.uniform(-1.0, 1.0, (2, 2))))
    apart = [replace(wall, **random_motion(rng, fastest)) for wall in (crossing, *OF_EVERY_KIND)]
    kept = [wall for wall in apart if rng.random() < 0.3]
    return kept + [joined[k] for k in rng.permutation(len(joined))[: rng.choice([0, 2, 5])]]
