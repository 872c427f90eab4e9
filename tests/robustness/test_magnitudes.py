"""Constructors and scene files with values of all magnitudes: one line, or a scene that obeys its laws.

The laws: the closed box keeps its grains, the energy does not grow, and all numbers are finite. Thousands of
examples with -m slow.
"""

import tomllib
import warnings
from contextlib import contextmanager

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from trimmed import few_or_many

from warpgrains import Arc, Box, Disc, InputError, Line, Polyline, Scene, Segment, Simulation
from warpgrains.base.errors import SimulationError
from warpgrains.scene.toml import shipped_text, toml_value

USUAL = {
    "dt": 0.01,
    "drag": 0.1,
    "gravity": (0.0, -9.81),
    "tolerance": 1e-6,
    "max_iterations": 200,
    "friction": 0.3,
    "restitution": 0.5,
    "restitution_speed": 0.1,
    "spin_drag": 0.01,
    "time": 0.0,
    "duration": 1.0,
    "position": [(0.3, 0.3), (0.6, 0.32)],
    "velocity": [(0.1, 0.0), (0.0, 0.2)],
    "radius": 0.1,
    "mass": [0.2, 0.3],
    "x": (0.0, 1.0),
    "y": (0.0, 1.0),
    "side": {"friction": 0.3, "roughness": {"radius": 0.02, "spacing": 0.05}},
    "disc": ((0.5, 0.9), 0.05),
    "segment": ((0.2, 0.8), (0.8, 0.8)),
    "arc": ((0.5, 0.9), 0.05, 0.0, 1.0),
    "line": ((0.0, 0.01), (0.0, 1.0), 1.0),
    "polyline": ([(0.1, 0.9), (0.5, 0.8), (0.9, 0.9)],),
}
"""Values of two grains in a box; "side" is of its top, and the last ones are arguments of walls."""
NEEDED = ("position", "radius", "mass", "x", "y")
KINDS = {"disc": Disc, "segment": Segment, "arc": Arc, "line": Line, "polyline": Polyline}
ODD = [
    0.0,
    -0.0,
    np.nan,
    np.inf,
    -np.inf,
    5e-324,
    1.7e308,
    10**400,
    -(2**63),
    True,
    None,
    "1",
    [],
    [[1.0], [2, 3]],
]


@st.composite
def mutated(draw, value):
    """Return a value of which a number, or all, has another magnitude, or is odd."""
    if isinstance(value, (tuple, list)) and draw(st.integers(0, 9)):
        k = draw(st.integers(0, len(value) - 1))
        return type(value)(draw(mutated(own)) if j == k else own for j, own in enumerate(value))
    if isinstance(value, dict):
        k = draw(st.sampled_from(sorted(value)))
        return value | {k: draw(mutated(value[k]))}
    if draw(st.integers(0, 3)) == 0:
        return draw(st.sampled_from(ODD))
    far = draw(st.integers(0, 1))
    power = draw(st.integers(-320, 300) if far else st.integers(-8, 8))
    return draw(st.sampled_from([1.0, 1.0, -1.0])) * draw(st.floats(1.0, 9.99)) * 10.0**power


@st.composite
def scenes(draw):
    """Return the values of a scene: some usual ones, of which up to three are changed."""
    own = {name: USUAL[name] for name in USUAL if name in NEEDED or draw(st.integers(0, 3)) == 0}
    own |= {"dt": USUAL["dt"], "method": draw(st.sampled_from(["gauss-seidel", "accelerated", "exact"]))}
    own["scheme"] = draw(st.sampled_from(["euler", "euler", "leapfrog"]))
    for name in draw(st.lists(st.sampled_from(sorted(USUAL)), max_size=3)):
        own[name] = draw(mutated(USUAL[name]))
    own |= {"friction": 0.3} if "spin_drag" in own or "side" in own else {}
    own |= {"restitution": 0.5} if "restitution_speed" in own else {}
    return own


ROUNDED = 1e-13
"""Some hundred roundings of double."""
MOST_GRAINS = 300
FEW = 10.0
"""Contacts of two grains and a wall in a box."""


