"""The common flow and plane shear in programs that Debian packages, run by Debian's own Python.

The script reads a line of JSON: the name of the program, its setting and the scene. Each further line is a
number of frames to advance, or of steps in a shear. The answer to each line is the CPU time so far [s] and,
in the flow, the centers [m]. In a shear, a sample takes the place of the centers: the mean force of the
grains on the lid and on the bottom in these steps [N], the height of the lid [m], the centers of the grains
[m], and their velocities along x [m/s].

Soft spheres, also in LAMMPS, are kept in the plane; LIGGGHTS uses the inertia of spheres. In the flow, linear
springs are critically damped, a contact lasts at least 20 steps, and the stiffness is chosen so that grains
that meet at 5 m/s overlap by `overlap` [radii].
"""

import ctypes
import json
import math
import os
import sys
from time import process_time

import numpy as np

FRAME = 0.01  # s
FASTEST = 5.0  # m/s
FACETS = 360  # of the outer wall in YADE
REBOUND = 0.1  # restitution of two mean discs in a shear
BELOW = 5.0  # part of the cell of YADE below the bottom [m]
REACH = 0.1  # gap [radii] up to which Siconos gets contacts, in addition to the path per step


def springs(scene, overlap):
    """Return the stiffness of a contact [N/m] and the number of steps per frame of 10 ms, in the flow.

    `overlap` is that of two grains which meet at 5 m/s [radii].
    """
    m = scene["mass"]
    k = 0.5 * m * (FASTEST / (overlap * scene["radius"])) ** 2
    return k, math.ceil(FRAME / (math.pi * math.sqrt(0.5 * m / k) / 20.0))


def contact(stiffness):
    """Return duration [s] and damping per reduced mass [1/s] of a contact of mean discs in a shear.

    `stiffness` is that of the contact [N/m].
    """
    omega, decay = math.sqrt(2.0 * stiffness), -math.log(REBOUND)
    return math.pi / omega, 2.0 * omega * decay / math.hypot(math.pi, decay)


class Yade:
    """The flow in YADE: spheres with viscoelastic contacts.

    The inner wall is a sphere, and the outer one is made of facets.
    """

    def __init__(self, scene, overlap):
        import yade
        from yade import utils

        self._omega, friction = yade.O, math.atan(scene["friction"])
        r, m, self._n = scene["radius"], scene["mass"], len(scene["position"])
        k, self._steps = springs(scene, overlap)
        c = math.sqrt(2.0 * k * m)
        with_wall = math.sqrt(2.0) * c

        def material(c):  # contacts have the values of both bodies in series
            values = {"kn": 2 * k, "ks": 4 / 7 * k, "cn": 2 * c, "cs": c}
            values |= {"frictionAngle": friction, "density": scene["density"]}
            return yade.O.materials.append(yade.ViscElMat(**values))

        grain, wall = material(c), material(0.5 / (1.0 / with_wall - 0.5 / c))
        for (x, y), v in zip(scene["position"], scene["velocity"], strict=True):
            body = utils.sphere((x, y, 0), r, material=grain)
            body.state.mass, body.state.inertia = m, yade.Vector3.Ones * (0.5 * m * r * r)
            body.state.vel, body.state.blockedDOFs = (*v, 0), "zXY" if friction else "zXYZ"
            yade.O.bodies.append(body)
        yade.O.bodies.append(utils.sphere((0, 0, 0), scene["radius_in"], material=wall, fixed=True))
        out, low, high = scene["radius_out"], 2 * r, 30 * r
        base = out * math.tan(math.pi / FACETS) * (high + low) / high
        for angle in 2 * np.pi * (np.arange(FACETS) + 0.5) / FACETS:
            normal = np.array([math.cos(angle), math.sin(angle)])
            along = np.array([-normal[1], normal[0]])
            foot = [(*(out * normal + sign * base * along), -low) for sign in (-1, 1)]
            yade.O.bodies.append(utils.facet([*foot, (*(out * normal), high)], material=wall, fixed=True))
        yade.O.engines = [
            yade.ForceResetter(),
            yade.InsertionSortCollider([yade.Bo1_Sphere_Aabb(), yade.Bo1_Facet_Aabb()], verletDist=-0.5),
            yade.InteractionLoop(
                [yade.Ig2_Sphere_Sphere_ScGeom(), yade.Ig2_Facet_Sphere_ScGeom()],
                [yade.Ip2_ViscElMat_ViscElMat_ViscElPhys()],
                [yade.Law2_ScGeom_ViscElPhys_Basic()],
            ),
            yade.LinearDragEngine(nu=scene["drag"] / (6 * math.pi * r), ids=list(range(self._n))),
            yade.NewtonIntegrator(damping=0, gravity=(*scene["gravity"], 0)),
        ]
        yade.O.dt = FRAME / self._steps

    def advance(self, frames):
        self._omega.run(frames * self._steps, True)

    def position(self):
        return [[*self._omega.bodies[i].state.pos][:2] for i in range(self._n)]


