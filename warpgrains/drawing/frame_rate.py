"""How many steps lie between two frames, and how many frames a second that makes."""

from fractions import Fraction

from warpgrains.errors import SceneError


def recording_stride(dt: float, frames_per_second: float) -> int:
    """Return how many steps of dt [s] lie between two frames, at least 1; frames per second are wanted ones.

    The stride is the integer nearest to ``1 / (frames_per_second * dt)``, both taken as the decimal numbers
    a user writes, so that no rounding of a float decides it. The file then states the rate it really has,
    `recording_rate`: with dt = 0.01 s and 60 frames asked for, every 2nd step is a frame, 50 frames a second.

    Raises
    ------
    SceneError
        If `frames_per_second` is not a positive finite number.
    """
    if not 0 < frames_per_second < float("inf"):
        raise SceneError(f"frames per second must be a positive number, not {frames_per_second}")
    return max(1, round(1 / (_as_written(frames_per_second) * _as_written(dt))))


def recording_rate(dt: float, stride: int) -> float:
    """Return the frames per second [1/s] of one frame every `stride` steps of `dt` [s], to the last bit."""
    return float(1 / (stride * _as_written(dt)))


def _as_written(value: float) -> Fraction:
    return Fraction(repr(float(value)))
