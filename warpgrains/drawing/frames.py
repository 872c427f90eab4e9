"""Frames of a run: their contents and times, loads of the grains in them, and the interface of outputs."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import ceil, floor
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.errors import InputError

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.solver.forces import PairContacts, WallContacts
    from warpgrains.solver.loaded_scene import LoadedScene

_TOLERANCE = Fraction(1, 10**9)  # tolerance, in steps


@dataclass(frozen=True)
class Frame:
    """State of a run at one time, as it is drawn."""

    position: FloatArray
    """[m], shape (n, 2)."""
    velocity: FloatArray
    """[m/s], shape (n, 2)."""
    contacts: PairContacts | None = None
    """Contacts between grains; None, like those with walls, if nothing that is drawn needs forces."""
    wall_contacts: WallContacts | None = None
    spin: FloatArray | None = None
    """Angular velocities [rad/s], shape (n,); with friction required, as the angles, without unused."""
    angle: FloatArray | None = None
    """Angles by which grains have turned [rad], shape (n,)."""
    time: float = 0.0
    """Simulated time [s]."""
    driven: FloatArray | None = None
    """Coordinates and speeds of walls, see `State.driven`; None where no force drives a wall."""

    @classmethod
    def of(cls, now: LoadedScene, has_contacts: bool) -> Self:
        """Return the present state of a scene, with or without contacts."""
        contacts, walls = now.forces() if has_contacts else (None, None)
        return cls(now.position, now.velocity, contacts, walls, now.spin, now.angle, now.time, now.driven)

    @property
    def places(self) -> FloatArray | None:
        """Coordinates of walls [m], shape (walls,); None where no force drives a wall."""
        return None if self.driven is None else self.driven[:, 0]

    def rotation(self) -> tuple[FloatArray, FloatArray]:
        """Return spin and angle of the grains; ValueError where they are missing."""
        if self.spin is None or self.angle is None:
            raise ValueError("a frame of a scene with friction needs spin and angle")
        return self.spin, self.angle

    def forces(self) -> tuple[PairContacts, WallContacts]:
        """Return the contacts between grains and with walls. Raises ValueError if they are missing."""
        if self.contacts is None or self.wall_contacts is None:
            raise ValueError("a frame drawn with forces or pressure needs contacts and wall_contacts")
        return self.contacts, self.wall_contacts


@dataclass(frozen=True)
class FrameTimes:
    """Frames k = 0, 1, 2, ... of a run at times k / rate after its start, for a scene with time step dt.

    Both are taken as the decimals that a user writes, so that rounding does not shift a frame to another
    step.
    """

    dt: float
    """Time step [s]."""
    rate: float
    """Frames per second of simulated time [1/s], at most one per step."""
    first_step: int = 0
    """Time steps before the run."""
    start: float = 0.0
    """Time at the start of the simulation [s]."""

    @classmethod
    def of(cls, dt: float, wanted: float, first_step: int = 0, start: float = 0.0) -> FrameTimes:
        """Return frame times with the requested rate [1/s] > 0, or one frame per step if steps are longer."""
        if not 0 < wanted < float("inf"):
            raise InputError(f"frames per second is {wanted}: it must be greater than 0")
        return cls(dt, min(float(wanted), float(1 / _as_written(dt))), first_step, start)

    def step(self, k: int) -> int:
        """Return the step of the run in which frame k lies, or at whose end it is."""
        return ceil(k * self._steps_a_frame - _TOLERANCE)

    def simulated_step(self, k: int) -> int:
        """Return the same step, counted from the start of the simulation."""
        return self.first_step + self.step(k)

    def count(self, steps: int) -> int:
        """Return the number of frames of the first steps of a run, the first frame included."""
        return floor((steps + _TOLERANCE) / self._steps_a_frame) + 1

    def time(self, k: int) -> float:
        """Return the simulated time of frame k [s]."""
        return self.start + self.simulated_step(k) * self.dt - self._left(k)

    def elapsed(self, k: int) -> float:
        return k / self.rate

    def time_in_step(self, k: int) -> float:
        """Return the time from the start of the step of frame k to the frame [s]."""
        return self.dt - self._left(k)

    def _left(self, k: int) -> float:
        """Return the time from frame k to the end of its step [s]."""
        left = self.step(k) - k * self._steps_a_frame
        return float(left) * self.dt if left > _TOLERANCE else 0.0

    def shown(self, k: int, end: Frame) -> Frame:
        """Return frame k, with all at its time, from the state at the end of `step(k)`.

        Within a step, grains move in a straight line and turn with the velocities at its end (eqs. 3, 24).
        """
        left, angle, driven = self._left(k), end.angle, end.driven
        if left == 0.0:
            return end
        if end.spin is not None and angle is not None:
            angle = angle - left * end.spin
        if driven is not None:
            driven = np.stack([driven[:, 0] - left * driven[:, 1], driven[:, 1]], axis=1)
        position = end.position - left * end.velocity
        return replace(end, position=position, angle=angle, driven=driven, time=self.time(k))

    @cached_property
    def _steps_a_frame(self) -> Fraction:
        return 1 / (_as_written(self.rate) * _as_written(self.dt))


def _as_written(value: float) -> Fraction:
    return Fraction(repr(float(value)))


class Output(AbstractContextManager[Any], Protocol):
    """Interface of a file that receives frames of a run, and is complete at the end of the ``with`` block."""

    needs_contacts: bool
    """Whether frames must have contacts."""

    def record(self, frame: Frame) -> None:
        """Append the next frame, as `FrameTimes.shown` returns it; a picture's only frame is the end."""

    def flush(self) -> None:
        """Flush to the disk the frames from which a later run can continue."""


def pressure(frame: Frame, radius: FloatArray) -> FloatArray:
    """Return the mean of the principal stresses of each grain, force by circumference [N/m], shape (n,)."""
    contacts, wall_contacts = frame.forces()
    grain = np.concatenate([*contacts.pair.T, wall_contacts.wall[:, 0]])
    force = np.concatenate([contacts.force, contacts.force, wall_contacts.force])
    total = np.bincount(grain, force, len(radius)).astype(np.float64)  # integers without contacts
    return total / (2.0 * np.pi * radius)


def mobilized(scene: Scene, contacts: PairContacts, wall_contacts: WallContacts) -> FloatArray:
    """Return the largest |tangential| / (friction * normal force) of each grain, shape (n,); 1 slides."""
    found, (i, j) = np.zeros(scene.n), contacts.pair.T
    between = _share(contacts, scene.friction)
    at_wall = _share(wall_contacts, np.array(scene.wall_frictions)[wall_contacts.wall[:, 1]])
    for grain, share in ((i, between), (j, between), (wall_contacts.wall[:, 0], at_wall)):
        np.maximum.at(found, grain, share)
    return found


def _share(contacts: PairContacts | WallContacts, friction: float | FloatArray) -> FloatArray:
    """Return |tangential force| over what friction allows, of each contact, shape (m,)."""
    most = friction * contacts.force
    return np.divide(np.abs(contacts.tangential_force), most, out=np.zeros_like(most), where=most > 0.0)