class OfLammps:
    """The flow in LAMMPS and LIGGGHTS: their common script, for grains in a plane between two cylinders."""

    height, units = 1, ""  # half height of the box [radii]; suffix of lengths in LIGGGHTS

    def start(self, scene, begin, contacts, grain, moves):
        """Run the script.

        The commands `begin`, `contacts`, `grain` (mass or density) and `moves` (walls and integration) are
        those of the program. The others follow from the scene.
        """
        x, z = 1.1 * scene["radius_out"], self.height * scene["radius"]
        lines = [
            "units si",
            "newton off",
            *begin,
            f"region box block {-x} {x} {-x} {x} {-z} {z}{self.units}",
            "create_box 1 box",
            f"neighbor {0.2 * scene['radius']} bin",
            *contacts,
            "pair_coeff * *",
            f"timestep {FRAME / self.steps}",
            *(f"create_atoms 1 single {x} {y} 0{self.units}" for x, y in scene["position"]),
            f"set group all diameter {2 * scene['radius']} {grain}",
            *(f"set atom {i} vx {u} vy {v}" for i, (u, v) in enumerate(scene["velocity"], 1) if u or v),
            f"fix fall all gravity {-scene['gravity'][1]} vector 0 -1 0",
            f"fix drag all viscous {scene['drag']}",
            *moves,
            "thermo 1000000000",
            "run 0",
        ]
        for line in lines:
            self.command(line)

    def advance(self, frames):
        self.command(f"run {frames * self.steps} pre no post no")


class InLiggghts:
    """A run of LIGGGHTS, through its library."""

    def __init__(self):
        os.environ |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
        ctypes.CDLL("libmpi.so.40", ctypes.RTLD_GLOBAL)
        self._library = library = ctypes.CDLL("libliggghts.so.3", ctypes.RTLD_GLOBAL)
        library.lammps_extract_fix.restype = ctypes.POINTER(ctypes.c_double)
        options = [b"liggghts", b"-log", b"none", b"-screen", b"none", b"-nocite"]
        self._run, given = ctypes.c_void_p(), (ctypes.c_char_p * len(options))(*options)
        library.lammps_open_no_mpi(len(options), given, ctypes.byref(self._run))

    def command(self, line):
        self._library.lammps_command(self._run, line.encode())

    def gather(self, name):
        """Return the quantity `name` of all atoms, such as "x", shape (n, 3)."""
        array = np.empty((self._library.lammps_get_natoms(self._run), 3))
        self._library.lammps_gather_atoms(self._run, name.encode(), 1, 3, array.ctypes)
        return array


def properties(numbers):
    """Return the LIGGGHTS commands that set contact parameters; `numbers` holds their values by name."""
    return [f"fix {name} all property/global {name} peratomtypepair 1 {v}" for name, v in numbers.items()]


class Liggghts(InLiggghts, OfLammps):
    """The flow in LIGGGHTS: soft spheres between cylinders (hooke/stiffness)."""

    height, units = 2, " units box"

    def __init__(self, scene, overlap):
        super().__init__()
        mu = scene["friction"]
        k, self.steps = springs(scene, overlap)
        gamma = 2.0 * math.sqrt(2.0 * k / scene["mass"])
        model = f"gran model hooke/stiffness tangential {'history' if mu else 'off'}"
        numbers = {"kn": k, "kt": 2 / 7 * k, "gamman": gamma, "gammat": 0.5 * gamma}
        numbers |= {"coefficientFriction": mu} if mu else {}
        wall = f"wall/{model} primitive type 1 zcylinder"
        begin = [
            "atom_style granular",
            "atom_modify map array",
            "boundary f f f",
            "communicate single vel yes",
            "processors 1 1 1",
        ]
        contacts = [
            "neigh_modify delay 0",
            "hard_particles yes",
            *properties(numbers),
            f"pair_style {model}",
        ]
        moves = [
            f"fix out all {wall} {scene['radius_out']} 0. 0.",
            f"fix in all {wall} {scene['radius_in']} 0. 0.",
            "fix move all nve/sphere",
            "thermo_modify lost ignore norm no",
        ]
        self.start(scene, begin, contacts, f"density {scene['density']}", moves)

    def position(self):
        return self.gather("x")[:, :2].tolist()


