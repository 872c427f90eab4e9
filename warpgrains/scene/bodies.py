"""The walls of a scene as bodies of the device (kernels/walls.py).

Body 0 is the annulus, whose circles are its two sides. The walls inside it follow. With friction or a driven
wall the inner circle is body 1 instead, a disc at the origin, because each circle then needs its own friction
and speed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.scene.disc import Disc
from warpgrains.scene.obstacle import Drive, Obstacle
from warpgrains.scene.walls import INNER, OUTER, Annulus

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene


class Bodies:
    """The bodies that the walls of a scene are on the device.

    Attributes
    ----------
    two_circles : bool
        Whether the inner circle is body 1, instead of the other side of body 0.
    """

    def __init__(self, scene: Scene):
        self._scene = scene
        self.two_circles = (scene.has_friction or scene.has_driven_walls) and scene.radius_in > 0.0

    def __len__(self) -> int:
        return 1 + self.two_circles + len(self._scene.walls)

    @property
    def annulus(self) -> Annulus:
        """The annulus as body 0, without an inner circle that is another body."""
        annulus = self._scene.annulus
        return annulus._replace(radius_in=0.0) if self.two_circles else annulus

    @property
    def inside(self) -> tuple[Obstacle, ...]:
        """The bodies 1, 2, ..."""
        circle = (Disc((0.0, 0.0), self._scene.radius_in),) if self.two_circles else ()
        return circle + self._scene.walls

    @property
    def joints(self) -> list[list[int]]:
        """The bodies inside, from 0 on, at the joints of each, see `Joints.others`."""
        others, first = self._scene.joints.others, int(self.two_circles)
        return [[]] * (2 * first * bool(others)) + [[first + wall for wall in own] for own in others]

    @property
    def surfaces(self) -> FloatArray:
        """Friction of each body, and the speed of its surface [m/s], shape (bodies, 2)."""
        scene = self._scene
        walls = [wall for wall in scene.wall_numbers if wall != INNER or self.two_circles]
        return np.array([(scene.wall_frictions[wall], scene.surface_speed(wall)) for wall in walls])

    @property
    def drives(self) -> list[Drive]:
        """The drive of each body; that of one that no force acts on is all 0."""
        scene, outer = self._scene, Drive()
        if scene.pressure is not None:
            mass = float(scene.mass.sum()) if scene.wall_mass is None else scene.wall_mass
            outer = Drive(1.0 / mass, pressure=scene.pressure)
        return [outer, *(wall.drive or Drive() for wall in self.inside)]

    def of(self, wall: IntArray) -> IntArray:
        """Return the body of each wall."""
        return wall if self.two_circles else np.maximum(wall - 1, 0)

    def sign(self, wall: IntArray) -> FloatArray:
        """Return the sign of the device's corrections at each wall: -1 at the inner side of body 0."""
        return np.where((wall == INNER) & (not self.two_circles), -1.0, 1.0)

    def carried(self, body: IntArray, correction: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the walls that carry corrections of bodies [m/s], and the corrections, >= 0.

        If both circles are body 0, the sign tells them apart; 0 is that of the outer one.
        """
        wall = body
        if not self.two_circles:
            wall = np.where(body > 0, body + 1, np.where(correction < 0.0, INNER, OUTER))
        return wall.astype(np.int32), np.abs(correction)
