"""Interface to the reference, a C program (grains.c): compile it, pass it a scene, and read its state."""

import ctypes
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from warpgrains.base.arrays import FloatArray, IndexArray, IntArray
from warpgrains.scene.scene import Scene
from warpgrains.scene.scheme import free_spin, free_velocity
from warpgrains.scene.state import State, first_state
from warpgrains.walls.motion import MOTION_NUMBERS

SOURCE = Path(__file__).parent / "grains.c"
DEFINES = [f"-D{name.upper()}={k}" for k, name in enumerate((*MOTION_NUMBERS, "motion_numbers"))]
"""Compiler options: macros for the C code with the index of each of `MOTION_NUMBERS`, and their count."""
FAST = ("-O3", "-march=native")
MOST_GRAINS = 3000  # of scenes that are timed; the program stores and visits all pairs

_Doubles, _Ints = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int)
_ROTATING = ("w", "angle", "u", "dtContacts", "dtBoundary", "dtWalls")
_ROLLING = ("rollingWalls", "spinWalls", "drContacts", "drBoundary", "drWalls")
_DRIVEN = ("drives", "places", "speeds")
_BEFORE = {"vxBefore": "vx", "vyBefore": "vy", "speedsBefore": "speeds"}
"""Arrays that a step copies at its beginning: the name of each, by the name of the copy in the struct."""
_PER_GRAIN = ("x", "y", "vx", "vy", "r", "m", "dvBoundary")


class Grains(ctypes.Structure):
    """The C struct `femGrains` (fem.h)."""

    _fields_ = (
        ("n", ctypes.c_int),
        ("radiusIn", ctypes.c_double),
        ("radiusOut", ctypes.c_double),
        ("gravity", ctypes.c_double * 2),
        ("gamma", ctypes.c_double),
        *((name, _Doubles) for name in (*_PER_GRAIN, "dvContacts")),
        *((name, ctypes.c_int) for name in ("leapfrog", "staggered", "round", "nWalls")),
        *((name, _Doubles) for name in ("walls", "dvWalls")),
        *((name, _Ints) for name in ("jointStart", "joints", "jointFirst")),
        *((name, _Doubles) for name in ("jointWays", "images")),
        *((name, ctypes.c_double) for name in ("friction", "wallFriction", "spinDrag", "turningOut")),
        *((name, _Doubles) for name in ("speedWalls", "frictionWalls")),
        *((name, ctypes.c_int) for name in ("rough", "moving", "steps")),
        *((name, ctypes.c_double) for name in ("turning", "start")),
        *((name, _Doubles) for name in ("motions", *_ROTATING)),
        ("driven", ctypes.c_int),
        *((name, _Doubles) for name in _DRIVEN),
        ("period", ctypes.c_double * 2),
        ("bouncy", ctypes.c_int),
        *((name, ctypes.c_double) for name in ("restitution", "restitutionOut")),
        ("restitutionWalls", _Doubles),
        ("restitutionSpeed", ctypes.c_double),
        *((name, _Doubles) for name in _BEFORE),
        ("rolling", ctypes.c_int),
        *((name, ctypes.c_double) for name in ("rollingFriction", "wallRollingFriction")),
        *((name, _Doubles) for name in _ROLLING),
    )


