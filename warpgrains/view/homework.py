"""Player that runs a homework next to the reference, in stages of a time step.

The stages are the velocities without contacts, then each contact iteration, and finally the positions.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from warpgrains.analysis.snapshot import snapshot
from warpgrains.base.arrays import FloatArray
from warpgrains.drawing.looks import Look
from warpgrains.drawing.painter import Painter
from warpgrains.grade.probes import start_of
from warpgrains.grade.sandbox import Answer, Child, EndedError
from warpgrains.scene.scene import Scene
from warpgrains.scene.snapshot import Snapshot
from warpgrains.scene.state import first_state
from warpgrains.view.players import LEAST, PLACEHOLDER, ZETA, Curves

_EQUAL, _DIFFERENT = np.array([0.75, 0.83, 0.95]), np.array([0.85, 0.1, 0.1])
_LEAST = 1e-9  # [m/s]: smaller differences may be rounding errors
_SLOWED = 1.0 / 30.0  # duration of a stage on the page [s]


class _Painter(Painter):
    """Painter that colors each grain by |v of the homework - v of the reference|.

    Blue means equal up to 1e-9 m/s. Red is the largest difference of all grains.
    """

    def color(self, now: Snapshot) -> FloatArray:
        difference = now.recorded["difference"]
        finite = difference[np.isfinite(difference)]
        share = np.clip(difference / max(finite.max(initial=0.0), _LEAST), 0.0, 1.0)
        share = np.where(difference > _LEAST, 0.25 + 0.75 * share, 0.0)[:, np.newaxis]
        return (1.0 - share) * _EQUAL + share * _DIFFERENT


class Homework:
    """Player of a homework and the reference, each in a sandboxed process.

    `start` starts both processes, the reference first. A step of the player is one stage of a time step. Both
    programs start each time step from the reference's state. Grains are drawn at the reference's positions.
    They are the redder, the more the velocities of both programs differ.
    """

    colorings: tuple[str, ...] = ()
    has_chains = False
    dt = _SLOWED

    def __init__(self, scene: Scene, start: Callable[[], tuple[Child, Child]], name: str) -> None:
        self._scene, self._start, self.name = scene, start, name
        self.painter = _Painter(scene, Look())
        self.painter.top_speed = 0.0  # its colors show no speed
        self._children: tuple[Child, ...] = ()
        self.restart()

    def restart(self) -> None:
        """Return to the start of the scene, with new processes."""
        self.close()
        self._children = self._start()
        self.steps, self._time_steps = 0, 0
        self.error: str | None = None
        self._stage, self._zeta = "", (np.nan, np.nan)
        self._call = start_of(self._scene)
        self._states = [self._call.state, self._call.state]
        self._history: list[tuple[float, float]] = []
        self._stages = self._play()

    def close(self) -> None:
        """End both processes."""
        for child in self._children:
            child.close()

    @property
    def has_ended(self) -> bool:
        return self.error is not None

    def advance(self, steps: int) -> None:
        for _ in range(steps):
            if not self.has_ended:
                try:
                    next(self._stages)
                    self.steps += 1
                except EndedError as error:
                    self.error = f"{self._stage}: it {error}"

    def _play(self) -> Iterator[None]:
        """Do all stages of all time steps; yield after each stage."""
        n = self._scene.n
        while True:
            self._stage, self._history = "velocities by Newton's law", []
            ends = self._ask(-1)
            for k, end in enumerate(ends):
                self._states[k] = self._call.state.copy()
                self._states[k][: 4 * n] = end.before
            yield
            for iteration in range(ends[0].calls):
                self._stage = f"iteration {iteration}"
                answers = self._ask(iteration)
                self._states = [answer.state for answer in answers]
                self._zeta = answers[0].zeta, answers[1].zeta
                self._history += [self._zeta] if iteration else []
                yield
            self._stage = "positions"
            self._states = [end.state for end in ends]
            self._call = self._call._replace(state=ends[0].state)
            self._time_steps += 1
            yield

    def _ask(self, iteration: int) -> list[Answer]:
        """Return the answers of reference and homework, in this order, to a call of one iteration.

        Each iterates from its own state. With iteration -1, both do a time step from the reference's state.
        """
        states = [self._call.state] * 2 if iteration < 0 else self._states
        pairs = zip(self._children, states, strict=True)
        return [child.ask(self._call._replace(iteration=iteration, state=state)) for child, state in pairs]

    def _difference(self) -> FloatArray:
        """Return the sizes of the velocity differences of the grains [m/s], shape (n,); inf for NaN."""
        n = self._scene.n
        one, other = (state[2 * n : 4 * n].reshape(2, n) for state in self._states)
        return np.nan_to_num(np.hypot(*(one - other)), nan=np.inf)

    def set_style(self, color_by: str, forces: bool) -> None:
        """Do nothing, because grains are colored by the difference."""

    def snapshot(self) -> Snapshot:
        """Return the reference's state as a snapshot.

        Its `recorded` holds "difference", the velocity differences [m/s], which `_Painter` draws.
        """
        n, state = self._scene.n, self._states[0]
        position, velocity = (state[k : k + 2 * n].reshape(2, n).T for k in (0, 2 * n))
        now = replace(first_state(self._scene), steps=self._time_steps, position=position, velocity=velocity)
        return replace(snapshot(self._scene, now), recorded={"difference": self._difference()})

    def readout(self) -> dict[str, str]:
        """Return the rows of the page's table, texts by name: the stage, both zeta and the worst grain."""
        difference = self._difference()
        worst = int(difference.argmax())
        differs = difference[worst] > _LEAST
        expected, found = (PLACEHOLDER if np.isnan(zeta) else f"{zeta:.2e} m/s" for zeta in self._zeta)
        rows = {
            "step": f"{self._time_steps + 1}",
            "stage": self._stage or PLACEHOLDER,
            "zeta of the reference": expected,
            "zeta of the homework": found,
            "largest difference of v": f"{difference[worst]:.2e} m/s, grain {worst}" if differs else "none",
        }
        return rows | ({"error": self.error} if self.error else {})

    def curves(self) -> Curves:
        """Return log10 of zeta of the reference and the homework over the iterations of the time step."""
        history = np.abs(np.reshape(self._history, (-1, 2))).T
        expected, found = np.log10(np.clip(np.nan_to_num(history, nan=np.inf), LEAST, 1.0 / LEAST))
        return {ZETA: (np.arange(1.0, len(found) + 1), {"reference": expected, "homework": found})}