class ShearedOfLammps:
    """Plane shear in LAMMPS and LIGGGHTS: their common script. A force presses the lid, a row of discs."""

    units = ""  # suffix of lengths in LIGGGHTS

    def start(self, scene, dt, every, begin, contacts, moves):
        """Run the script.

        The commands `begin`, `contacts` and `moves` are those of the program. Forces on the walls are
        averaged over `every` steps; if it is 0, they are not measured.
        """
        length, height, rate, n = (scene[key] for key in ("length", "height", "rate", "n"))
        position, radius = scene["position"], scene["radius"]
        row = (len(radius) - n) // 2
        velocity = [rate * y for _, y in position[:n]] + row * [0.0] + row * [rate * height]
        discs = enumerate(zip(position, radius, velocity, strict=True), 1)
        lines = [
            "newton off",
            "atom_modify map array",
            *begin,
            f"region box block 0 {length} -2 {height + 20} -1 1{self.units}",
            "create_box 1 box",
            "neighbor 0.15 bin",
            "neigh_modify delay 0",
            *contacts,
            "pair_coeff * *",
            f"timestep {dt}",
            *(f"create_atoms 1 single {x} {y} 0{self.units}" for x, y in position),
            *(
                f"set atom {i} diameter {2 * r} density {3 / (math.pi * r)} vx {vx}"  # a mass of 4 r^2
                for i, (_, r, vx) in discs
            ),
            f"group grains id <= {n}",
            f"group bottom id <> {n + 1} {n + row}",
            f"group top id > {n + row}",
            "neigh_modify exclude group bottom bottom",
            "neigh_modify exclude group top top",
            *moves,
            "fix lid top nve",
            "fix along top setforce 0.0 NULL NULL",
            f"fix press top aveforce NULL {-length / row} NULL",
            "thermo 1000000000",
        ]
        if every:
            lines += [f"compute {c} bottom reduce sum f{c}" for c in "xy"]
            lines += [f"fix mean all ave/time 1 {every} {every} f_along[1] f_press[2] c_x c_y"]
        for line in [*lines, "run 0"]:
            self.command(line)
        self._n, self._lid, self._forces = n, n + row, 4 if every else 0

    def advance(self, steps):
        self.command(f"run {steps} post no")

    def sample(self):
        x, velocity = self.gather("x"), self.gather("v")
        forces = [self.mean(k) for k in range(self._forces)]
        return forces, x[self._lid, 1], x[: self._n, :2].tolist(), velocity[: self._n, 0].tolist()


class ShearedLiggghts(InLiggghts, ShearedOfLammps):
    """Plane shear in LIGGGHTS: soft spheres (hooke/stiffness)."""

    units = " units box"

    def __init__(self, scene, stiffness, dt, every):
        super().__init__()
        _, gamma = contact(stiffness)
        numbers = {"kn": stiffness, "kt": 0.5 * stiffness, "gamman": gamma, "gammat": 0.5 * gamma}
        begin = [
            "units si",
            "atom_style granular",
            "boundary p f f",
            "communicate single vel yes",
            "processors 1 1 1",
        ]
        contacts = [
            "soft_particles yes",
            *properties(numbers | {"coefficientFriction": scene["friction"]}),
            "pair_style gran model hooke/stiffness tangential history limitForce on",
        ]
        moves = ["fix move grains nve/sphere", "thermo_modify norm no"]
        self.start(scene, dt, every, begin, contacts, moves)

    def mean(self, k):
        return self._library.lammps_extract_fix(self._run, b"mean", 0, 1, k, 0)[0]