def build(folder: Path, flags: Sequence[str] = ("-O2",)) -> ctypes.CDLL:
    """Compile the reference to a library in a folder, and load it.

    `flags` are compiler options. Products and sums are not fused, so that results do not depend on the
    machine. Raises RuntimeError if the compiler is missing or fails.
    """
    library = folder / "libgrains.so"
    fixed = ["-ffp-contract=off", "-shared", "-fPIC", str(SOURCE), "-o", str(library), "-lm"]
    command = ["cc", *flags, *DEFINES, *fixed]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True)
    except FileNotFoundError as error:
        raise RuntimeError(
            "the C reference needs a C compiler, and none was found: install one as `cc`"
        ) from error
    except subprocess.CalledProcessError as error:
        raise RuntimeError(f"`{' '.join(command)}` failed:\n{error.stderr}") from error
    built = ctypes.CDLL(str(library))
    grains, number, whole = ctypes.POINTER(Grains), ctypes.c_double, ctypes.c_int
    contacts = np.ctypeslib.ndpointer(np.int32, ndim=2, flags="C_CONTIGUOUS")
    signatures: dict[str, tuple[type | None, list[type]]] = {
        "femGrainsCreateSimple": (grains, [whole, number, number, number, number]),
        "femGrainsFree": (None, [grains]),
        "femGrainsUpdate": (None, [grains, number, number, number]),
        "femGrainsFreeSpeeds": (None, [grains, number]),
        "femGrainsContactIterate": (number, [grains, number, whole]),
        "femGrainsContactIterateOrder": (number, [grains, number, whole, whole, contacts]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(built, name)
        function.restype, function.argtypes = result, arguments
    return built


class Reference:
    """A simulation of a scene by the reference program, which `build` returns as `library`.

    It starts at the start of the scene, or at a state of another simulation.
    """

    def __init__(self, library: ctypes.CDLL, scene: Scene, state: State | None = None):
        self._library, self._scene = library, scene
        n = scene.n
        given = (*scene.position.T, *scene.velocity.T, scene.radius, scene.mass, np.zeros(n))
        self._arrays = {name: values.copy() for name, values in zip(_PER_GRAIN, given, strict=True)}
        self._arrays["dvContacts"] = np.zeros(n * (n - 1) // 2)
        pointers = [array.ctypes.data_as(_Doubles) for array in self._arrays.values()]
        gravity = (ctypes.c_double * 2)(*scene.gravity)
        bodies, walls = scene.bodies, scene.bodies.inside
        self._grains = Grains(n, *bodies.circles, gravity, scene.drag, *pointers)
        self._arrays["walls"] = np.array([wall.shape for wall in walls]).ravel()
        self._arrays["dvWalls"] = np.zeros(n * len(walls))
        self._grains.friction, self._grains.wallFriction = scene.friction, bodies.surfaces[0, 0]
        self._grains.spinDrag = scene.spin_drag
        self._grains.turningOut = bodies.outer.rotation if bodies.outer else 0.0
        self._arrays["frictionWalls"], self._arrays["speedWalls"] = bodies.surfaces[1:].T.copy()
        self._arrays["motions"] = np.array([[*wall.motion_numbers.values()] for wall in walls]).ravel()
        self._grains.rough, self._grains.moving = scene.has_friction, scene.has_moving_walls
        self._grains.period[:] = scene.period.lengths
        self._grains.turning, self._grains.start = scene.gravity_rate, scene.time
        rotating = (
            scene.spin.copy(),
            *np.zeros((2, n)),
            *map(np.zeros, (n * (n - 1) // 2, n, n * len(walls))),
        )
        self._arrays |= dict(zip(_ROTATING, rotating, strict=True))
        driven = first_state(scene).driven if state is None else state.driven
        self._grains.driven = driven is not None
        places, speeds = np.zeros((2, 1 + len(walls)))
        self._of_walls = bodies.of_walls
        if driven is not None:
            places[0] = bodies.circles[1]
            places[self._of_walls], speeds[self._of_walls] = driven.T
            self._grains.radiusOut = places[0]
        self._arrays["drives"] = np.array([np.hstack(drive) for drive in bodies.drives]).ravel()
        self._arrays |= {"places": places, "speeds": speeds}
        self._grains.bouncy, self._grains.restitution = scene.has_restitution, scene.restitution
        self._grains.restitutionOut = bodies.restitutions[0]
        is_first = state is None or state.steps == 0
        self._grains.restitutionSpeed = scene.bouncing_speed(is_first)
        self._arrays["restitutionWalls"] = bodies.restitutions[1:].copy()
        self._arrays |= {name: self._arrays[own].copy() for name, own in _BEFORE.items()}
        of_walls = ("walls", "dvWalls", "speedWalls", "frictionWalls", "motions", "restitutionWalls")
        self._grains.rolling, self._grains.rollingFriction = (
            scene.has_rolling_friction,
            scene.rolling_friction,
        )
        self._grains.wallRollingFriction = bodies.rolling[0, 0]
        rolling = *bodies.rolling[1:].T.copy(), *(self._arrays[name].copy() for name in _ROTATING[3:])
        self._arrays |= dict(zip(_ROLLING, rolling, strict=True))
        for name in (*of_walls, *_ROTATING, *_ROLLING, *_DRIVEN, *_BEFORE):
            setattr(self._grains, name, self._arrays[name].ctypes.data_as(_Doubles))
        if joints := bodies.joints:
            others, comes_first, ways = zip(*(one for own in joints for one in own), strict=True)
            lists = np.cumsum([0, *map(len, joints)]), np.array(others), np.array(comes_first)
            self._joints = [numbers.astype(np.intc) for numbers in lists]
            for name, own in zip(("jointStart", "joints", "jointFirst"), self._joints, strict=True):
                setattr(self._grains, name, own.ctypes.data_as(_Ints))
            self._arrays["jointWays"] = np.array(ways).ravel()
            self._grains.jointWays = self._arrays["jointWays"].ctypes.data_as(_Doubles)
        if len(images := bodies.image_ways):
            self._arrays["images"] = images.ravel()
            self._grains.images = self._arrays["images"].ctypes.data_as(_Doubles)
        self._grains.nWalls = self._walls = len(walls)
        self._grains.leapfrog, self._grains.round = scene.scheme == "leapfrog", bodies.is_round
        if state is not None:
            arrays, corrections = self._arrays, state.corrections
            self._grains.staggered, self._grains.steps = state.staggered, state.steps
            arrays["x"][:], arrays["y"][:] = state.position.T
            arrays["vx"][:], arrays["vy"][:] = state.velocity.T
            arrays["dvContacts"][pair_index(corrections.pair, n)] = corrections.pair_correction
            (grain, wall), carried = corrections.wall.T, corrections.wall_correction
            body = bodies.of_walls[wall]
            inside, own = body > 0, grain * self._walls + body - 1
            arrays["dvWalls"][own[inside]] = carried[inside]
            signed = bodies.sign(wall) * carried
            arrays["dvBoundary"][grain[~inside]] = signed[~inside]
            if state.spin is not None:
                arrays["w"][:], arrays["angle"][:] = state.spin, state.angle
            for letter, kind in (("t", "friction"), ("r", "rolling")):
                of_pairs, of_walls = (getattr(corrections, f"{of}_{kind}") for of in ("pair", "wall"))
                if of_pairs is not None and of_walls is not None:
                    arrays[f"d{letter}Contacts"][pair_index(corrections.pair, n)] = of_pairs
                    arrays[f"d{letter}Walls"][own[inside]] = of_walls[inside]
                    arrays[f"d{letter}Boundary"][grain[~inside]] = of_walls[~inside]

    def update(self) -> None:
        """Advance by one step, entirely in C."""
        scene = self._scene
        self._library.femGrainsUpdate(self._grains, scene.dt, scene.tolerance, scene.max_iterations)
        self._grains.restitutionSpeed = scene.restitution_speed

    def begin(self, order: IntArray | None = None) -> None:
        """Set the velocities without contacts, and apply the corrections of the last step (iteration 0).

        `order` is that of `step`.
        """
        scene, arrays = self._scene, self._arrays
        time = scene.time_after(self._grains.steps)
        for name, own in _BEFORE.items():
            arrays[name][:] = arrays[own]
        free = free_velocity(scene, self.velocity, bool(self._grains.staggered), time)
        arrays["vx"][:], arrays["vy"][:] = free.T
        arrays["u"][:] = scene.radius * free_spin(scene, self.spin, bool(self._grains.staggered))
        if self._grains.driven:
            self._library.femGrainsFreeSpeeds(self._grains, scene.dt)
        self._iterate(0, order)

    def step(self, order: IntArray | None = None) -> tuple[int, float]:
        """Advance by one step, with the iterations in a loop in Python.

        Returns the number of iterations and the last zeta [m/s]. `order` lists all contacts in the order of a
        sweep, shape (m, 2); by default it is that of the course text. A contact is a pair of grains (i, j),
        grain i at the annulus (i, -1), or grain i at wall k inside the annulus (i, -2 - k). With friction, an
        inner circle is not part of the annulus, but wall 0.
        """
        scene, arrays = self._scene, self._arrays
        self.begin(order)
        iterations, zeta = 0, np.inf
        while iterations < scene.max_iterations and zeta > scene.tolerance:
            iterations += 1
            zeta = self._iterate(iterations, order)
        arrays["x"] += scene.dt * arrays["vx"]
        arrays["y"] += scene.dt * arrays["vy"]
        arrays["w"][:] = arrays["u"] / scene.radius
        arrays["angle"] += scene.dt * arrays["w"]
        if self._grains.driven:
            arrays["places"] += scene.dt * arrays["speeds"]
            self._grains.radiusOut = arrays["places"][0]
        self._grains.staggered = self._grains.leapfrog
        self._grains.steps += 1
        self._grains.restitutionSpeed = scene.restitution_speed
        return iterations, zeta

    def _iterate(self, iteration: int, order: IntArray | None) -> float:
        arguments = (self._grains, self._scene.dt, iteration)
        if order is None:
            return self._library.femGrainsContactIterate(*arguments)
        return self._library.femGrainsContactIterateOrder(*arguments, len(order), order)

    @property
    def position(self) -> FloatArray:
        """Centers of the grains [m], shape (n, 2)."""
        return np.stack([self._arrays["x"], self._arrays["y"]], axis=1)

    @property
    def velocity(self) -> FloatArray:
        """Velocities of the grains [m/s], shape (n, 2)."""
        return np.stack([self._arrays["vx"], self._arrays["vy"]], axis=1)

    @property
    def spin(self) -> FloatArray:
        """Angular velocities [rad/s], shape (n,)."""
        return self._arrays["w"].copy()

    @property
    def angle(self) -> FloatArray:
        """Angles by which grains have turned [rad], shape (n,)."""
        return self._arrays["angle"].copy()

    @property
    def pair_correction(self) -> FloatArray:
        """Corrections dv_c of all pairs i < j in lexicographic order [m/s], shape (n (n - 1) / 2,)."""
        return self._arrays["dvContacts"]

    @property
    def wall_correction(self) -> FloatArray:
        """Corrections dv_b of all grains at the annulus [m/s], shape (n,).

        They are > 0 at the outer, and < 0 at the inner circle.
        """
        return self._arrays["dvBoundary"]

    @property
    def driven(self) -> FloatArray:
        """Coordinate [m] and speed [m/s] of every wall of the scene, shape (walls, 2), see `State.driven`."""
        return np.stack([self._arrays[name][self._of_walls] for name in ("places", "speeds")], axis=1)

    @property
    def pair_friction(self) -> FloatArray:
        """Tangential corrections of all pairs i < j in lexicographic order [m/s], shape (n (n - 1) / 2,)."""
        return self._arrays["dtContacts"]

    @property
    def pair_rolling(self) -> FloatArray:
        """Rolling corrections of all pairs i < j in lexicographic order [m/s], shape (n (n - 1) / 2,)."""
        return self._arrays["drContacts"]


def pair_index(pair: IntArray, n: int) -> IndexArray:
    """Return the indices of pairs i < j, shape (m, 2), among all pairs of n grains in lexicographic order."""
    i, j = pair.T.astype(np.int64)
    return i * (2 * n - i - 1) // 2 + (j - i - 1)


class CReference(NamedTuple):
    """The reference program, or the reason why it is unavailable."""

    start: Callable[[Scene, State], Reference] | None
    """Function that returns the reference for a scene in a state; None without a compiler."""
    status: str
    """Text for reports: the command that compiled the reference, or the reason why that failed."""


@cache
def find_c_reference() -> CReference:
    """Compile the reference for this machine, once in a process.

    If that fails, `start` of the result is None and `status` is the reason.
    """
    with tempfile.TemporaryDirectory() as folder:
        try:
            library = build(Path(folder), FAST)
        except RuntimeError as error:
            return CReference(None, f"not available ({error})")
    status = f"cc {' '.join(FAST)}, all pairs, for scenes of up to {MOST_GRAINS} grains"
    return CReference(partial(Reference, library), status)
