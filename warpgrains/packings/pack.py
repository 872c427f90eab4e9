"""Packings at rest under gravity."""

from dataclasses import dataclass, field
from math import hypot
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from warpgrains.analysis.energy import contact_forces
from warpgrains.analysis.snapshot import snapshot
from warpgrains.base import checks
from warpgrains.base.console import progress_bar
from warpgrains.base.described import fields_in_help
from warpgrains.base.errors import InputError, SimulationError
from warpgrains.base.files import require_writable_path, suffix_of, table_text, write_atomically
from warpgrains.base.shown import Shown, number_of
from warpgrains.packings.compress import carrying_contacts
from warpgrains.packings.settling import TESTED, Settling
from warpgrains.scene.energy import kinetic_energy
from warpgrains.scene.scene import Scene, SceneLike, as_scene
from warpgrains.scene.sources import require_closed
from warpgrains.scene.state import State
from warpgrains.simulation.simulation import Simulation
from warpgrains.solver.exact.solver import exact_solver
from warpgrains.space.geometry import distance

MOST_TESTS = 3  # number of tests of rest; after a failed test, grains settle again


@fields_in_help
@dataclass(frozen=True, repr=False)
class Settled(Shown):
    """Result of `pack`: a packing at rest.

    Examples
    --------
    >>> rest = wg.pack("polydisperse")
    >>> rest.energy < 1e-9, rest.simulation.steps
    (True, 0)
    """

    simulation: Simulation = field(repr=False)
    """The packing before its first step, with the settings of the scene. It can be run, saved and drawn."""
    energy: float
    """Mean kinetic energy of a grain, in m g d with the mean diameter d.

    It is the largest value after a step with the settings of the scene.
    """
    largest_force: float
    """Largest net force on a grain, its weight included, in weights of the grain."""
    rms_force: float
    """Root mean square of the net forces on grains, in weights of the grain."""
    contacts: float
    """Contacts per grain without rattlers, as in `Packing`: about 4, if balance determines all forces."""
    rattlers: int
    """Grains that carry no loads, see `analysis.rattlers`."""
    overlap: float
    """Largest overlap [m]."""
    steps: int
    """Number of steps done, including those of the tests of rest."""
    iterations: int
    """Number of iterations of all steps."""
    seconds: float
    """Wall time [s]."""

    def results(self) -> dict[str, Any]:
        """Return the numbers by name, as ``warpgrains pack --json`` prints them."""
        return {key: value for key, value in vars(self).items() if key != "simulation"}

    def summary(self) -> dict[str, str]:
        """Return the lines that describe the packing, by name."""
        scene = self.simulation.scene
        return {
            "scene": f"{scene.name}, {number_of(scene.n, 'grain')}",
            "steps": f"{self.steps}, at rest",
            "iterations": f"{self.iterations}",
            "kinetic energy": f"{self.energy:.1e} m g d a grain",
            "net forces": f"{self.rms_force:.1e} weights, largest {self.largest_force:.1e}",
            "contacts": f"{self.contacts:.3f} a grain, without {self.rattlers} rattlers",
            "worst overlap": f"{self.overlap:.2e} m",
        }

    def save(self, path: str | Path) -> None:
        """Save the packing atomically.

        Parameters
        ----------
        path : str or Path
            A checkpoint, ``.npz``, which `Simulation.load` and ``warpgrains run --resume`` read; or a table
            of the grains, ``.csv``, for ``file`` in the section ``[grains]`` of a scene.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        path = Path(checks.path("path", path))
        require_writable_path("packing", path, ".npz", ".csv")
        if suffix_of(path) == ".npz":
            self.simulation.save(path)
            return
        scene = self.simulation.scene
        table = np.column_stack([scene.position, scene.radius, scene.mass]).tolist()
        rows = [dict(zip(("x", "y", "radius", "mass"), row, strict=True)) for row in table]
        write_atomically(path, table_text(rows).encode())


def pack(scene: SceneLike, steps: int = 2000, progress: bool = False, threads: int | None = None) -> Settled:
    """Let grains settle under gravity, strongly damped, until their forces balance.

    Parameters
    ----------
    scene : Scene, path or str
        Grains without friction, among walls at rest. The denser they begin, the sooner they rest.
    steps : int
        Largest number of steps.
    progress : bool
        Whether to show a progress bar on standard error.
    threads : int, optional
        See `Simulation`. The packing does not depend on it.

    Returns
    -------
    Settled
        The packing. With the settings of the scene, the mean kinetic energy of a grain is at most 1e-9 m g d,
        or that at a speed of 30 tolerances if it is larger, after each of the first 10 steps.

    Raises
    ------
    InputError
        The scene has no constant gravity, or one along which it is periodic, or friction, or walls that move;
        or an argument is invalid; or the extra ``[exact]`` is not installed.
    SimulationError
        The grains are not at rest after `steps` steps, or not with the settings of the scene.

    Examples
    --------
    >>> rest = wg.pack("polydisperse")
    >>> f"{rest.contacts:.1f} contacts a grain", rest.rms_force < 1e-3
    ('4.0 contacts a grain', True)
    """
    start, scene = perf_counter(), as_scene("scene", scene)
    steps = checks.whole_number("steps", steps)
    require_closed(scene, "pack")
    _require_rest_is_possible(scene)
    with progress_bar(steps, shown=progress) as bar:
        settling = Settling(scene, steps, threads, bar)
        tests: list[_Test] = []
        while not (tests and tests[-1].energy <= settling.most_energy):
            if len(tests) == MOST_TESTS:
                raise SimulationError(
                    f"with the settings of the scene, grains have a kinetic energy of {tests[-1].energy:.1e}"
                    f" m g d, above {settling.most_energy:.1e}: reduce solver.tolerance, {scene.tolerance:g}"
                    " m/s, or raise solver.max_iterations"
                )
            settling.settle()
            tests.append(_test(scene, settling, threads))
    test = tests[-1]
    now = snapshot(test.simulation)
    weight = scene.mass[:, np.newaxis] * np.array(scene.gravity)
    net = distance(weight + contact_forces(now)) / (scene.mass * settling.gravity)
    contacts, rattlers = carrying_contacts(now)
    test.simulation.restore(test.start)
    return Settled(
        simulation=test.simulation,
        energy=test.energy,
        largest_force=float(net.max()),
        rms_force=float(np.sqrt((net**2).mean())),
        contacts=contacts,
        rattlers=rattlers,
        overlap=test.overlap,
        steps=settling.steps + len(tests) * TESTED,
        iterations=settling.iterations + sum(test.iterations for test in tests),
        seconds=perf_counter() - start,
    )


class _Test(NamedTuple):
    """Result of a test of rest: `TESTED` steps from the state `start`, with the settings of the scene."""

    start: State
    simulation: Simulation
    """The simulation after the steps."""
    energy: float
    """Mean kinetic energy of a grain, in m g d with the mean diameter d; the largest value after a step."""
    overlap: float
    """Largest overlap [m]."""
    iterations: int


def _test(scene: Scene, settling: Settling, threads: int | None) -> _Test:
    """Test for rest: do `TESTED` steps of the settled grains with the settings of the scene."""
    start = settling.state()
    settled = scene.replace(position=start.position, velocity=start.velocity)
    simulation = Simulation(settled, threads=threads, state=start)
    energy, overlap, iterations = 0.0, 0.0, 0
    for _ in range(TESTED):
        report = simulation.step()
        kinetic = float(kinetic_energy(scene.mass, scene.radius, simulation.velocity, 0.0))
        energy = max(energy, kinetic / (float(scene.mass.sum()) * settling.gravity * settling.diameter))
        overlap, iterations = max(overlap, report.overlap), iterations + report.iterations
    return _Test(start, simulation, energy, overlap, iterations)


def _require_rest_is_possible(scene: Scene) -> None:
    """Raise InputError without constant gravity, or with periods along it, friction or walls that move."""
    if hypot(*scene.gravity) == 0.0 or scene.gravity_rate:
        raise InputError("gravity is 0 or turns: pack needs a constant one; compress needs none")
    if scene.period.repeats[np.array(scene.gravity) != 0.0].any():
        raise InputError(
            f"gravity is {tuple(scene.gravity)} and the domain a {scene.boundary}: grains fall without end"
        )
    if scene.has_friction:
        raise InputError("friction is given: pack takes grains without friction; use run --until rest")
    if scene.has_moving_walls or scene.has_driven_walls:
        raise InputError("a wall moves, or a force drives it: pack takes walls at rest; use run --until rest")
    exact_solver("exact")  # raises InputError now if the extra is missing, and not after minutes
