"""Calls that homeworks must answer. Each starts from the reference's state, so that errors do not accumulate.

Fixed scenes come first, the smallest before the others. Each mistake changes the result of at least one of
them, and no two mistakes have the same effect. For this, masses and radii differ, the lightest and heaviest
grains have the first numbers, grains touch and overlap each other and both walls, and initial speeds close
any gap within a step. No parameter is the same in all scenes: number of grains, walls (one scene has no inner
wall), gravity, drag, dt, tolerance and iterMax.

Random calls follow, which show mistakes that occur only in rare scenes. They have 1 to 300 grains, lengths,
masses, dt, gravity and drag of all magnitudes, deep overlaps, and up to 400 iterations. Calls with few grains
are repeated, so that a homework is called more than a thousand times.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.grade.sandbox import CONTACT, UPDATE, Call, Child
from warpgrains.grade.words import Words, joined
from warpgrains.scene.scene import Scene

FIRST_ITERATIONS = 3  # number of iterations of a step that are called one by one, from 0
RANDOM = "random"
"""Name of the scene of the random calls."""
_MOST = 30
_NOISE = 1e-9  # [m/s]: smaller zeta are rounding errors
_DRAWN, _GRAINS, _CALLS = 24, 300, 400  # scenes; grains, and iterations, at most
_VISITS = 15_000  # of pairs by a call, about; so a call takes a millisecond
_REPEATED = 200  # calls from a state, at most


class Probe(NamedTuple):
    """A call with its scene and step."""

    scene: str
    step: int
    """Number of the step from 1; for a random call, the number of calls before it."""
    call: Call

    def place(self, iteration: int | None = None, contact: Words | None = None) -> Words:
        """Return a text that says where an error occurred: scene, step, iteration and contact, if given.

        For a random call, its parameters replace the step. By default, the iteration is that of the call.
        """
        if iteration is None and self.call.iteration >= 0:
            iteration = self.call.iteration
        place = [Words("scene {scene}", scene=self.scene)]
        place += [self._numbers()] if self.scene == RANDOM else [Words("step {step}", step=self.step)]
        place += [] if iteration is None else [Words("iteration {iteration}", iteration=iteration)]
        return joined([*place, *([contact] if contact else [])])

    def _numbers(self) -> Words:
        call = self.call
        numbers = {
            "call": self.step,
            "n": call.n,
            "dt": call.dt,
            "gamma": call.drag,
            "radiusIn": call.radius_in,
        }
        numbers |= dict(zip(("gravity[0]", "gravity[1]"), call.gravity, strict=True))
        numbers |= {"tol": call.tolerance, "iterMax": call.max_iterations} if call.iteration < 0 else {}
        text = ", ".join(f"{name} = {value:.4g}" for name, value in numbers.items())
        return Words(text, text)


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
                probe = Probe(scene.name, step, call)
                update += _updates(probe, zeta, 3 + step % 6, 2 * _MOST + step, _NOISE)
            call = call._replace(state=reference.ask(call).state)
    return {CONTACT: contact, UPDATE: update}


def draw_probes(reference: Child, seed: int) -> dict[str, list[Probe]]:
    """Return random calls of each function. The same seed gives the same calls."""
    random = np.random.default_rng(seed)
    drawn: dict[str, list[Probe]] = {CONTACT: [], UPDATE: []}
    sizes = _GRAINS ** ((random.permutation(_DRAWN) + random.uniform(size=_DRAWN)) / _DRAWN)
    for n in np.rint(sizes).astype(int).tolist():
        call, pairs = _draw(random, n), n * (n + 1) // 2
        most = min(_CALLS, 5 + _VISITS // pairs)
        step = Probe(RANDOM, 0, call._replace(max_iterations=float(most)))
        answer = reference.ask(step.call)
        noise = _NOISE * max(call.radius_out / call.dt, np.abs(answer.state[2 * n : 4 * n]).max())
        limit = int(np.rint(3.0 * ((most - 2) / 3.0) ** random.uniform() ** 0.5))
        asked = [probe.call for probe in _updates(step, answer.record[:, 2], limit, most, noise)]
        iterations = 0, 1, int(random.integers(2, most))
        state = call.state
        for iteration in iterations:
            asked.append(call._replace(iteration=iteration, state=state))
            state = reference.ask(asked[-1]).state
        for each in asked:
            probes, right = drawn[UPDATE if each.iteration < 0 else CONTACT], reference.ask(each)
            if each.radius_in == 0.0 and right != reference.ask(each._replace(radius_in=5e-324)):
                continue  # the text does not say what a grain at the center does
            before = probes[-1].step + probes[-1].call.times if probes else 0
            times = min(_REPEATED, 1 + _VISITS // ((pairs + 10) * max(1, right.calls)))
            probes.append(Probe(RANDOM, before, each._replace(times=times)))
    return drawn


def _draw(random: np.random.Generator, n: int) -> Call:
    """Return a random state of n grains before a step, with random parameters of the step."""

    def magnitude(least: float, most: float, size: int | None = None) -> Any:
        return 10.0 ** random.uniform(least, most, size)

    has_inner, is_light, is_free = random.uniform(size=3) < (0.7, 0.25, 0.25)
    dt, outer, mass = (
        magnitude(-5.0, 0.5),
        magnitude(-1.0, 1.0),
        magnitude(-2.0, 2.0) * magnitude(-1.0, 1.0, n),
    )
    inner = outer * random.uniform(0.1, 0.6) if has_inner else 0.0
    angle = random.uniform(0.0, 2.0 * np.pi, n)
    distance = outer * np.sqrt(random.uniform(max(0.4, inner / outer) ** 2, 1.0, n))
    radius = outer * np.sqrt(magnitude(-1.5, 0.0) / n) * random.uniform(0.5, 1.5, n)
    radius = np.minimum(radius, 0.4 * (outer - inner))  # so that no grain touches both walls
    x, y = distance * np.cos(angle), distance * np.sin(angle)
    speed = outer / dt * magnitude(-3.0, 0.0)
    turned = random.uniform(0.0, 2.0 * np.pi)
    pull = 0.0 if is_light else magnitude(-2.0, 3.0)
    gravity = pull * float(np.cos(turned)), pull * float(np.sin(turned))
    drag = 0.0 if is_free else float(mass.min()) / dt * magnitude(-4.0, 0.0)
    i, j = np.triu_indices(n, 1)
    is_near = np.hypot(x[j] - x[i], y[j] - y[i]) < 1.5 * (radius[i] + radius[j])
    kept = speed * random.uniform(0.0, 1.0, len(i)) * (is_near & (random.uniform(size=len(i)) < 0.5))
    side = random.choice([-1.0, 0.0, 1.0] if has_inner else [0.0, 1.0], n)
    velocity = speed * random.normal(size=(2, n))
    state = np.concatenate([x, y, *velocity, radius, mass, speed * random.uniform(size=n) * side, kept])
    return Call(n, -1, dt, 0.0, 1.0, inner, outer, gravity, drag, state)


def _scenes() -> Iterator[tuple[Scene, range]]:
    """Yield each scene that is not random, with the steps, counted from 1, whose calls homeworks get."""
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
    """Return the calls of femGrainsContactIterate in a step, and the zeta that each returns [m/s].

    `step` is the call of femGrainsUpdate. The state of each call is that before its iteration.
    """
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


def _updates(step: Probe, zeta: FloatArray, limit: int, most: int, noise: float) -> list[Probe]:
    """Return two calls of femGrainsUpdate: `step` with two pairs of tolerance [m/s] and iterMax.

    In the first call, a tolerance that rounding cannot decide ends the iterations (iterMax is `most`). In the
    second, iterMax is `limit` and ends them. Calls with tolerances below `noise` [m/s] are left out. `zeta`
    is that of `_iterations`.
    """
    ends = [(_clearest_drop(zeta, noise), most), (0.5 * zeta[1 : limit + 3].min(), limit)]
    return [
        step._replace(call=step.call._replace(tolerance=tolerance, max_iterations=float(most)))
        for tolerance, most in ends
        if tolerance >= noise
    ]


def _clearest_drop(zeta: FloatArray, noise: float) -> float:
    """Return a tolerance [m/s] at which rounding cannot change the number of iterations.

    `zeta` holds the zeta of iterations 0, 1, ... [m/s], with rounding errors of `noise`. The tolerance is the
    geometric mean of two successive minima of zeta, those with the largest ratio. It is `noise` if zeta has
    no second minimum.
    """
    drops = {
        k: max(zeta[k], noise) / zeta[1:k].min()
        for k in range(2, len(zeta))
        if max(zeta[k], noise) < zeta[1:k].min()
    }
    if not drops:
        return noise
    last = min(drops, key=lambda k: drops[k])
    return float(np.sqrt(drops[last]) * zeta[1:last].min())
