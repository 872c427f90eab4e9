"""One grain at walls of every kind, against closed forms: at rest, moving, driven, joined, and bouncing."""

from collections.abc import Iterator, Sequence
from itertools import permutations
from math import acos, cos, cosh, exp, hypot, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
import pytest
from walled_scenes import alone, chained

from warpgrains import Arc, Disc, Line, Scene, Segment, Simulation
from warpgrains.scene.fields import METHODS
from warpgrains.walls.wall import Wall

EPS, G = np.finfo(float).eps, 9.81
FREE: dict[str, Any] = {"gravity": (0.0, 0.0)}
ALONG, UP = np.array([cos(0.5), -sin(0.5)]), np.array([sin(0.5), cos(0.5)])  # a slope of 0.5 rad


class Form(NamedTuple):
    """Walls, where a grain of radius 0.1 m begins, and what it and its contacts are after a time."""

    walls: Sequence[Any]
    position: Any
    time: float
    known: dict[str, tuple[Any, Any]]
    """Values, and by how much they may be off."""
    velocity: tuple[float, float] = (0.0, 0.0)
    overlap: float = 1e-13
    """The worst on the way [m]."""
    fields: dict[str, Any] | None = None


def resting() -> Iterator[tuple[str, Form]]:
    walls: dict[str, list[Wall]] = {
        "a segment": [Segment((-1.0, 0.0), (1.0, 0.0))],
        "a line": [Line((0.0, 0.0), (0.0, 1.0), 2.0)],
        "a disc": [Disc((0.0, -1.0), 1.0)],
        "a ring": [Disc((0.0, 1.0), 1.0, inside=True)],
        "an arc": [Arc((0.0, 1.0), 1.0, -2.5, -0.5)],
        "the upper side of an arc": [Arc((0.0, -1.0), 1.0, 0.5, 2.5)],
        # both walls have the corner as nearest point: one of them carries the weight
        "a corner": [Segment((-1.0, -1.0), (0.0, 0.0)), Segment((0.0, 0.0), (1.0, -1.0))],
    }
    known = {"force": (G, 1e-11), "gap": (0.0, 1e-15), "wall": ((0, 0), 0)}
    for what, own in walls.items():
        yield f"on {what}", Form(own, (0.0, 0.1), 0.1, known)


def sliding() -> Iterator[tuple[str, Form]]:
    # the acceleration is g sin(theta) on either side: below a segment, gravity points upwards
    slope = Segment(tuple(-1.5 * ALONG), tuple(1.5 * ALONG))
    for side in (1.0, -1.0):
        start, way = side * (0.1 * UP - ALONG), 0.5 * side * G * sin(0.5) * 0.5**2 * ALONG
        down = {"gravity": (0.0, -G * side)}
        yield f"down, {side}", Form([slope], start, 0.5, {"position": (start + way, 1e-10)}, fields=down)
    # the period of small swings is 2 pi sqrt((R - r) / g)
    half, low = pi * sqrt(0.9 / G), -sqrt(0.9**2 - 0.01**2)
    for bowl in (Disc((0.5, 0.0), 1.0, inside=True), Arc((0.5, 0.0), 1.0, -2.5, -0.5)):
        known = {"position": ((0.49, low), 1e-4)}
        yield f"in a bowl, {bowl.kind}", Form([bowl], (0.51, low), half, known, (0, 0), 1e-9, {"dt": 1e-3})