class ShearedYade:
    """Plane shear in YADE: spheres with viscoelastic contacts. The lid is a clump that a force drives."""

    def __init__(self, scene, stiffness, dt, every):
        import yade
        from yade import utils

        self._omega, self._utils, self._every, self._force = yade.O, utils, every, np.zeros(4)
        length, height, rate, n = (scene[key] for key in ("length", "height", "rate", "n"))
        _, gamma = contact(stiffness)
        values = {"kn": 2 * stiffness, "ks": stiffness, "cn": gamma, "cs": 0.5 * gamma}  # as in Yade
        material = yade.ViscElMat(**values, frictionAngle=math.atan(scene["friction"]), density=1)
        yade.O.materials.append(material)
        yade.O.periodic = True
        yade.O.cell.hSize = yade.Matrix3(length, 0, 0, 0, 3 * height, 0, 0, 0, 6)
        discs = [
            utils.sphere((x, y + BELOW, 0), r, material=material)
            for (x, y), r in zip(scene["position"], scene["radius"], strict=True)
        ]
        for body, (_, y), r in zip(discs[:n], scene["position"], scene["radius"], strict=False):
            body.state.mass, body.state.inertia = 4 * r**2, yade.Vector3.Ones * (2 * r**4)
            body.state.vel, body.state.blockedDOFs = (rate * y, 0, 0), "zXY"
        lid = len(discs) - (len(discs) - n) // 2
        for body in discs[n:]:
            body.mask = 3  # the second bit: walls do not touch each other
        for body in discs[n:lid]:
            body.dynamic = False
        yade.O.bodies.append(discs[:lid])
        clump, self._top = yade.O.bodies.appendClumped(discs[lid:])
        self._n, self._bottom = n, list(range(n, lid))
        state = yade.O.bodies[clump].state
        state.mass, state.blockedDOFs, state.vel = len(self._top), "xzXYZ", (rate * height, 0, 0)
        yade.O.forces.setPermF(clump, (0, -length, 0))
        yade.O.engines = [
            yade.ForceResetter(),
            yade.InsertionSortCollider(
                [yade.Bo1_Sphere_Aabb()], verletDist=0.075, avoidSelfInteractionMask=2
            ),
            yade.InteractionLoop(
                [yade.Ig2_Sphere_Sphere_ScGeom()],
                [yade.Ip2_ViscElMat_ViscElMat_ViscElPhys()],
                [yade.Law2_ScGeom_ViscElPhys_Basic()],
            ),
            yade.NewtonIntegrator(damping=0, gravity=(0, 0, 0)),
        ]
        yade.O.dt = dt

    def advance(self, steps):
        if not self._every:
            self._omega.run(steps, True)
            return
        self._force = np.zeros(4)
        for _ in range(steps):
            self._omega.step()
            self._force += [
                self._utils.sumForces(wall, along)
                for wall in (self._top, self._bottom)
                for along in ((1, 0, 0), (0, 1, 0))
            ]
        self._force /= steps

    def sample(self):
        states = [self._omega.bodies[i].state for i in range(self._n)]
        top = self._omega.bodies[self._top[0]].state.pos[1] - BELOW
        centers = [(one.pos[0], one.pos[1] - BELOW) for one in states]
        return self._force.tolist(), top, centers, [one.vel[0] for one in states]


