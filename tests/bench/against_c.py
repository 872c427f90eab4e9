"""Times of a sweep, of steps and of the course's scene, compared with C that is built for this machine.

Both programs must give the same bits.
"""

import argparse
import ctypes
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np
import warp as wp

from warpgrains import Scene, Simulation, State
from warpgrains.kernels.record import Phase
from warpgrains.kernels.step import METHODS
from warpgrains.kernels.team.threads import team_records
from warpgrains.reference.reference import DEFINES, SOURCE, Reference
from warpgrains.solver.sizes import kind_of

from ..support.same_bits import assert_same_bits
from ..support.stages import kernel_of
from .flow import ITERATIONS, SPLASHING, continued, flowing, settled_pile
from .rows import SPEEDUP, Row, Subject, in_turn, row, seconds

FLAGS = ("-O3", "-march=native", "-ffp-contract=off")
COMPILER = "gcc -O3"
SWEPT, SWEEPS = 10_000, 200  # grains, and sweeps that are timed together
FASTER_AT_REST = {100: ">= 25", 1_000: ">= 250", 5_000: ">= 1000"}
FASTER_IN_FLOW = {1_000: ">= 400"}
COURSE_STEPS = 800
VEC = ("<f8", (2,))
CONTACT = np.dtype([("n", *VEC), ("gap_rate", "<f8"), ("i", "<u4"), ("j", "<u4")], align=True)
"""Memory layout of a contact, as in_c.c expects it."""


def compiled(compiler: str, flags: Sequence[str], sources: Sequence[Path]) -> ctypes.CDLL:
    """Compile C sources for this machine to one library, and return the loaded library.

    `flags` are options in addition to `FLAGS`.
    """
    with tempfile.TemporaryDirectory() as folder:
        built = f"{folder}/built.so"
        subprocess.run(
            [compiler, *FLAGS, *flags, "-shared", "-fPIC", *sources, "-o", built, "-lm"], check=True
        )
        return ctypes.CDLL(built)


@cache
def library() -> ctypes.CDLL:
    loaded = compiled("gcc", [f"-I{SOURCE.parent}", *DEFINES], [SOURCE, Path(__file__).with_name("in_c.c")])
    loaded.sweeps.restype = ctypes.c_double
    return loaded


class CReference(Reference):
    def __init__(self, scene: Scene, state: State | None = None):
        super().__init__(library(), scene, state)

    def run(self, steps: int) -> None:
        numbers = self._scene.dt, self._scene.tolerance, self._scene.max_iterations
        self._library.run(ctypes.byref(self._grains), steps, *map(ctypes.c_double, numbers))


class Sweeps:
    """The contact iteration alone: `SWEEPS` plain sweeps over the arrays of a simulation's last step.

    `run` does them by the kernels of the simulation, and `run_in_c` in C.
    """

    def __init__(self, simulation: Simulation):
        records = simulation._engine.records
        self._numbers, array = records.host[0], partial(records.array, 0)
        count = self._numbers["contacts"]["count"]
        self.pairs, self.walls = int(count["pairs"]), int(count["walls"])
        self.contact, self.dv = array("contacts.contact"), array("contacts.dv.now")
        self.velocity = array("grains.next_velocity")
        if self.contact.dtype != CONTACT:
            raise RuntimeError(f"in_c.c knows records {CONTACT}, and the solver has {self.contact.dtype}")
        self._start = self.contents()
        inputs = (records.device, team_records(1)[0])
        kernel = kernel_of(*METHODS[simulation.scene.method](kind_of(simulation.scene)))
        self.run = wp.launch(kernel, dim=1, inputs=inputs, device="cpu", record_cmd=True).launch

    def contents(self) -> tuple[np.ndarray, ...]:
        return self.dv.copy(), self.velocity.copy()

    def reset(self) -> None:
        """Restore the arrays from which the sweeps start, and turn off the monitoring of contacts."""
        self.dv[:], self.velocity[:] = self._start
        self._numbers["tuning"]["monitor_threshold"] = np.inf
        self._numbers["control"]["phase"] = Phase.SWEEP
        self._numbers["control"]["may_stop"] = 0
        self._numbers["step"]["iterations"] = self._numbers["step"]["measured"] = 0
        self._numbers["verlet"]["list_expired"] = 0

    def run_in_c(self) -> float:
        """Do the same sweeps in C; return the last zeta [m/s]."""
        arrays = (array.ctypes for array in (self.contact, self.dv, self.velocity))
        return library().sweeps(SWEEPS, self.pairs, self.walls, *arrays)

    def compare(self) -> None:
        self.reset()
        zeta, expected = self.run_in_c(), self.contents()
        self.reset()
        self.run()
        assert (self._numbers["step"]["iterations"], self._numbers["step"]["zeta"]) == (SWEEPS, zeta)
        assert all(map(np.array_equal, self.contents(), expected))