def moving() -> Iterator[tuple[str, Form]]:
    short = {"dt": 1e-3}
    lift = Segment((-1.0, 0.0), (1.0, 0.0), velocity=(0.0, 0.5), start_time=0.1, end_time=0.6)
    for what, time, known in (
        ("carries", 0.6, {"position": ((0.0, 0.35), 1e-12)}),
        ("throws off where it stops", 0.601, {"velocity": ((0.0, 0.5 - G * 1e-3), 1e-9)}),
        ("at rest", 1.001, {"position": ((0.0, 0.35), 1e-12), "force": (G, 1e-5)}),
    ):
        yield f"lift, {what}", Form([lift], (0.0, 0.1), time, known, fields=short)
    # a disc on a belt of speed V ends at V / 3, its rim at 2 V / 3; velocities are those half a step earlier
    belt = Segment((-2.0, 0.0), (2.0, 0.0), velocity=(1.5, 0.0), friction=0.3)
    for what, time, known in (
        ("slides", 0.1, {"velocity": ((0.3 * G * 0.0995, 0.0), 1e-9)}),
        ("rolls", 0.3, {"velocity": ((0.5, 0.0), 1e-9), "spin": (10.0, 1e-8)}),
    ):
        yield f"belt, {what}", Form([belt], (0.0, 0.1), time, known, fields=short)
    # a plate that oscillates carries it, as long as it falls more slowly
    shaken = Segment(
        (-1.0, 0.0), (1.0, 0.0), velocity=(0.0, 0.5), frequency=2.5, phase=0.3, start_time=0.1004
    )
    for time in (0.35, 0.8):
        way = 0.5 * (sin(5.0 * pi * (time - 0.1004) + 0.3) - sin(0.3)) / (5.0 * pi)
        known = {"position": ((0.0, 0.1 + way), 1e-12)}
        yield f"plate, it oscillates, {time}", Form([shaken], (0.0, 0.1), time, known, fields=short)
    # in a step in which it starts or stops, it moves for a part of the time
    plate = Segment((-1.0, 0.0), (1.0, 0.0), velocity=(0.0, 0.5), start_time=0.1004, end_time=0.3002)
    for what, time, known in (
        ("starts", 0.101, {"position": ((0.0, 0.1 + 0.5 * 0.6e-3), 1e-12), "velocity": ((0.0, 0.3), 1e-9)}),
        ("has stopped", 0.9, {"position": ((0.0, 0.1 + 0.5 * 0.1998), 1e-12), "force": (G, 1e-5)}),
    ):
        yield f"plate, {what}", Form([plate], (0.0, 0.1), time, known, fields=short)


def driven() -> Iterator[tuple[str, Form]]:
    # speeds are F t / M, half a step earlier in the leapfrog; a pressure acts on 2 pi R
    plate = Segment((-0.2, 0.0), (0.2, 0.0), force=3.0, mass=2.0)
    for scheme, late, ahead in (("euler", 0.0, 1e-3), ("leapfrog", 0.5e-3, 0.0)):
        ways, speeds = 0.5 * 0.2 * (0.2 + ahead), 0.2 - late
        known = (1.5 * ways, 1.5 * speeds, 1.0 - pi * ways / 1e6, -pi * speeds / 1e6)
        off = (1e-12, 1e-12, 1e-12, 1e-11)  # R is off by 1e-7 of it, and so is the pressure's force
        for method in METHODS[:2]:
            fields = {"scheme": scheme, "method": method, "dt": 1e-3, "radius_out": 1.0}
            fields |= FREE | {"pressure": 0.5, "wall_mass": 1e6}
            form = Form([plate], (0.0, -0.5), 0.2, {"driven": (known, off)}, fields=fields)
            yield f"no contact, {scheme}, {method}", form
    # between a piston and a fixed wall it comes to rest, and both contacts carry the force
    for method, mass in (("gauss-seidel", 1e-6), ("gauss-seidel", 1.0), ("accelerated", 1e6)):
        piston = Segment((0.5, 0.15), (-0.5, 0.15), force=7.0, mass=mass)
        walls, dt = [Segment((-0.5, -0.1), (0.5, -0.1)), piston], 1e-2 * max(1.0, sqrt(mass))
        known = {
            "wall": ((0, 0, 0, 1), 0),
            "force": (7.0, max(7e-6, 1e-9 * mass / dt)),
            "gap": (0.0, 1e-8),
            "velocity": (0.0, 1e-9),
            "driven": ((0.0, 0.0, 0.05, 0.0, 6.0, 0.0), 1e-8),
        }
        fields = {"scheme": "euler", "method": method, "stop": "residual", "tolerance": 1e-10, "dt": dt}
        fields |= FREE | {"mass": 0.3}
        form = Form(walls, (0.0, 0.02), 300 * dt, known, overlap=1e-9 * dt, fields=fields)
        yield f"piston, {mass} kg, {method}", form


