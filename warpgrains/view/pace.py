"""The pace of playback: how many steps are due at each frame, and when."""

from time import perf_counter, sleep

FRAMES = 30.0  # a second, at most
_ROUNDING = 1e-6  # steps


class Pace:
    """Frames at a constant rate, each with the steps that simulated time owes since the last one.

    Parameters
    ----------
    dt : float
        Duration of a step [s].
    """

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self.restart()

    def restart(self) -> None:
        """Begin with a frame now, and owe nothing."""
        self._owed, self._next = 0.0, perf_counter()

    def due(self, speed: float) -> int:
        """Return the number of steps of the next frame at a speed, 1 in real time."""
        self._owed += speed / FRAMES / self._dt
        steps = int(self._owed + _ROUNDING)
        self._owed -= steps
        return steps

    def wait(self) -> None:
        """Wait until the next frame. What is late stays late, so that a slow player does not hurry later."""
        self._next = max(self._next + 1.0 / FRAMES, perf_counter())
        sleep(max(0.0, self._next - perf_counter()))
