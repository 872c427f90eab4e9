"""Scenes drawn at random: from dense to spread, of all methods, orders, schemes, walls and friction."""

from typing import Any

import numpy as np

from warpgrains import Disc, Scene, Segment
from warpgrains.scene.fields import METHODS, ORDERS

GRAINS = {"dense": (40, 160), "jammed": (20, 100), "huge": (500, 1500), "tiny": (1, 4), "spread": (5, 80)}
OFTEN = (0.25, 0.3, 0.005, 0.22, 0.225)


def random_scene(rng: np.random.Generator) -> Scene:
    """Draw a scene: its kind says how many grains there are, and how they overlap."""
    kind = str(rng.choice(list(GRAINS), p=OFTEN))
    n = int(rng.integers(*GRAINS[kind]))
    inner = float(rng.choice([0.0, 0.3]))
    filled = {"dense": rng.uniform(1.0, 6.0), "jammed": rng.uniform(0.9, 1.3), "tiny": 0.3}.get(kind, 0.5)
    typical = np.sqrt(filled * (1.0 - inner**2) / n)
    ratio = float(rng.choice([1.0, 1.5, 10.0]))
    radius = np.minimum(typical * rng.uniform(1.0 / ratio, 1.0, n), 0.3 * (1.0 - inner))
    distance = np.sqrt(rng.uniform(inner**2, 1.0, n)) * rng.uniform(0.8, 1.0)
    angle = rng.uniform(0.0, rng.choice([2.0, 1.0, 0.05]) * np.pi, n)
    position = np.maximum(distance, 1.001 * inner)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    method = str(rng.choice(METHODS[: 2 + (n < 60)]))
    fields: dict[str, Any] = {
        "walls": random_walls(rng, float(radius.min()), position) if rng.random() < 0.3 else []
    }
    if method != "exact" and rng.random() < 0.4:
        fields |= {"friction": float(rng.choice([0.05, 0.5, 2.0])), "spin": rng.normal(0.0, 10.0, n)}
        fields |= {"angular_velocity_out": float(rng.normal(0.0, 10.0))}
    elif method != "exact" and rng.random() < 0.2:
        fields |= {"pressure": 50.0, "wall_mass": 0.5}
    return Scene(
        position=position,
        velocity=rng.normal(0.0, rng.choice([0.0, 1.0, 20.0]), (n, 2)),
        radius=radius if ratio > 1.0 else float(radius.max()),
        mass=10.0 ** rng.uniform(-3.0, 3.0, n) if rng.random() < 0.3 else 1.0,
        radius_in=inner,
        radius_out=1.0,
        gravity=(0.0, float(rng.choice([0.0, -9.81, -1e4]))),
        drag=float(rng.choice([0.0, 0.05])),
        dt=float(rng.choice([1e-4, 1e-3, 1e-2])),
        tolerance=float(rng.choice([1e-8, 1e-4, 1e-2])),
        max_iterations=int(rng.choice([1, 10, 50, 200, 1000], p=[0.3, 0.3, 0.25, 0.13, 0.02])),
        order=str(rng.choice(ORDERS)),
        method=method,
        scheme=str(rng.choice(["text", "leapfrog"])),
        wall="tangent" if "pressure" in fields else str(rng.choice(["tangent", "round"])),
        stop="residual" if method == "exact" else str(rng.choice(["zeta", "residual"])),
        **fields,
    )


def random_walls(rng: np.random.Generator, smallest: float, position: np.ndarray) -> list[Any]:
    """Draw segments that move by less than the smallest radius in the longest step, and a disc on nothing."""
    fastest = 0.3 * smallest / 1e-2
    segments = [
        Segment(
            tuple(rng.uniform(-1.0, 1.0, 2)),
            tuple(rng.uniform(-1.0, 1.0, 2)),
            velocity=tuple(rng.uniform(-fastest, fastest, 2)),
            angular_velocity=float(rng.choice([0.0, 0.1 * fastest])),
        )
        for _ in range(rng.integers(1, 4))
    ]
    center = rng.uniform(-0.6, 0.6, 2)
    return [*segments, *[Disc(tuple(center), 0.05)] * bool((np.hypot(*(position - center).T) > 0.05).all())]