def sweeps(options: argparse.Namespace) -> Iterator[Row]:
    """Yield a row for each order of contacts: the time of a sweep, here and in C, on the same arrays."""
    for n in options.grains or [SWEPT]:
        kind, *pile = settled_pile(n, options.cache)
        for order, target in (("sequential", "<= 1.1"), ("color", "")):
            arrays = Sweeps(continued(*pile, order=order, max_iterations=SWEEPS))
            arrays.compare()

            def us_a_sweep(run: Callable[[], object], arrays: Sweeps = arrays) -> float:
                arrays.reset()
                return seconds(run) / SWEEPS * 1e6

            ways = partial(us_a_sweep, arrays.run), partial(us_a_sweep, arrays.run_in_c)
            ours, in_c = in_turn(options.repeats, *ways)
            subject = Subject(f"one iteration, {kind}", n, order)
            yield row(subject, ours, "us", f"same arrays, {COMPILER}", in_c, target=target)


def steps(options: argparse.Namespace) -> Iterator[Row]:
    """Yield rows for piles and flows: the time of a step, here and in C, which visits all pairs."""
    for n in options.grains or FASTER_AT_REST:
        kind, *pile = settled_pile(n, options.cache)
        count, target = max(2, 4_000 // n), FASTER_AT_REST.get(n, "")
        yield _against_all_pairs(kind, continued(*pile), count, target, options)
    for n in options.grains or FASTER_IN_FLOW:
        scene = flowing(n, tolerance=1e-12, max_iterations=ITERATIONS)
        flow = Simulation(scene, threads=1)
        flow.advance(round(SPLASHING / scene.dt))
        yield _against_all_pairs("flowing", flow, 5, FASTER_IN_FLOW.get(n, ""), options)


def _against_all_pairs(
    kind: str, simulation: Simulation, count: int, target: str, options: argparse.Namespace
) -> Row:
    reference = CReference(simulation.scene, simulation.state())

    def ours() -> None:
        for _ in range(count):
            simulation.step()

    times = in_turn(
        options.repeats,
        lambda: seconds(ours) / count * 1e3,
        lambda: seconds(partial(reference.run, count)) / count * 1e3,
    )
    assert_same_bits(simulation, reference)
    subject = Subject(f"one step of {ITERATIONS} iterations, {kind}", simulation.scene.n)
    return row(subject, times[0], "ms", f"all pairs, {COMPILER}", times[1], SPEEDUP, target)


def course(options: argparse.Namespace) -> Iterator[Row]:
    scene = Scene.load("annulus")
    simulation = Simulation(scene)
    start = simulation.state()
    references: list[CReference] = []

    def ours() -> float:
        simulation.restore(start)
        return seconds(partial(simulation.run, COURSE_STEPS)) * 1e3

    def in_c() -> float:
        references.append(CReference(scene))
        return seconds(partial(references[-1].run, COURSE_STEPS)) * 1e3

    ours()  # first call captures the launches
    times = in_turn(options.repeats, ours, in_c)
    assert_same_bits(simulation, references[-1])
    subject = Subject(f"the course's scene, {COURSE_STEPS} steps", scene.n)
    yield row(subject, times[0], "ms", f"all pairs, {COMPILER}", times[1], SPEEDUP, ">= 1.5")
