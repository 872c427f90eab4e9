"""The accelerated method against plain Gauss-Seidel: sweeps to a true error, and the time of a sweep."""

from collections.abc import Callable, Iterator
from functools import partial
from math import pi, sqrt
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation, State
from warpgrains.arrays import FloatArray
from warpgrains.scene.state import Corrections

from .inside import Sweeps
from .options import Options
from .piles import settled_pile
from .rows import Subject, row
from .timing import in_turn, seconds

ERROR = 1e-6  # of the velocities, in units of the largest change that the contacts make
MOST = 30_000  # sweeps after which a solve is given up
EXACT = {"tolerance": 1e-13, "max_iterations": 60_000}  # what the error is against
SEEDS = (1, 2, 3)
SETTLING = 150  # steps: 1.5 s
SWEPT, SWEEPS = 10_000, 200  # grains, and how often they are swept in one go


def accelerated(options: Options) -> Iterator[dict[str, str]]:
    """Sweeps from a cold start, and what one sweep costs."""
    for name, n, make, target in (
        ("a settled pile", 500, partial(_settled, ratio=1.0), "<= 5000"),
        ("a settled pile with radii 1:5", 300, partial(_settled, ratio=5.0), "<= 1800"),
        ("a column with a grain landing at 1 m/s", 200, _struck_column, "<= 1200"),
    ):
        n = min(n, options.largest)
        starts = [make(n, seed=seed) for seed in SEEDS]
        counts = [_sweeps_needed(*start, method="accelerated") for start in starts]
        plain = _sweeps_needed(*starts[0], method="gauss-seidel")
        subject = Subject(f"sweeps to a true relative error of {ERROR:g}, {name}", n, "color")
        other = f"plain: more than {MOST:,}" if plain is None else f"plain: {plain:,}"
        yield row(subject, [count or MOST for count in counts], "sweeps", other, target=target)
    yield _one_sweep(options)


def _one_sweep(options: Options) -> dict[str, str]:
    """Time of a sweep with momentum against that of one without, on the same pile."""
    n = min(SWEPT, options.largest)
    pile = settled_pile(n, options.cache)
    keys = {"order": "color", "max_iterations": SWEEPS}
    arrays = [Sweeps(pile.simulation(**keys, method=method)) for method in ("accelerated", "gauss-seidel")]
    for swept in arrays:
        _us_a_sweep(swept)  # once, so that the launches are captured
    ours, plain = in_turn(options.repeats, *(partial(_us_a_sweep, swept) for swept in arrays))
    target = "<= 1.3" if n == SWEPT else ""
    return row(
        Subject(f"one accelerated sweep, {pile.kind}", n, "color"), ours, "us", "plain", plain, target=target
    )


def _us_a_sweep(arrays: Sweeps) -> float:
    arrays.reset()
    return seconds(arrays.run) / SWEEPS * 1e6


def _sweeps_needed(scene: Scene, start: State, method: str) -> int | None:
    """How many sweeps a step takes to the true error, to within ten; None if the most are not enough."""
    solve: Callable[..., FloatArray] = partial(_solve, scene, start)
    exact = solve(method="accelerated", **EXACT)
    free = start.velocity + scene.dt * np.array(scene.gravity)
    allowed = ERROR * np.abs(free - exact).max()
    too_few, enough = 0, MOST

    def is_enough(sweeps: int) -> bool:
        solved = solve(method=method, max_iterations=sweeps, tolerance=0.0)
        return bool(np.abs(solved - exact).max() <= allowed)

    if not is_enough(MOST):
        return None
    while enough - too_few > 10:
        half = (too_few + enough) // 2
        too_few, enough = (too_few, half) if is_enough(half) else (half, enough)
    return enough


def _solve(scene: Scene, start: State, **changes: Any) -> FloatArray:
    """Return the velocities after one step."""
    simulation = Simulation(scene, threads=1, stop="residual", **changes)
    simulation.restore(start)
    simulation.step()
    return simulation.velocity


def _settled(n: int, seed: int, ratio: float) -> tuple[Scene, State]:
    """Grains that have fallen from rows to the bottom of a disc; their corrections are forgotten."""
    radius, rng = sqrt(0.4 / n), np.random.default_rng(seed)
    pitch = 2.05 * radius
    rows = np.arange(-1.0, 1.0, pitch * sqrt(3.0) / 2.0)
    x = np.arange(-1.0, 1.0, pitch) + pitch / 2.0 * (np.arange(len(rows)) % 2)[:, np.newaxis]
    position = np.column_stack([x.ravel(), np.repeat(rows, x.shape[1])])
    position = position[np.hypot(*position.T) < 1.0 - 1.02 * radius][:n]
    position = position + rng.uniform(-0.01, 0.01, position.shape) * radius
    radii = radius * rng.uniform(1.0 / ratio, 1.0, len(position))
    scene = _scene(position=position, radius=radii, mass=pi * radii**2)
    simulation = Simulation(scene, threads=1)
    simulation.run(steps=SETTLING)
    return scene, _cold(simulation.state())


def _struck_column(n: int, seed: int) -> tuple[Scene, State]:
    """Grains on top of each other, and one more above them that falls on them, from another height each."""
    radius = 0.85 / n
    height = -1.0 + radius + 2.0 * radius * np.append(np.arange(n), n)
    height[-1] += 0.004 * (seed - 1)
    velocity = np.zeros((n + 1, 2))
    velocity[-1, 1] = -1.0
    position = np.column_stack([np.full(n + 1, 1e-9), height])
    scene = _scene(position=position, velocity=velocity, radius=radius, mass=1.0)
    return scene, _cold(Simulation(scene, threads=1).state())


def _scene(**grains: Any) -> Scene:
    return Scene(
        **grains,
        radius_out=1.0,
        drag=0.0,
        dt=1e-2,
        tolerance=1e-6,
        max_iterations=MOST,
        method="accelerated",
        order="color",
    )


def _cold(state: State) -> State:
    """The state without the corrections of its last step."""
    nobody, nothing = np.zeros((0, 2), np.int32), np.zeros(0)
    none = Corrections(nobody, nothing, nobody, nothing)
    return State(0, state.position, state.velocity, none)
