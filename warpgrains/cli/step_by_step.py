"""`warpgrains run --step-by-step`: a step a key press, with the keys of the course's program."""

from __future__ import annotations

import os
import select
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from warpgrains.console import STDIN, start_warp
from warpgrains.errors import SceneError
from warpgrains.files import require_place, table_text, write_whole
from warpgrains.locks import Lock
from warpgrains.scene.scene import Scene
from warpgrains.solver.statistics import StepReport

_KEYS = "N: next step   R: run   S: stop   Q: quit"
_COLUMNS = ("step", "time [s]", "iterations", "zeta [m/s]", "residual [m/s]", "contacts", "overlap [m]")
_WIDTHS = (7, 10, 11, 12, 15, 9, 12)
_HISTORY = ("step", "iteration", "zeta", "residual")


def step_by_step(scene: Scene, steps: int, arguments: Namespace) -> None:
    """Take steps of a scene as keys are pressed, until Q or the end of the run.

    Raises
    ------
    SceneError
        The history cannot be written there.
    SimulationError
        A step failed.
    """
    if arguments.history is None:
        _step_by_step(scene, steps, arguments)
        return
    output = Path(arguments.history)
    require_place("history", output, ".csv")
    with Lock(output):
        _require_history(output)
        rows = _step_by_step(scene, steps, arguments)
        if not rows:
            raise SceneError(f"no step was taken: history '{output}' is not written")
        write_whole(output, table_text(rows).encode())


def _require_history(output: Path) -> None:
    """Raise SceneError if a file is there that is no history."""
    if output.exists() and not output.read_bytes().startswith(",".join(_HISTORY).encode()):
        raise SceneError(f"'{output}' is there, and no history: it is left as it is")


def _step_by_step(scene: Scene, steps: int, arguments: Namespace) -> list[dict[str, Any]]:
    """Return zeta and residual of every iteration of the steps taken."""
    start_warp()
    from warpgrains.simulation.simulation import Simulation

    simulation = Simulation(scene, arguments.device, arguments.threads)
    simulation.compile()
    rows: list[dict[str, Any]] = []
    with _keys_at_once():
        print(f"{scene.name}, {scene.n} grains, {steps} steps   {_KEYS}")
        print(_line(_COLUMNS), flush=True)
        for _ in _pressed(steps):
            report = simulation.step(history=arguments.history is not None)
            print(_line(_cells(simulation.steps, simulation.time, report)), flush=True)
            rows += _rows(simulation.steps, report)
    return rows


def _pressed(steps: int) -> Iterator[None]:
    """Yield whenever a step is to be taken, at most so often."""
    running, taken = False, 0
    while taken < steps:
        key = _key(wait=not running)
        if key == "q" or (key == "" and not running):
            return
        running = key == "r" or (running and key not in ("s", "n"))
        if running or key == "n":
            taken += 1
            yield


def _key(wait: bool) -> str | None:
    """Return the key that was pressed, in lower case; "" at the end of the input, None if there was none."""
    if not wait and not select.select([STDIN], [], [], 0.0)[0]:
        return None
    return os.read(STDIN, 1).decode(errors="replace").lower()


@contextmanager
def _keys_at_once() -> Iterator[None]:
    """Have keys read as they are pressed, if they come from a terminal, and not shown."""
    if not os.isatty(STDIN):
        yield
        return
    import termios
    import tty

    before = termios.tcgetattr(STDIN)
    tty.setcbreak(STDIN)
    try:
        yield
    finally:
        termios.tcsetattr(STDIN, termios.TCSADRAIN, before)


def _cells(step: int, time: float, report: StepReport) -> tuple[str, ...]:
    iterations = f"{report.iterations}{'' if report.converged else '!'}"
    numbers = f"{report.zeta:.2e}", f"{report.residual:.2e}", f"{report.contacts}", f"{report.overlap:.2e}"
    return f"{step}", f"{time:.6g}", iterations, *numbers


def _line(cells: tuple[str, ...]) -> str:
    return " ".join(f"{cell:>{width}}" for cell, width in zip(cells, _WIDTHS, strict=True))


def _rows(step: int, report: StepReport) -> Iterator[dict[str, Any]]:
    if report.history is not None:
        for k, (zeta, residual) in enumerate(zip(*map(list, report.history), strict=True), start=1):
            yield dict(zip(_HISTORY, (step, k, zeta, residual), strict=True))