@contextmanager
def one_line():
    """Check that what fails says why in one line."""
    message = "refused"
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            yield
        except (InputError, SimulationError) as refusal:
            message = str(refusal)
    for said in (message, *(str(one.message) for one in warned)):
        assert "\n" not in said
    assert all("overlap" in str(one.message) for one in warned), warned


def energy(simulation):
    """Return the kinetic and potential energy, and the sum of the sizes of its terms."""
    scene, (x, v) = simulation.scene, (simulation.position, simulation.velocity)
    spin = 0.5 * (simulation.spin * scene.radius) ** 2
    parts = np.column_stack([0.5 * v**2, 0.5 * spin, -x * scene.gravity_at(0.0)])
    parts *= scene.mass[:, np.newaxis]
    return parts.sum(), np.abs(parts).sum()


def check_laws(scene, steps=5):
    """Check that a few steps obey the laws, or end in one line."""
    simulation = Simulation(scene, threads=1)
    box = scene.domain or Box(*[(-scene.radius_out, scene.radius_out)] * 2)
    low, high = np.array([box.x, box.y]).T
    margin = scene.radius[:, np.newaxis]
    is_closed = not (box.periodic or scene.has_driven_walls or any(wall.moves for wall in scene.walls))
    keeps_energy = is_closed and scene.scheme == "euler" and not scene.has_restitution
    keeps_energy &= not (scene.gravity_rate or scene.spin.any())
    before, overlap = energy(simulation), scene.count_overlaps().largest
    for _ in range(steps):
        report = simulation.step()
        own = simulation.contacts(), simulation.wall_contacts()
        for found in (simulation.position, simulation.velocity, simulation.spin, *(one.force for one in own)):
            assert np.isfinite(found).all()
        # no gap after a step is below -dt residual, but for the rounding of positions and of dt v
        free = np.abs(simulation.last_start()[1]).max() + scene.dt * np.abs(scene.gravity_at(0.0)).max()
        speed, size = max(free, np.abs(simulation.velocity).max()), np.abs([low, high]).max()
        slack = scene.dt * report.residual + ROUNDED * (size + scene.dt * speed)
        if is_closed:
            assert (simulation.position >= low + margin - slack).all()
            assert (simulation.position <= high - margin + slack).all()
        after = energy(simulation)
        # of a step without overlaps, energy changes by -m (v - v')^2 / 2 + m v'.(v' - v*), where the second
        # term is <= 0 if v' solves the step, and else as large as the impulses are wrong
        wrong = scene.mass.sum() * speed * (report.residual + overlap / scene.dt)
        if keeps_energy and np.isfinite(after).all():
            assert after[0] <= before[0] + FEW * wrong + ROUNDED * (after[1] + before[1])
        before, overlap = after, max(0.0, slack)


def check_scene(own):
    own = dict(own)
    walls = {name: own.pop(name) for name in KINDS if name in own}
    box = {"x": own.pop("x"), "y": own.pop("y")} | ({"top": own.pop("side")} if "side" in own else {})
    with one_line():
        made = [KINDS[name](*given) if isinstance(given, tuple) else given for name, given in walls.items()]
        check_laws(Scene(**own, domain=Box(**box), walls=made))


def test_scenes(how):
    how(given(scenes())(check_scene))()


test_scenes = few_or_many(300, 10_000)(test_scenes)


@st.composite
def overrides(draw):
    """Return the name of a shipped scene of few grains, and up to three overrides of its values."""
    name = draw(st.sampled_from(["annulus", "box", "shear", "hopper", "pile"]))
    sections = tomllib.loads(shipped_text("scene", name))
    values = {f"{of}.{key}": v for of, t in sections.items() if isinstance(t, dict) for key, v in t.items()}
    changed = draw(st.lists(st.sampled_from(sorted(values)), min_size=1, max_size=3, unique=True))
    values = {key: draw(mutated(values[key])) for key in changed}
    return name, [f"{key}={toml_value(value)}" for key, value in values.items() if "None" not in str(value)]


def check_file(example):
    with one_line():
        scene = Scene.load(*example)
        if scene.n < MOST_GRAINS:
            check_laws(scene, steps=2)


def test_scene_files(how):
    how(given(overrides())(check_file))()


test_scene_files = few_or_many(100, 3_000)(test_scene_files)