def joined() -> Iterator[tuple[str, Form]]:
    # each of 300 steps may leave the tolerance, 1e-12 m/s
    passed = {"velocity": ((1.0, 0.0), 3e-10), "position": ((1.5, -0.9), 1e-9)}
    for what, rolling in (("slides", {}), ("rolls", {"friction": 0.5, "spin": -10.0})):
        for segments in (1, 2, 40):
            line = np.stack([np.linspace(-2.0, 2.0, segments + 1), np.full(segments + 1, -1.0)], axis=1)
            form = Form(chained(line), (-1.5, -0.9), 3.0, passed, (1.0, 0.0), fields=rolling)
            yield f"in line, {what}, {segments}", form
    # it gains 2/3 g sin(theta), as on one segment; of second order: exact but for rounding
    slope = chained(np.linspace(-0.5, 2.0, 41)[:, np.newaxis] * ALONG)
    for dt in (0.01, 0.005):
        rolled = {"position": (0.1 * UP + G * sin(0.5) / 3.0 * ALONG, 1e-9)}
        fields = {"friction": 0.6, "dt": dt}
        yield f"down a slope, {dt}", Form(slope, 0.1 * UP, 1.0, rolled, fields=fields)
    # of v, v cos(turn) is left on the other wall, also after a step of half a radius
    for turn in (1e-3, 0.1, 0.7, 1.4):
        corner = chained(np.array([(-2.0, 0.0), (0.0, 0.0), (2.0 * cos(turn), 2.0 * sin(turn))]))
        left = {"velocity": ((cos(turn) ** 2, cos(turn) * sin(turn)), 1e-10)}
        for dt in (0.013, 0.05):
            fields = FREE | {"dt": dt}
            form = Form(corner, (-0.7, 0.1), 1.2, left, (1.0, 0.0), fields=fields)
            yield f"concave corner, {turn}, {dt}", form
    # a ramp just behind a joint is seen from its side only, in the step that passes its foot
    floor = chained(np.array([(-2.0, 0.0), (0.0, 0.0), (2.0, 0.0)]))
    walls = [*floor, Segment((0.03, 0.0), (1.0, 0.6))]
    for side, v, off in ((1.0, (5.0, 3.0), 2.0), (-1.0, (7.0, 0.0), 1e-10)):
        known = {"velocity": (v, off)}
        yield f"ramp, {side}", Form(walls, (-0.68, 0.1 * side), 0.2, known, (7.0, 0.0), fields=FREE)
    # at a convex corner it flies on, past a third wall that hangs from there
    hanging = [*chained(np.array([(-2.0, 0.0), (0.0, 0.0), (1.0, -1.0)])), Segment((0.0, -1.0), (0.0, 0.0))]
    known = {"velocity": ((1.0, 0.0), 2e-10)}
    for k, walls in enumerate(permutations(hanging)):
        yield f"convex corner, {k}", Form(walls, (-0.7, 0.1), 2.0, known, (1.0, 0.0), fields=FREE)


