"""Players, which the page shows: of a simulation, or of the frames of a recording. And their clock."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from time import perf_counter, sleep
from typing import TYPE_CHECKING, TypeAlias, Unpack

import numpy as np

from warpgrains.analysis.snapshot import snapshot_of
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import SimulationError
from warpgrains.drawing.colorings import colorings_of
from warpgrains.drawing.colors import CATEGORIES
from warpgrains.drawing.looks import Look
from warpgrains.drawing.painter import Painter
from warpgrains.scene.energy import kinetic_energy
from warpgrains.scene.fields import SceneChanges
from warpgrains.scene.scene import Scene
from warpgrains.scene.snapshot import Snapshot
from warpgrains.scene.state import first_state
from warpgrains.usd.recording import Recording, painter_of

if TYPE_CHECKING:
    from warpgrains.simulation.simulation import Simulation
    from warpgrains.solver.statistics import StepReport
    from warpgrains.view.homework import Homework

PLACEHOLDER = "\N{EN DASH}"
"""Text for a number that does not exist yet, so that the table has all its rows from the start."""
ZETA, ENERGY = "zeta of the last step", "kinetic energy"
AXES = {ZETA: ("iteration", "log10 of zeta [m/s]"), ENERGY: ("time [s]", "energy [J]")}
"""Labels of the horizontal and the vertical axis, by the title of the chart."""
Curves: TypeAlias = dict[str, tuple[FloatArray, dict[str, FloatArray]]]
"""For each chart, by its title: the values of the horizontal axis, and its curves by name."""

FRAMES = 30.0  # a second, at most
_ROUNDING = 1e-6  # steps
_REMEMBERED = 500  # steps in the curve of energy
LEAST = 1e-16  # smallest zeta that is plotted [m/s]


class Pace:
    """Clock of frames at a constant rate, which converts the time between frames to steps of `dt` [s]."""

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self.restart()

    def restart(self) -> None:
        """Start with a frame now, and no steps to make up for."""
        self._owed, self._next = 0.0, perf_counter()

    def due(self, speed: float) -> int:
        """Return the number of steps to do before the next frame, which may be 0.

        `speed` is the simulated time per wall time. A remaining fraction of a step is kept for the next call.
        """
        self._owed += speed / FRAMES / self._dt
        steps = int(self._owed + _ROUNDING)
        self._owed -= steps
        return steps

    def wait(self) -> None:
        """Wait until the next frame.

        A delay is not made up for, so that a slow player does not hurry later.
        """
        self._next = max(self._next + 1.0 / FRAMES, perf_counter())
        sleep(max(0.0, self._next - perf_counter()))


class Live:
    """Player of a simulation. Each state is bit-identical to that of `Simulation.run` after as many steps."""

    has_chains = True

    def __init__(self, simulation: Simulation) -> None:
        self._simulation, self._first = simulation, simulation.scene
        self.name, self.dt = simulation.scene.name, simulation.scene.dt
        self.set_style(Look.color_by, forces=False)
        self._forget()

    def _forget(self) -> None:
        self._report: StepReport | None = None
        self._past: deque[tuple[float, float]] = deque(maxlen=_REMEMBERED)
        self.error: str | None = None

    @property
    def scene(self) -> Scene:
        return self._simulation.scene

    @property
    def colorings(self) -> tuple[str, ...]:
        return *CATEGORIES, *colorings_of(self.scene)

    @property
    def steps(self) -> int:
        return self._simulation.steps

    @property
    def has_ended(self) -> bool:
        """True if a step has failed."""
        return self.error is not None

    def advance(self, steps: int) -> None:
        try:
            if steps > 1:
                self._simulation.advance(steps - 1)
            self._report = self._simulation.step(history=True)
        except SimulationError as error:
            self.error = str(error)
            return
        self._past.append((self._simulation.time, self._energy()))

    def restart(self) -> None:
        """Return to the start, in the scene with all changes that were made on the page."""
        scene, now = self._simulation.scene, self._simulation.state()
        state = replace(first_state(scene), id=now.id, born=now.born)
        if scene.has_friction and np.array_equal(scene.position, self._first.position):
            # the scene may have lost its spins meanwhile
            state = replace(state, spin=self._first.spin)
        self._simulation.restore(state)
        self._forget()

    def change(self, **fields: Unpack[SceneChanges]) -> None:
        self._simulation.change(**fields)

    def set_friction(self, out: float, inside: float, friction: float, rolling: float = 0.0) -> None:
        """Change the friction of the scene and the rotation of its circles.

        `out` and `inside` are the angular velocities of the outer and the inner circle [rad/s]; without
        friction at walls, they become 0. `friction` and `rolling` are coefficients. If neither grains nor
        walls have friction, rolling friction and spin drag become 0.
        """
        first = self._first
        at_walls = friction if first.wall_friction is None else first.wall_friction
        rotates = friction > 0.0 or at_walls > 0.0 or any(wall.friction for wall in first.walls)
        self.change(
            friction=friction,
            rolling_friction=rolling if rotates else 0.0,
            wall_rolling_friction=first.wall_rolling_friction if rotates else None,
            angular_velocity_out=out if at_walls > 0.0 else 0.0,
            angular_velocity_in=inside if at_walls > 0.0 else 0.0,
            spin_drag=first.spin_drag if rotates else 0.0,
        )

    def set_restitution(self, restitution: float) -> None:
        """Change the restitution. If no contact bounces then, `restitution_speed` becomes 0."""
        first = self._first
        bounces = restitution or first.wall_restitution or any(wall.restitution for wall in first.walls)
        self.change(restitution=restitution, restitution_speed=first.restitution_speed if bounces else 0.0)

    def set_style(self, color_by: str, forces: bool) -> None:
        self.painter = Painter(self._simulation.scene, Look(color_by=color_by, forces=forces))

    def snapshot(self) -> Snapshot:
        is_other = self.painter.scene.position is not self.scene.position  # grains were added or removed
        if is_other and not self.scene.exchanges_grains:
            self.painter = Painter(self.scene, self.painter.look)
        return snapshot_of(self._simulation, has_contacts=self.painter.needs_contacts)

    def _energy(self) -> float:
        scene, now = self.scene, self._simulation
        return float(kinetic_energy(scene.mass, scene.radius, now.velocity, now.spin))

    def readout(self) -> dict[str, str]:
        """Return the rows of the page's table: numbers of the present state and the last step, by name."""
        rows = {"time": f"{self._simulation.time:.4g} s", "steps": f"{self.steps}"}
        rows |= dict.fromkeys(("iterations", "zeta", "residual", "contacts", "converged"), PLACEHOLDER)
        report = self._report
        if report is not None:
            rows |= {
                "iterations": f"{report.iterations}",
                "zeta": f"{report.zeta:.2e} m/s",
                "residual": f"{report.residual:.2e} m/s",
                "contacts": f"{report.contacts}",
                "converged": "yes" if report.converged else "no",
            }
        rows["kinetic energy"] = f"{self._energy():.4g} J"
        rows["drag"] = f"{self.scene.drag:.4g} kg/s"
        rows["friction"] = f"{self.scene.friction:.4g}"
        if self.scene.bodies.outer is not None:
            walls = (self.scene.angular_velocity_out, self.scene.angular_velocity_in)
            rows["rotation of the walls"] = f"{walls[0]:.4g}, {walls[1]:.4g} rad/s"
        return rows | ({"error": self.error} if self.error else {})

    def curves(self) -> Curves:
        """Return log10 of zeta over the iterations of the last step, and the kinetic energy over time."""
        time, energy = np.array(self._past).reshape(-1, 2).T
        history = self._report.history if self._report is not None else None
        zeta = np.zeros(0) if history is None else np.log10(np.maximum(history.zeta, LEAST))
        return {ZETA: (np.arange(1.0, len(zeta) + 1), {"zeta": zeta}), ENERGY: (time, {"energy": energy})}


