"""Calls that homeworks must answer. Each starts from the reference's state, so that errors do not accumulate.

Each mistake changes the result of at least one scene, and no two mistakes have the same effect. Masses and
radii differ, grains touch and overlap each other and both walls, the lightest and heaviest come first, and
initial speeds close any gap within a step. No parameter is the same in all scenes: neither the number of
grains, the walls (one scene has no inner wall), gravity, drag and dt, nor tolerance and iterMax. The smallest
scenes come first.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.grade.sandbox import CONTACT, UPDATE, Call, Child
from warpgrains.grade.words import Words, joined
from warpgrains.scene.scene import Scene

FIRST_ITERATIONS = 3  # number of iterations of a step that are called one by one, from 0
_MOST = 30
_NOISE = 1e-9  # [m/s]: smaller zeta are rounding errors


class Probe(NamedTuple):
    """A call with its scene and step."""

    scene: str
    step: int
    call: Call

    def place(self, iteration: int | None = None, contact: Words | None = None) -> Words:
        """Return the scene and step, and the iteration (by default that of the call) and contact if any."""
        if iteration is None and self.call.iteration >= 0:
            iteration = self.call.iteration
        place = [Words("scene {scene}", scene=self.scene), Words("step {step}", step=self.step)]
        place += [] if iteration is None else [Words("iteration {iteration}", iteration=iteration)]
        return joined([*place, *([contact] if contact else [])])


def make_probes(reference: Child) -> dict[str, list[Probe]]:
    """Advance some scenes with the reference, and return calls of each function from its states."""
    contact: list[Probe] = []
    update: list[Probe] = []
    for scene, steps in _scenes():
        call = start_of(scene)
        for step in range(1, max(steps) + 1):
            if step in steps:
                iterations, zeta = _iterations(reference, call)
                contact += [Probe(scene.name, step, each) for each in iterations[:FIRST_ITERATIONS]]
                update += _updates(Probe(scene.name, step, call), zeta)
            call = call._replace(state=reference.ask(call).state)
    return {CONTACT: contact, UPDATE: update}


def _scenes() -> Iterator[tuple[Scene, range]]:
    """Yield the scenes, and the steps at which homeworks are called."""
    ring = {"drag": 0.05, "dt": 0.02, "max_iterations": 1000}
    fall = {"radius": [0.1], "mass": [0.3], "radius_out": 1.3, "gravity": (1.5, -9.81)}
    yield _scene("one", [[0.05, 0.58]], [[-12.0, -45.0]], **fall, **ring), range(1, 41, 2)
    centers, speeds = [[-0.7, 0.7], [0.2, 1.0]], [[12.0, 2.0], [-9.0, 0.0]]
    fall = {"gravity": (-3.7, 4.2), "radius_in": 0.45}
    yield _scene("two", centers, speeds, [0.08, 0.15], [0.2, 2.0], **ring | fall), range(1, 31)
    centers, speeds = [[-0.31, 0.86], [0.03, 0.83], [0.4, 0.9]], [[40.0, 5.0], [2.0, -10.0], [-20.0, 60.0]]
    fall = {"gravity": (0.9, -1.62), "drag": 0.08, "dt": 0.016}
    yield _scene("three", centers, speeds, [0.12, 0.17, 0.15], [0.4, 1.5, 0.9], **ring | fall), range(1, 13)
    random = np.random.default_rng(13)
    angle = 2.0 * np.pi * np.arange(14) / 14
    distance = 0.8 + 0.05 * random.uniform(-1.0, 1.0, 14)
    position = np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1)
    radius, mass = random.uniform(0.1, 0.18, 14), np.exp(random.uniform(np.log(0.1), np.log(4.0), 14))
    velocity = random.uniform(-4.0, 4.0, (14, 2))
    fall = {"gravity": (6.0, 14.0), "dt": 0.025, "radius_out": 1.05}
    yield _scene("mixed", position, velocity, radius, mass, **ring | fall), range(1, 11)
    yield Scene.load("annulus"), range(1, 302, 50)
    outward = position / distance[:, None]
    radius = random.permutation(np.linspace(0.025, 0.125, 28))
    fall = {"radius_in": 0.3, "gravity": (0.0, -9.81), "drag": 0.02, "max_iterations": 1000}
    position = np.concatenate([0.65 * outward, 1.1 * outward])
    yield (
        _scene("polydisperse", position, 0.0 * position, radius, 30.0 * radius**2, **fall),
        range(11, 122, 20),
    )
    position = np.concatenate([share * outward for share in (0.7, 1.0, 1.3)])
    radius = random.uniform(0.05, 0.12, 42)
    fall = {"radius_in": 0.0, "gravity": (2.5, 3.0), "drag": 0.1, "dt": 0.013, "max_iterations": 1000}
    mass = 50.0 * random.permutation(radius) ** 2
    yield _scene("circle", position, 3.0 * position, radius, mass, **fall), range(1, 92, 30)


def _scene(
    name: str, position: object, velocity: object, radius: object, mass: object, **others: object
) -> Scene:
    arrays = {
        key: np.array(value, np.float64)
        for key, value in (("position", position), ("velocity", velocity), ("radius", radius), ("mass", mass))
    }
    return Scene(name=name, **{"radius_in": 0.5, "radius_out": 1.5, **arrays, **others})  # type: ignore[arg-type]


def start_of(scene: Scene) -> Call:
    """Return a call of femGrainsUpdate for the first step of a scene."""
    n = scene.n
    arrays = (*scene.position.T, *scene.velocity.T, scene.radius, scene.mass, np.zeros(n + n * (n - 1) // 2))
    limits = (scene.dt, scene.tolerance, scene.max_iterations, scene.radius_in, scene.radius_out)
    return Call(n, -1, *limits, scene.gravity_at(0.0), scene.drag, np.concatenate(arrays))


def _iterations(reference: Child, step: Call) -> tuple[list[Call], FloatArray]:
    """Return the iterations of a step as calls, each with the state at its start, and their zeta."""
    state, n = step.state.copy(), step.n
    velocity, mass = state[2 * n : 4 * n].reshape(2, n), state[5 * n : 6 * n]
    velocity += step.dt * (np.array(step.gravity)[:, None] - step.drag / mass * velocity)
    calls, zeta = [], []
    for iteration in range(_MOST + 1):
        calls.append(step._replace(iteration=iteration, state=state))
        answer = reference.ask(calls[-1])
        state = answer.state
        zeta.append(answer.zeta)
    return calls, np.array(zeta)


def _updates(step: Probe, zeta: FloatArray) -> list[Probe]:
    """Return the step with a tolerance that zeta passes clearly, and with a limit that ends it before."""
    limit = 3 + step.step % 6
    ends = [(_clearest_drop(zeta), 2 * _MOST + step.step), (0.5 * zeta[1 : limit + 3].min(), limit)]
    return [
        step._replace(call=step.call._replace(tolerance=tolerance, max_iterations=float(most)))
        for tolerance, most in ends
        if tolerance >= _NOISE
    ]


def _clearest_drop(zeta: FloatArray) -> float:
    """Return a value between zeta, where it falls furthest below all earlier values, and these."""
    drops = {
        k: max(zeta[k], _NOISE) / zeta[1:k].min()
        for k in range(2, len(zeta))
        if max(zeta[k], _NOISE) < zeta[1:k].min()
    }
    if not drops:
        return _NOISE
    last = min(drops, key=lambda k: drops[k])
    return float(np.sqrt(drops[last]) * zeta[1:last].min())