class Siconos:
    """The flow in Siconos: discs by Moreau and Jean's scheme and nonsmooth Gauss-Seidel (NSGS).

    Lengths are in radii. The search of Siconos never removes contacts, so a k-d tree finds them; its time is
    not counted. For each grain near the outer wall, a tangent plane replaces the wall. It is renewed when the
    grain has moved by 0.01 rad.
    """

    def __init__(self, scene, dt, tolerance):
        import siconos.kernel as kernel
        import siconos.numerics as numerics
        from scipy.spatial import cKDTree
        from siconos.mechanics.collision.bodies import Disk, DiskDiskR, DiskPlanR

        self._kernel, self._tree, self._between, self._with_plane = kernel, cKDTree, DiskDiskR, DiskPlanR
        self._scene, self._dt, self._unit = scene, dt, 1.0 / scene["radius"]
        self._inner, self._outer = (self._unit * scene[wall] for wall in ("radius_in", "radius_out"))
        self._system = system = kernel.NonSmoothDynamicalSystem(0.0, 1e9)
        self._bodies = []
        for x, v in zip(scene["position"], scene["velocity"], strict=True):
            centre, speed = ([self._unit * a for a in values] for values in (x, v))
            body = Disk(1.0, scene["mass"], [*centre, 0.0], [*speed, 0.0])
            body.setFExtPtr([0.0, 0.0, 0.0])
            system.insertDynamicalSystem(body)
            self._bodies.append(body)
        self._hub = Disk(self._inner, 1e12, [0.0] * 3, [0.0] * 3)
        system.insertDynamicalSystem(self._hub)
        solver = kernel.FrictionContact(2, numerics.SICONOS_FRICTION_2D_NSGS)
        options = solver.numericsSolverOptions()
        options.iparam[0], options.dparam[0] = 1000, tolerance
        solver.setMaxSize(100_000)
        solver.setMStorageType(1)
        solver.setNumericsVerboseMode(False)
        solver.setKeepLambdaAndYState(True)
        times = kernel.TimeDiscretisation(0.0, dt)
        self._stepping = kernel.TimeStepping(system, times, kernel.MoreauJeanOSI(0.5), solver)
        self._law = kernel.NewtonImpactFrictionNSL(0.0, 0.0, scene["friction"], 2)
        self._found, self._tangent, self.left_out = {}, {}, 0.0

    def advance(self, frames):
        gravity = self._scene["mass"] * self._unit * np.array(self._scene["gravity"])
        for _ in range(frames * round(FRAME / self._dt)):
            start = process_time()
            velocity = np.array([body.velocity() for body in self._bodies])[:, :2]
            for body, force in zip(self._bodies, gravity - self._scene["drag"] * velocity, strict=True):
                body.setFExtPtr([*force, 0.0])
            self._search(self.centers(), velocity)
            self.left_out += process_time() - start
            self._stepping.computeOneStep()
            self._stepping.nextStep()

    def _search(self, x, velocity):
        reach = REACH + 1.2 * self._dt * np.hypot(*velocity.T).max()
        rho = np.hypot(*x.T)
        normal, n = -x / rho[:, np.newaxis], len(x)
        rim = {int(i) for i in np.flatnonzero(rho > self._outer - 1.0 - reach)}

        def near(gap):
            pairs = {tuple(sorted(pair)) for pair in self._tree(x).query_pairs(2.0 + gap)}
            return pairs | {(int(i), n) for i in np.flatnonzero(rho < self._inner + 1.0 + gap)}

        kept = near(reach + 0.5)
        for i, j in list(self._found):
            turned = j < 0 and (i not in rim or normal[i] @ self._tangent[i] < math.cos(0.01))
            if turned or (j >= 0 and (i, j) not in kept):
                self._system.removeInteraction(self._found.pop((i, j)))
        for i, j in near(reach) - self._found.keys():
            other, radius = (self._hub, self._inner) if j == n else (self._bodies[j], 1.0)
            self._link((i, j), self._between(1.0, radius), other)
        for i in rim:
            if (i, -1) not in self._found:
                self._tangent[i] = u, v = normal[i]
                plane = self._with_plane(1.0, u, v, self._outer, -u * self._outer, -v * self._outer, 8.0)
                self._link((i, -1), plane)

    def _link(self, key, relation, *other):
        contact = self._found[key] = self._kernel.Interaction(self._law, relation)
        self._system.link(contact, self._bodies[key[0]], *other)

    def centers(self):
        return np.array([body.q() for body in self._bodies])[:, :2]

    def position(self):
        return (self.centers() / self._unit).tolist()


PROGRAMS = {
    "yade": Yade,
    "liggghts": Liggghts,
    "siconos": Siconos,
    "yade, sheared": ShearedYade,
    "liggghts, sheared": ShearedLiggghts,
}


def main():
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of programs goes to standard error
    name, setting, scene = json.loads(sys.stdin.readline())
    program, taken = PROGRAMS[name](scene, **setting), 0.0
    sample = getattr(program, "sample", None) or program.position
    for line in sys.stdin:
        start = process_time()
        program.advance(int(line))
        taken += process_time() - start
        answer = taken - getattr(program, "left_out", 0.0), sample()
        print(json.dumps(answer), file=answers, flush=True)
    os._exit(0)


if __name__ == "__main__":
    main()