def bouncing() -> Iterator[tuple[str, Form]]:
    # it leaves a wall at e times the speed at which it came, relative to the wall
    ends, below = ((-1.0, 0.5), (1.0, 0.5)), {"radius_out": 0.6995}
    common = {"scheme": "euler", "wall_restitution": 0.6, "mass": 0.5, "tolerance": 0.0, "dt": 1e-3}
    for what, walls, speed, fields in (
        ("outer", [], 0.6 * 2.0, below),
        ("inner", [], 0.6 * 2.0, {"radius_in": 0.5}),
        ("segment", [Segment(*ends, restitution=0.25)], 0.25 * 2.0, {}),
        ("piston", [Segment(*ends, velocity=(0.0, 0.5))], 0.5 + 0.6 * 2.5, {}),
        ("driven", [Segment(*ends, force=0.0, mass=1.5, friction=0.0)], -2.0 + 1.6 * 2.0 * 0.75, {}),
    ):
        start = (0.0, -0.599 if fields == below else 0.6005)
        known = {"velocity": ((0.0, speed), (0.0, 8.0 * EPS * 0.6 / 1e-3))}  # of gap / dt
        for method in METHODS[:2]:
            how = FREE | common | {"method": method} | fields
            yield f"{what}, {method}", Form(walls, start, 1e-3, known, (0.0, -2.0), fields=how)
    # from h it rises to e^2 h, and rests at sqrt(2 h / g) (1 + e) / (1 - e); a bounce is early by up to v dt
    fall, off = sqrt(2.0 * 0.5 / G), 1.5 * sqrt(2.0 * 0.5 * G) * 1e-3
    fields = {"wall_restitution": 0.5, "dt": 1e-3}
    for what, time, known in (
        ("rises", 1.5 * fall, {"position": ((0.0, 0.1 + 0.5**2 * 0.5), off)}),
        ("rests", 1.2 * 3.0 * fall, {"velocity": (0.0, 1e-9), "position": ((0.0, 0.1), 1e-5)}),
    ):
        yield what, Form([Segment((-1.0, 0.0), (1.0, 0.0))], (0.0, 0.6), time, known, fields=fields)


KINDS = (resting, sliding, moving, driven, joined, bouncing)
FORMS = {f"{kind.__name__} {which}": form for kind in KINDS for which, form in kind()}


@pytest.mark.parametrize("which", FORMS)
def test_a_grain(which: str) -> None:
    form = FORMS[which]
    simulation = alone(form.position, form.walls, form.velocity, **form.fields or {})
    done = simulation.advance(round(form.time / simulation.scene.dt))
    assert done.overlap <= form.overlap
    contacts = simulation.wall_contacts()
    for name, (value, tolerance) in form.known.items():
        found = np.ravel(getattr(contacts if hasattr(contacts, name) else simulation, name))
        assert found.size > 0
        assert (np.abs(found - np.ravel(value)) <= tolerance).all(), (name, found)


TURN: dict[str, Any] = {"angular_velocity": 1.0, "pivot": (0.0, 0.0)}
ROUGH: dict[str, Any] = {"friction": 5.0, "spin": 1.0}
TURNING: dict[str, tuple[Wall, complex, complex, complex, dict[str, Any]]] = {
    # along a rod the way is s (cosh(w t) + sinh(w t)); on a face it rolls off by s cosh(sqrt(2/3) w t)
    "a rod": (Segment((0.0, 0.0), (4.0, 0.0), **TURN), 0.5 + 0.1j, 0.5, 0.5 * exp(1.0) + 0.1j, {}),
    "a face": (Segment((1, -2), (1, 2), **TURN), 0.9 + 0.3j, 0.0, 0.9 + 0.3j * cosh(sqrt(2 / 3)), ROUGH),
    # and at rest in a drum, and behind a disc that goes round, it turns with them
    "an arc": (Arc((0.0, 0.0), 1.0, -1.0, 1.0, **TURN), 0.9 + 0j, 0.0, 0.9 + 0j, ROUGH),
    "a disc": (Disc((1.0, 0.0), 0.3, **TURN), 0.6 + 0j, 0.0, 0.6 + 0j, ROUGH),
}
"""A wall that turns; where a grain begins, its velocity, and its place after 1 s, seen by one who turns."""


