"""`warpgrains run --step-by-step`: one step per key press, with the keys of the course's program."""

from __future__ import annotations

import os
import select
import sys
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

from warpgrains.base.console import STDIN
from warpgrains.base.errors import InputError
from warpgrains.base.files import require_writable_path, table_text, write_atomically
from warpgrains.base.locks import lock_own
from warpgrains.base.shown import number_of
from warpgrains.base.warp_start import start_warp
from warpgrains.scene.scene import Scene
from warpgrains.solver.statistics import StepReport

_KEYS = "N: next step   R: run   S: stop   Q: quit"
_COLUMNS = ("step", "time [s]", "iterations", "zeta [m/s]", "residual [m/s]", "contacts", "overlap [m]")
_WIDTHS = (7, 10, 11, 12, 15, 9, 12)
_ESCAPE, _LONGEST = b"\x1b", 16  # first byte and largest length of the escape sequences of some keys
_HISTORY = ("step", "iteration", "zeta", "residual")


def step_by_step(scene: Scene, steps: int, arguments: Namespace) -> None:
    """Advance a scene step by step on key presses, until Q or the end of the run."""
    if arguments.history is None:
        _step_by_step(scene, steps, arguments)
        return
    output = Path(arguments.history)
    require_writable_path("history", output, ".csv")
    with lock_own(output, _is_history, "history of warpgrains"):
        rows = _step_by_step(scene, steps, arguments)
        if not rows:
            raise InputError(f"no step was taken: history '{output}' is not written")
        write_atomically(output, table_text(rows).encode())


def _is_history(path: Path) -> bool:
    return path.read_bytes().startswith(",".join(_HISTORY).encode())


def _step_by_step(scene: Scene, steps: int, arguments: Namespace) -> list[dict[str, Any]]:
    """Take steps on key presses; with `--history`, return zeta and residual [m/s] of every iteration."""
    start_warp()
    from warpgrains.simulation.simulation import Simulation

    simulation = Simulation(scene, arguments.device, arguments.threads)
    simulation.compile()
    rows: list[dict[str, Any]] = []
    with _keys_at_once():
        print(f"{scene.name}, {number_of(scene.n, 'grain')}, {number_of(steps, 'step')}   {_KEYS}")
        print(_line(_COLUMNS), flush=True)
        for _ in _pressed(steps, 0.0 if arguments.full_speed else scene.dt):
            report = simulation.step(history=arguments.history is not None)
            print(_line(_cells(simulation.steps, simulation.time, report)), flush=True)
            rows += _rows(simulation.steps, report)
    return rows


def _pressed(steps: int, spacing: float) -> Iterator[None]:
    """Yield once for every step that is due, at most `steps` times; Q ends this.

    A step is due when N is pressed. After R, until S or N, one is also due every `spacing` seconds.
    """
    running, taken, due = False, 0, 0.0
    while taken < steps:
        key = _key(max(0.0, due - monotonic()) if running else None)
        if key == "q" or (key == "" and not running):
            return
        if key not in (None, "", *"rsn"):
            print(f"unknown key; {_KEYS}", file=sys.stderr, flush=True)
            continue
        if key == "r" and not running:
            running, due = True, monotonic()
        running = running and key not in ("s", "n")
        if key == "n" or (running and (key == "" or monotonic() >= due)):
            due += spacing
            taken += 1
            yield


def _key(patience: float | None) -> str | None:
    """Return the key pressed within `patience` [s], in lower case; None if none is pressed.

    The result is "" at the end of input, and "other" for a key without an ASCII character. If `patience` is
    None, wait for a key.
    """
    while True:
        if patience is not None and not select.select([STDIN], [], [], patience)[0]:
            return None
        byte = os.read(STDIN, 1)
        if not byte.isascii() or byte == _ESCAPE:
            while select.select([STDIN], [], [], 0.0)[0] and os.read(STDIN, _LONGEST):
                pass
            return "other"
        if os.isatty(STDIN) or byte not in (b"\r", b"\n"):
            return byte.decode().lower()


@contextmanager
def _keys_at_once() -> Iterator[None]:
    """Read keys without line buffering and echo, if the input is a terminal."""
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
