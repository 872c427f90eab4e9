"""Bits of some 200 random scenes: written once by a version of the kernels, and compared by later ones.

    python tests/support/golden_bits.py write FILE      (by the version to keep)
    python tests/support/golden_bits.py compare FILE

In color order a scene is compared until the first step in which a list was built during the sweeps.
Accelerated scenes are compared too, and counted apart.
"""

import hashlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import Disc, Scene, Segment, Simulation, SimulationError

STEPS = 30


def random_scene(seed: int) -> Scene:
    """Draw a scene: friction, walls that move or are driven, both orders, methods and schemes."""
    rng = np.random.default_rng((7, seed))
    n = int(rng.choice([1, 2, 20, 60, 150, 400], p=[0.03, 0.03, 0.2, 0.3, 0.3, 0.14]))
    inner = float(rng.choice([0.0, 0.3]))
    typical = np.sqrt(rng.uniform(0.3, 1.3) * (1.0 - inner**2) / max(n, 6))
    radius = np.minimum(typical * rng.uniform(1.0 / rng.choice([1.0, 1.5, 4.0]), 1.0, n), 0.3 * (1.0 - inner))
    distance = np.maximum(np.sqrt(rng.uniform(inner**2, 0.9, n)), 1.05 * inner)
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    position = distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    method = str(rng.choice(["gauss-seidel", "accelerated"], p=[0.75, 0.25]))
    rough, driven, moving = (bool(rng.random() < p) for p in (0.4, 0.2, 0.3))
    dt = float(rng.choice([1e-3, 1e-2]))
    fastest = 0.3 * float(radius.min()) / dt
    walls: list[Any] = []
    if moving:
        walls += [
            Segment(
                tuple(rng.uniform(-0.7, 0.7, 2)), tuple(rng.uniform(-0.7, 0.7, 2)),
                velocity=tuple(rng.uniform(-fastest, fastest, 2) * 0.5), friction=0.3 if rough else None,
            )
        ]  # fmt: skip
    if driven and rng.random() < 0.5:
        walls += [
            Segment((-0.6, 0.5), (0.6, 0.5), force=-20.0, mass=2.0, **({"friction": 0.0} if rough else {}))
        ]
    if rng.random() < 0.2:
        away = position[np.argmax(distance)]
        walls += [Disc(tuple(-0.6 * away / np.linalg.norm(away)), 0.05)]
    fields: dict[str, Any] = {"pressure": 50.0, "wall_mass": 0.5} if driven and len(walls) == 0 else {}
    if rough:
        fields |= {"friction": 0.5, "spin": rng.normal(0.0, 3.0, n)}
        fields |= {} if "pressure" in fields else {"angular_velocity_out": float(rng.normal(0.0, 2.0))}
    return Scene(
        position=position,
        velocity=rng.normal(0.0, rng.choice([0.0, 1.0, 5.0]), (n, 2)),
        radius=radius if rng.random() < 0.7 else float(radius.min()),
        mass=10.0 ** rng.uniform(-2.0, 2.0, n) if rng.random() < 0.3 else 1.0,
        radius_in=inner, radius_out=1.0, gravity=(0.0, float(rng.choice([0.0, -9.81]))),
        drag=float(rng.choice([0.0, 0.5])), dt=dt,
        tolerance=float(rng.choice([1e-6, 1e-3])), max_iterations=int(rng.choice([10, 100, 300])),
        order=str(rng.choice(["sequential", "color"])), method=method,
        scheme=str(rng.choice(["text", "leapfrog"])),
        wall=str(rng.choice(["tangent", "round"])) if not fields.get("pressure") else "tangent",
        walls=walls, **fields,
    )  # fmt: skip


def digests(seed: int, threads: int) -> tuple[list[str], int, Any]:
    """Return a digest of the state after every step, the first step to leave out, and the scene."""
    scene = random_scene(seed)
    simulation = Simulation(scene, threads=threads)
    found, valid = [], STEPS
    for step in range(STEPS):
        try:
            report = simulation.step()
        except SimulationError:
            break
        parts = [simulation.position, simulation.velocity, getattr(simulation, "spin", None)]
        text = b"".join(np.ascontiguousarray(p).tobytes() for p in parts if p is not None)
        found.append(hashlib.sha256(text).hexdigest()[:16] + f" {report.iterations}")
        if sys.argv[1] == "write" and scene.order == "color":
            control = simulation._records.host["control"][0]
            if (control["resuming"] or report.restarts) and valid == STEPS:
                valid = step
    return found, valid, scene


def main() -> None:
    path = Path(sys.argv[2])
    if sys.argv[1] == "write":
        table = {}
        for seed in range(218):
            try:
                one, valid, scene = digests(seed, 1)
            except Exception as error:
                print(seed, type(error).__name__, error)
                continue
            two, _, _ = digests(seed, 2)
            assert one == two, seed
            table[seed] = [one, valid, f"{scene.method} {scene.order}"]
        path.write_text(json.dumps(table))
        print(len(table), "scenes", sum(len(t[0][: t[1]]) for t in table.values()), "steps")
        return
    table = json.loads(path.read_text())
    same: dict[str, list[int]] = {}
    for seed, (kept, valid, kind) in table.items():
        for threads in (1, 2):
            found, _, _ = digests(int(seed), threads)
            equal = found[:valid] == kept[:valid]
            same.setdefault(kind, [0, 0])[0 if equal else 1] += 1
            if not equal:
                first = next((k for k, (a, b) in enumerate(zip(found, kept, strict=False)) if a != b), None)
                print("differs:", seed, kind, "threads", threads, "first step", first, "of", valid)
    for kind, (equal, other) in same.items():
        print(f"{kind}: {equal} the same, {other} differ")


if __name__ == "__main__":
    main()