@pytest.mark.parametrize("scheme", ["euler", "leapfrog"])
@pytest.mark.parametrize("which", TURNING)
def test_walls_that_turn_are_of_second_order(which: str, scheme: str) -> None:
    """So is what is left as an overlap: (26b) bounds it."""
    wall, place, slip, end, fields = TURNING[which]
    off, overlaps, velocity = [], [], slip + 1j * place
    for dt in (0.02, 0.01):
        start = (place.real, place.imag), [wall], (velocity.real, velocity.imag)
        simulation = alone(*start, **FREE, dt=dt, scheme=scheme, **fields)
        overlaps.append(simulation.advance(round(1.0 / dt)).overlap)
        off.append(abs(complex(*simulation.position[0]) - end * np.exp(1j)))
    assert np.log2(off[0] / off[1]) == pytest.approx(2.0, abs=0.1)
    assert max(overlaps) == 0.0 if which == "a disc" else overlaps[1] < 0.26 * overlaps[0]


def test_grains_at_rest_in_a_drum_that_turns_stay_there() -> None:
    """Inertia presses a grain into each corner, off both sides by half the square of the angle of a step."""
    dt, corners = 0.01, np.exp(2j * pi * np.arange(7) / 6)
    walls = chained(np.stack([corners.real, corners.imag], axis=1), **TURN)
    place = corners[:6] * (1.0 - 0.1 / cos(pi / 6))
    given: Any = [np.stack([own.real, own.imag], axis=1) for own in (place, 1j * place)]
    grains = {"position": given[0], "velocity": given[1], "radius": 0.1, "mass": 1.0, "spin": np.ones(6)}
    scene = Scene(**grains, **FREE, radius_out=3.0, walls=walls, friction=0.5, dt=dt, scheme="leapfrog")
    simulation = Simulation(scene.replace(tolerance=1e-12, max_iterations=10_000))
    simulation.advance(628)
    off = simulation.position @ (1.0, 1.0j) * np.exp(-1j * simulation.time) - place
    assert np.abs(off).max() <= 1.1 * 0.1 * 0.5 * dt**2 / cos(pi / 6)
    assert np.abs(simulation.spin - 1.0).max() <= dt**2


@pytest.mark.parametrize(
    ("wall", "arm"),
    [(Segment((-1.0, 0.0), (0.0, 0.0)), 0.1), (Disc((0.0, 0.0), 1.0), 1.1)],
    ids=["an end", "a disc"],
)
def test_a_grain_slides_off(wall: Wall, arm: float) -> None:
    """It leaves a point or a disc without friction at cos(theta) = 2/3 of that at the start."""
    simulation = alone((arm * sin(0.5), arm * cos(0.5)), [wall], dt=1.2e-4 * sqrt(arm))
    while simulation.step().contacts:
        pass
    x, y = simulation.position[0]
    # within a step before it leaves it moves by |v| dt: an angle of sqrt(2 g arm / 3) dt / arm = 3.1e-4
    assert np.arctan2(x, y) == pytest.approx(acos(2.0 / 3.0 * cos(0.5)), abs=1e-3)
    assert hypot(x, y) == pytest.approx(arm, abs=1e-5 * arm)


def test_a_grain_climbs_a_smooth_chute() -> None:
    """A floor, an arc and an upright: it gets as high as its energy does, and comes back."""
    floor, upright = Segment((-3.0, 0.0), (0.0, 0.0)), Segment((1.0, 1.0), (1.0, 4.0))
    speed, heights = 3.0, [0.0]
    simulation = alone((-1.5, 0.1), [floor, Arc((0.0, 1.0), 1.0, -pi / 2, 0.0), upright], (speed, 0.0))
    while simulation.velocity[0, 0] > -0.5 * speed:
        simulation.step()
        heights.append(simulation.position[0, 1] - 0.1)
    # the tangents of the arc, of radius 0.9 m at the center, are left by up to (v dt)^2 / 1.8
    assert max(heights) == pytest.approx(speed**2 / (2.0 * G), abs=(0.01 * speed) ** 2 / 1.8)