class Replay:
    """Player of a recording. A step is a frame."""

    def __init__(self, recording: Recording) -> None:
        self._recording, self.name = recording, recording.path.name
        self.dt, self.steps, self.last = 1.0 / recording.times.played, 0, len(recording) - 1
        self.painter, self.has_chains = painter_of(recording), recording.has_forces
        self.colorings = *CATEGORIES, *colorings_of(recording.recorded_scene, self.has_chains)

    @property
    def has_ended(self) -> bool:
        """True if the last frame is shown."""
        return self.steps >= self.last

    def advance(self, steps: int) -> None:
        self.steps = min(self.steps + steps, self.last)

    def restart(self) -> None:
        self.steps = 0

    def set_style(self, color_by: str, forces: bool) -> None:
        self.painter = painter_of(self._recording, color_by=color_by, forces=forces)

    def snapshot(self) -> Snapshot:
        return self._recording.frame(self.steps, self.has_chains)

    def readout(self) -> dict[str, str]:
        """Return the rows of the page's table: numbers of the present frame, as texts by name."""
        now = self.snapshot()
        rows = {"time": f"{now.time:.4g} s", "frame": f"{self.steps} of {self.last}"}
        if self.has_chains:
            rows["contacts"] = f"{len(now.force) + len(now.wall_force)}"
        return rows

    def curves(self) -> Curves:
        """Return no curves, because a recording stores no iterations."""
        return {}


Player: TypeAlias = "Live | Replay | Homework"
"""A player of a page; one of its steps takes `dt` [s]."""
