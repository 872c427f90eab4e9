"""With what the runs of a sweep are executed, wherever that is."""

from collections.abc import Callable
from dataclasses import dataclass

OnProgress = Callable[[float], None]
"""Hears of progress, in runs."""


@dataclass(frozen=True)
class ExecutionOptions:
    """With what runs are executed.

    Attributes
    ----------
    device : str
        A Warp device, "cpu" or "cuda:0".
    threads : int or None
        OS threads on a CPU; None for as many as there are cores.
    fps : float or None
        Frames recorded a second of simulated time [1/s], if runs are to be recorded.
    """

    device: str = "cpu"
    threads: int | None = None
    fps: float | None = None
